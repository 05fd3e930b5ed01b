# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Samples of files that join those of a log: models of bodies, a map, a guess of the first pose, poses."""

from __future__ import annotations

import dataclasses
import hashlib
import heapq
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from itertools import chain
from pathlib import Path

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription, InputPort
from cdff_common.interfaces.dfpc import Sample
from cdff_dev.logs.formats.poses.pose_files import poses_log
from cdff_dev.run.inputs import read_inputs

#: Ports of the options ``--model``, ``--map``, ``--guess`` and ``--poses``, and the types that they take.
_OPTIONS = {
    "model": "Mesh",
    "map": "VisualMap",
    "guess": "TransformWithCovariance",
    "poses": "TransformWithCovariance",
}


def file_ports(
    models: Sequence[str], guess: str | None, map_file: str | None = None, poses: str | None = None
) -> list[str]:
    """Return the ports for which a file is given."""
    files = (("model", models), ("map", map_file), ("guess", guess), ("poses", poses))
    return [port for port, file in files if file]


def with_poses(
    samples: Iterable[Sample], description: DfpcDescription, poses: str | None
) -> Iterator[Sample]:
    """Merge the samples with the poses of a file in time order; at equal times the poses come last.

    Raises
    ------
    InputError
        If the DFPC has no port ``poses``.
    CodecError
        If the file cannot be read.
    """
    if poses is None:
        yield from samples
        return
    _port(description, "poses")
    with closing(poses_log(Path(poses))) as log:
        (stream,) = log.streams
        poses_of_file = (item.to_sample("poses", "") for item in log.samples([stream]))
        # Without frames, the poses are taken as those of the frames that the port expects.
        without_frames = (dataclasses.replace(sample, frame="", child="") for sample in poses_of_file)
        yield from heapq.merge(samples, without_frames, key=lambda sample: sample.stamp_ns)


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
