# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wiring of the streams of a log to the ports of a DFPC."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from cdff_common.contract.foreign_names import is_mount
from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.profile import DfpcEntry, read_mask


def stream_of_wiring(robot: str, wiring: str) -> str:
    """Return the stream of a wiring: ``/mana/navcam.pair`` for ``sensor/navcam/pair`` of ``mana``.

    Of several alternatives the first is used.
    """
    _, owner, item = wiring.split("|")[0].split("/")
    return f"/{robot}/{owner}.{item}"


def robot_of(streams: Mapping[str, str], robot: str | None) -> str:
    """Return the robot to replay: ``robot`` if given, otherwise the only robot of the log.

    Raises InputError if the log has several robots.
    """
    robots = sorted({name.split("/")[1] for name in streams if name.count("/") >= 2})
    if robot is not None:
        return robot
    if len(robots) == 1:
        return robots[0]
    if not robots:
        return "robot"
    raise InputError(f"the log holds robots {', '.join(robots)}: name one with --robot")


def _is_stored(wiring: str) -> bool:
    """Return True if a port is wired to products of the DPM, which are not in a log."""
    return wiring.startswith("dpm/")


def wire(
    description: DfpcDescription,
    streams: Mapping[str, str],
    robot: str,
    mapping: Mapping[str, str],
    entry: DfpcEntry | None = None,
    from_files: Sequence[str] = (),
) -> dict[str, str]:
    """Return the stream of each port.

    The stream is, in this order: that of ``mapping``; the input of ``entry``; the stream with the type and
    name of the port; the only stream of this type, if no other port has the type. Ground truth and the poses
    of sensors on the robot (``.mount``) are wired only by ``mapping``, unless the log has nothing else, as a
    file of poses.

    Parameters
    ----------
    streams : mapping of str to str
        Types of the streams of the log by name.
    entry : DfpcEntry, optional
        The DFPC in a profile.
    from_files : sequence of str
        Ports whose values come from files.

    Raises
    ------
    InputError
        If a given stream is not in the log or has another type, or a required port has no stream.
    """
    ports = {p.attribute: p for p in description.input_ports}
    unknown = set(mapping) - set(ports)
    if unknown:
        raise InputError(f"--map {sorted(unknown)[0]}=…: {description.folder} has ports {', '.join(ports)}")
    candidates = {
        name: type_name
        for name, type_name in streams.items()
        if name.startswith(f"/{robot}/") or name.count("/") < 2
    }
    measured = {
        name: type_name
        for name, type_name in candidates.items()
        if "/truth." not in name and not is_mount(name)
    }
    candidates = measured or candidates
    wired: dict[str, str] = {}
    for name, port in ports.items():
        if name in from_files:
            continue
        stream = mapping.get(name)
        if (
            stream is None
            and entry is not None
            and name in entry.inputs
            and not _is_stored(entry.inputs[name])
        ):
            stream = stream_of_wiring(robot, entry.inputs[name])
            if stream not in streams:
                continue
        elif stream is None:
            same_type = [n for n, t in candidates.items() if t == port.type_name]
            by_name = [n for n in same_type if n.rsplit(".", 1)[-1] == name]
            is_unique = (
                len(same_type) == 1 and sum(p.type_name == port.type_name for p in ports.values()) == 1
            )
            stream = by_name[0] if len(by_name) == 1 else same_type[0] if is_unique else None
        if stream is None:
            continue
        if stream not in streams:
            raise InputError(
                f"port {name}: no stream {stream!r} in the log; it has {', '.join(sorted(streams))}"
            )
        if streams[stream] != port.type_name:
            raise InputError(f"port {name} takes {port.type_name}; stream {stream} holds {streams[stream]}")
        wired[name] = stream
    missing = [n for n, p in ports.items() if not p.optional and n not in wired and n not in from_files]
    if missing or not wired:
        unwired = ", ".join(f"{n} ({ports[n].type_name})" for n in missing) or "any port"
        available = ", ".join(f"{n} ({t})" for n, t in sorted(streams.items())) or "no streams"
        mesh = any(ports[n].type_name == "Mesh" for n in missing)
        raise InputError(
            f"{description.folder}: no stream of the log fits {unwired}; use "
            f"{'--model FILE' if mesh else '--map PORT=STREAM'}. The log has {available}"
        )
    return wired


def with_masks(context: DfpcContext, files: Sequence[str]) -> DfpcContext:
    """Return the context with mask images of its stereo camera, the left and the right one.

    Without a stereo camera in the context, one is added.

    Raises
    ------
    InputError
        If there are more than two files, or several stereo cameras.
    ConfigurationError
        If a file cannot be read.
    """
    stereo = [name for name, entry in context.sensors.items() if entry["kind"] == "stereo_camera"]
    if len(files) > 2 or len(stereo) > 1:
        raise InputError(
            f"--mask: {len(files)} files for stereo cameras {stereo}: expected at most 2 files, 1 camera"
        )
    masks = dict(zip(("mask", "mask_right"), (read_mask(Path(name)) for name in files), strict=False))
    name = stereo[0] if stereo else "camera"
    entry = {"kind": "stereo_camera", "frame": "", **context.sensors.get(name, {}), **masks}
    return dataclasses.replace(context, sensors={**context.sensors, name: entry})
