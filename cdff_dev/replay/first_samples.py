# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of files that come before those of a log: models of bodies, a map, a guess of the first pose."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription, InputPort
from cdff_common.interfaces.dfpc import Sample
from cdff_dev.run.inputs import read_inputs

#: Ports of the options ``--model``, ``--map`` and ``--guess``, and the types that they take.
_OPTIONS = {"model": "Mesh", "map": "VisualMap", "guess": "TransformWithCovariance"}


def file_ports(models: Sequence[str], guess: str | None, map_file: str | None = None) -> list[str]:
    """Return the ports that files are given for."""
    return [port for port, files in (("model", models), ("map", map_file), ("guess", guess)) if files]


def with_files(
    samples: Iterable[Sample],
    description: DfpcDescription,
    models: Sequence[str],
    guess: str | None,
    map_file: str | None = None,
) -> Iterator[Sample]:
    """Yield the samples of model, map and guess files, with the time of the first sample, then the samples.

    Raises
    ------
    InputError
        If the DFPC has no such port, or a file is not of its type.
    """
    files = [("model", file) for file in models]
    files += [(port, file) for port, file in (("map", map_file), ("guess", guess)) if file]
    values = [(port, file, _read(description, port, file)) for port, file in files]
    if len(models) > 1 and not _port(description, "model").repeated:
        raise InputError(f"--model is given {len(models)} times: {description.folder} takes one model")
    remaining = iter(samples)
    first = next(remaining, None)
    if first is None:
        return
    for seq, (port, file, value) in enumerate(values):
        digest = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:32]
        yield Sample(port, first.stamp_ns, seq, value, id=digest)
    yield from chain([first], remaining)


def _read(description: DfpcDescription, name: str, file: str) -> object:
    port = _port(description, name)
    value = read_inputs([port], {name: file})[name]
    return value[0] if isinstance(value, list) else value


def _port(description: DfpcDescription, name: str) -> InputPort:
    port = next((p for p in description.input_ports if p.attribute == name), None)
    if port is None or port.type_name != _OPTIONS[name]:
        ports = ", ".join(p.attribute for p in description.input_ports)
        raise InputError(f"--{name}: {description.folder} has the ports {ports}, expected a port {name}")
    return port
