# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wiring of the streams of a log to the ports of a DFPC."""

from __future__ import annotations

from collections.abc import Mapping

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.profile import DfpcEntry


def stream_of_wiring(robot: str, wiring: str) -> str:
    """``sensor/navcam/pair`` of ``mana`` is the stream ``/mana/navcam.pair``; of alternatives the first is
    taken.
    """
    _, owner, item = wiring.split("|")[0].split("/")
    return f"/{robot}/{owner}.{item}"


def robot_of(streams: Mapping[str, str], robot: str | None) -> str:
    """Return the robot to replay: the one named, else the only one in the log; raises InputError."""
    robots = sorted({name.split("/")[1] for name in streams if name.count("/") >= 2})
    if robot is not None:
        return robot
    if len(robots) == 1:
        return robots[0]
    if not robots:
        return "robot"
    raise InputError(f"the log holds robots {', '.join(robots)}: name one with --robot")


def _stored(wiring: str) -> bool:
    """Return True if a port is wired to the DPM, which is not in a log."""
    return wiring.startswith("dpm/")


def wire(
    description: DfpcDescription,
    streams: Mapping[str, str],
    robot: str,
    mapping: Mapping[str, str],
    entry: DfpcEntry | None = None,
) -> dict[str, str]:
    """Return port to stream.

    In this order: ``mapping``; the inputs of the profile's ``entry``; the stream named like the port;
    the only stream of the port's type, where the port is the only one of that type. Ground truth is never
    wired by itself.

    Parameters
    ----------
    streams : mapping of str to str
        Stream name to type, as the log has them.

    Raises
    ------
    InputError
        If a named stream is not in the log, has another type, or a port that is not optional stays unwired.
    """
    ports = {p.attribute: p for p in description.input_ports}
    unknown = set(mapping) - set(ports)
    if unknown:
        raise InputError(f"--map {sorted(unknown)[0]}=…: {description.folder} has ports {', '.join(ports)}")
    own = {n: t for n, t in streams.items() if n.startswith(f"/{robot}/") or n.count("/") < 2}
    own = {n: t for n, t in own.items() if "/truth." not in n}
    wired: dict[str, str] = {}
    for name, port in ports.items():
        stream = mapping.get(name)
        if stream is None and entry is not None and name in entry.inputs and not _stored(entry.inputs[name]):
            stream = stream_of_wiring(robot, entry.inputs[name])
            if stream not in streams:
                continue
        elif stream is None:
            same_type = [n for n, t in own.items() if t == port.type_name]
            by_name = [n for n in same_type if n.rsplit(".", 1)[-1] == name]
            alone = len(same_type) == 1 and sum(p.type_name == port.type_name for p in ports.values()) == 1
            stream = by_name[0] if len(by_name) == 1 else same_type[0] if alone else None
        if stream is None:
            continue
        if stream not in streams:
            raise InputError(
                f"port {name}: no stream {stream!r} in the log; it has {', '.join(sorted(streams))}"
            )
        if streams[stream] != port.type_name:
            raise InputError(f"port {name} takes {port.type_name}; stream {stream} holds {streams[stream]}")
        wired[name] = stream
    missing = [n for n, p in ports.items() if not p.optional and n not in wired]
    if missing or not wired:
        what = ", ".join(f"{n} ({ports[n].type_name})" for n in missing) or "any port"
        held = ", ".join(f"{n} ({t})" for n, t in sorted(streams.items()))
        raise InputError(
            f"{description.folder}: nothing in the log feeds {what}; use --map PORT=STREAM. The log has "
            f"{held}"
        )
    return wired
