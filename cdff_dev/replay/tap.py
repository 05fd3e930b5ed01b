# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of chosen ports during a replay, in words."""

from __future__ import annotations

from collections.abc import Callable, Collection

from cdff_common.clock import format_stamp
from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product
from cdff_common.value_text import value_lines


class Tap:
    """Writes the values of some ports.

    Parameters
    ----------
    ports : collection of str
        Input or output ports to write.
    known : collection of str
        Ports of the DFPC.
    write : callable
        Writes a line.

    Raises
    ------
    InputError
        If a port is not known.
    """

    def __init__(
        self, ports: Collection[str], known: Collection[str], write: Callable[[str], object]
    ) -> None:
        if unknown := [port for port in ports if port not in known]:
            raise InputError(f"--tap {unknown[0]}: no such port; expected one of {', '.join(known)}")
        self._ports, self._write = frozenset(ports), write

    def on_sample(self, sample: Sample) -> None:
        """Write the value of a sample, if its input port is tapped."""
        if sample.port in self._ports:
            self._line(sample.stamp_ns, sample.port, value_lines(sample.value))

    def on_product(self, product: Product) -> None:
        """Write the value of a product with its status and reasons, if its output port is tapped."""
        if product.port in self._ports:
            quality = product.header.quality
            status = " ".join([quality.status.name, *quality.reasons])
            lines = [] if product.value is None else value_lines(product.value)
            self._line(product.header.t1_ns, f"{product.port} {status}", lines)

    def _line(self, stamp_ns: int, name: str, lines: list[str]) -> None:
        self._write(f"{format_stamp(stamp_ns)} {name}: {'; '.join(lines)}")
