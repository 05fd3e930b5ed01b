# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start of a player: selection of the sensor streams, and waiting for the services that use them."""

from __future__ import annotations

import threading
from collections.abc import Collection

from cdff_common.bus import Bus
from cdff_common.clock import monotonic_s
from cdff_common.errors import InputError, UnavailableError
from cdff_common.interfaces.registry import Registry
from cdff_dev.logs.source import LogSource, split_stream


def playable(log: LogSource, robots: Collection[str] | None = None) -> list[str]:
    """Return the sensor streams with samples, of ``robots`` if given; truth and products are left out.

    Raises
    ------
    InputError
        If a robot is not in the log, or no stream remains.
    """
    dfpcs = set(Registry.default().dfpcs)
    robot_by_stream = {}
    for stream, info in log.streams.items():
        robot, sensor, _ = split_stream(stream)
        if sensor != "truth" and sensor not in dfpcs and not info.is_empty:
            robot_by_stream[stream] = robot
    robots_of_log = sorted(set(robot_by_stream.values()))
    missing = sorted(set(robots or ()) - set(robots_of_log))
    if missing:
        raise InputError(f"robot {missing[0]!r}: the log holds {', '.join(robots_of_log) or 'none'}")
    chosen = [stream for stream, robot in robot_by_stream.items() if robots is None or robot in robots]
    if not chosen:
        raise InputError(f"no sensor streams to play; the log holds {', '.join(log.streams) or 'none'}")
    return chosen


def wait_for(bus: Bus, keyexprs: Collection[str], timeout_s: float, stop: threading.Event) -> None:
    """Wait until each of ``keyexprs`` matches the liveliness token of a service, or ``stop`` is set.

    Raises UnavailableError after ``timeout_s``.
    """
    deadline_s = monotonic_s() + timeout_s
    missing = list(keyexprs)
    while missing:
        missing = [k for k in missing if not bus.alive(k)]
        if missing and monotonic_s() > deadline_s:
            raise UnavailableError(f"no answer to {', '.join(missing)} after {timeout_s:g} s")
        if missing and stop.wait(0.2):
            return
