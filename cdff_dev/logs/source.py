# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What any log gives, whatever its format: streams, and samples in one fixed order."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from cdff_common.interfaces.product import Header


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """One stream of a log.

    Attributes
    ----------
    type_name : str
        ASN.1 type of its samples.
    count : int
        Number of samples.
    t0_ns, t1_ns : int
        Smallest and largest stamp.
    """

    type_name: str
    count: int
    t0_ns: int
    t1_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class LogSample:
    """One sample.

    Attributes
    ----------
    stream : str
        ``/{robot}/{sensor}.{stream}`` or ``/{robot}/{dfpc}.{port}``.
    type_name : str
    stamp_ns : int
        Time under which it was logged, a multiple of 1000.
    seq : int
        Number within its stream, from 0, in the order in which it was written.
    value : Any
        A message of ``cdff_common.types``.
    header : Header or None
        Of a product.
    """

    stream: str
    type_name: str
    stamp_ns: int
    seq: int
    value: Any
    header: Header | None = None


class LogSource(Protocol):
    """A log of any format."""

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name."""
        ...

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Samples of all or some streams in the order (stamp_ns, stream, seq)."""
        ...

    def close(self) -> None:
        """Let go of files."""
        ...
