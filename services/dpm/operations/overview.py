# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams, DFPCs and newest products of a running mission, from the statuses of the DFPC hosts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from cdff_common.contract.wiring import Source
from cdff_common.interfaces.profile import Robot

#: Largest ratio of the measured rate to the stated one, and the reverse.
_RATE_RATIO = 1.25
#: Time without samples that is a fault, periods of the stated rate, and seconds of a stream without one.
_SILENT_PERIODS, _SILENT_S = 3.0, 2.0
#: Largest offset by which stamps are ahead of mission time, seconds.
_AHEAD_S = 0.1

Modes = Mapping[tuple[str, str], Mapping[str, Any]]


def overview(robots: Sequence[Robot], dfpcs: Iterable[Mapping[str, Any]], modes: Modes) -> dict[str, Any]:
    """Return the tables ``streams``, ``dfpcs`` and ``newest``.

    Parameters
    ----------
    robots : sequence of Robot
        Robots of the profiles.
    dfpcs : iterable of mapping
        Newest status of each DFPC (``ServiceMonitor.all_dfpcs``).
    modes : mapping of (robot, sensor) to mapping
        Newest ``event/sensor_mode`` of each sensor.
    """
    statuses = list(dfpcs)
    return {
        "streams": [*_streams(robots, statuses, modes)],
        "dfpcs": [_dfpc(body) for body in statuses],
        "newest": [*_newest(statuses)],
    }


def _streams(
    robots: Sequence[Robot], statuses: Sequence[Mapping[str, Any]], modes: Modes
) -> Iterator[dict[str, Any]]:
    """Yield a row for each sensor stream of the robots, measured or not."""
    measured: dict[tuple[str, str, str], list[tuple[str, Mapping[str, Any]]]] = {}
    for body in statuses:
        for source, stream in body.get("streams", {}).items() if body["alive"] else ():
            parsed = Source.parse(source)
            if parsed.kind == "sensor":
                key = (str(body["robot"]), parsed.owner, parsed.item)
                measured.setdefault(key, []).append((str(body["name"]), stream))
    for robot in robots:
        for name, sensor in robot.sensors.items():
            mode = modes.get((robot.id, name)) or {
                "mode": sensor.initial_mode,
                **sensor.modes[sensor.initial_mode].model_dump(),
            }
            for item, type_name in sensor.streams.items():
                row = {
                    "robot": robot.id,
                    "sensor": name,
                    "stream": item,
                    "type": type_name,
                    "mode": mode.get("mode"),
                    "on": mode.get("on", True),
                    "stated_hz": mode.get("rate_hz"),
                    "lost_reason": mode.get("reason", ""),
                }
                yield _with_measurements(row, measured.get((robot.id, name, item), []))


def _with_measurements(
    row: dict[str, Any], measured: Sequence[tuple[str, Mapping[str, Any]]]
) -> dict[str, Any]:
    """Return a row with the measurements of the consumer that received most samples, and faults in words."""
    consumers = [name for name, _ in measured]
    stream = max((s for _, s in measured), key=lambda s: int(s["count"]), default=None)
    if stream is None:
        return row | {"consumers": consumers, "faults": [row["lost_reason"]] if row["lost_reason"] else []}
    return row | dict(stream) | {"consumers": consumers, "faults": [*_faults(row, stream)]}


def _faults(row: Mapping[str, Any], stream: Mapping[str, Any]) -> Iterator[str]:
    if row["lost_reason"]:
        yield f"lost: {row['lost_reason']}"
    stated_hz, rate_hz, silent_s = row["stated_hz"], stream["rate_hz"], stream["silent_s"]
    limit_s = _SILENT_PERIODS / stated_hz if stated_hz else _SILENT_S
    if row["on"] and silent_s is None:
        yield "no sample yet"
    elif row["on"] and silent_s > max(limit_s, _SILENT_S):
        yield f"silent for {silent_s:.0f} s"
    elif row["on"] and stated_hz and rate_hz and not 1 / _RATE_RATIO < rate_hz / stated_hz < _RATE_RATIO:
        yield f"{rate_hz:.3g} Hz, stated {stated_hz:g} Hz"
    if stream["lost"]:
        gaps = "one gap" if stream["gaps"] == 1 else f"{stream['gaps']} gaps"
        yield f"{stream['lost']} samples lost in {gaps}"
    if stream["backwards"]:
        yield f"{stream['backwards']} stamps not after the previous one"
    if stream["offset_s"] is not None and stream["offset_s"] > _AHEAD_S:
        yield f"stamps ahead of mission time by {stream['offset_s']:.2f} s"
    if not stream["frame_known"]:
        yield f"frame {stream['frame']!r} is not in the profile"


def _dfpc(body: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of a DFPC: state, quality of its newest products, cost, and errors."""
    outputs = body.get("newest_outputs", {}).values()
    order = ("OK", "DEGRADED", "FAILED")
    quality = max((o["status"] for o in outputs), key=order.index, default=None)
    reasons = [r for o in outputs if o["status"] == quality for r in o["reasons"]]
    copied = ("robot", "name", "alive", "state", "samples", "outputs", "dropped", "malformed", "errors")
    measured = ("pending", "oldest_ns", "cpu_cores", "rss_mb", "last_step_s", "max_step_s", "last_error")
    return {name: body.get(name) for name in (*copied, *measured)} | {
        "quality": quality,
        "reasons": list(dict.fromkeys(reasons)),
    }


def _newest(statuses: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the newest product of each output port."""
    for body in statuses:
        for port, output in body.get("newest_outputs", {}).items():
            yield {"robot": body["robot"], "dfpc": body["name"], "port": port, **output}
