# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scripted requests: sent at their mission times, answers assessed and looked up over HTTP."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Answer, Client
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.codecs.warm import warm_wire
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.formats.geotiff import read_map
from cdff_common.geometry.region import Region, parse_region
from cdff_dev.missions.answer_assessment import faults
from cdff_dev.missions.script import TimedRequest
from cdff_dev.missions.tracks import http_json

#: Longest wait for the first tick of the clock, seconds: the player encodes ahead before it starts.
CLOCK_S = 60.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """One request and its outcome; no faults means that it was answered as requested."""

    ask: TimedRequest
    faults: tuple[str, ...]
    took_s: float
    summary: str = ""

    def __str__(self) -> str:
        mark = "FAIL" if self.faults else "ok  "
        text = "; ".join(self.faults) or self.summary
        return f"{mark} {self.took_s:5.1f} s  {self.ask.title}: {text}"


def wait_for_clock(
    bus: Bus, check: Callable[[], None], timeout_s: float = CLOCK_S
) -> tuple[MissionClock, int]:
    """Wait for the mission clock; return it and its first time."""
    clock, ticked = MissionClock(), threading.Event()

    def on_tick(message: Message) -> None:
        tick = unpack(message.payload)
        clock.on_tick(int(tick["now_ns"]), float(tick["rate"]))
        ticked.set()

    bus.subscribe(keys.CLOCK, on_tick, depth=1)
    deadline_s = time.monotonic() + timeout_s
    while not ticked.wait(0.2):
        check()
        if time.monotonic() > deadline_s:
            raise UnavailableError(f"no tick of the mission clock within {timeout_s:g} s")
    return clock, clock.now_ns()


def run_requests(
    requests: Sequence[TimedRequest],
    clock: MissionClock,
    start_ns: int,
    connect: str,
    http: str,
    on_outcome: Callable[[Outcome], None],
) -> list[Outcome]:
    """Send every request at its time, each in its own thread, and return the outcomes in the given order."""
    warm_wire()  # the age of an answer is measured on arrival: loading a codec must not add to it
    outcomes: list[Outcome | None] = [None] * len(requests)

    def ask_one(index: int, ask: TimedRequest) -> None:
        while clock.now_ns() < start_ns + int(ask.at_s * NS_PER_S):
            time.sleep(0.02)
        try:
            outcome = _send(ask, clock, connect, http)
        except Exception as error:  # noqa: BLE001  # a bug must count as a failed request
            outcome = Outcome(ask, (f"{type(error).__name__}: {error}",), 0.0)
        outcomes[index] = outcome
        on_outcome(outcome)

    threads = [
        threading.Thread(target=ask_one, args=item, name=f"ask {item[1].type}", daemon=True)
        for item in enumerate(requests)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [o for o in outcomes if o is not None]


def _send(ask: TimedRequest, clock: MissionClock, connect: str, http: str) -> Outcome:
    started_s = time.monotonic()
    try:
        with Client(connect) as client:
            answer = client.request(ask.type, **ask.parameters)
            now_ns, took_s = clock.now_ns(), time.monotonic() - started_s
            value = read_map(answer.data) if answer.value is None else answer.value
            answer_faults = list(faults(ask, value, answer.header, now_ns, _region(ask, answer, client)))
    except CdffError as error:
        return Outcome(ask, (f"{type(error).__name__}: {error}",), time.monotonic() - started_s)
    if not any(_is_found(http, id_) for id_ in (answer.header.id, *answer.header.inputs[:20])):
        answer_faults.append(f"neither product {answer.header.id} nor its inputs is available over HTTP")
    return Outcome(ask, tuple(answer_faults), took_s, _summary(answer, value))


def _region(ask: TimedRequest, answer: Answer, client: Client) -> Region | None:
    """Return the requested region; ``near`` is resolved at the end of capture, as in the orchestrator."""
    if ask.region is None:
        return None
    region = parse_region(ask.region)
    if region.near_frame is None:
        return region
    robot = region.near_frame.split("/")[0]
    pose = client.pose(robot, parent=ask.frame, child=region.near_frame, t_ns=answer.header.t1_ns)
    x, y, _ = pose.matrix[:3, 3]
    return region.resolved(float(x), float(y))


def _is_found(http: str, product_id: str) -> bool:
    try:
        return bool(http_json(http, f"products/{product_id}", timeout_s=5.0).get("id") == product_id)
    except (OSError, ValueError):
        return False


def counts_over_http(http: str) -> str:
    """Return the number of products of each kind of each robot, from the HTTP server."""
    try:
        robots = http_json(http, "status", timeout_s=10.0)["by_robot"]
    except (OSError, ValueError, KeyError) as error:
        return f"nothing ({error})"
    counts = {robot: ", ".join(f"{n} {kind}" for kind, n in kinds.items()) for robot, kinds in robots.items()}
    return "; ".join(f"{robot}: {text}" for robot, text in counts.items())


def _summary(answer: Answer, value: Any) -> str:
    delivered = answer.delivered
    parts = [type(value).__name__]
    if hasattr(value, "points_m"):
        parts.append(f"{len(value.points_m)} points")
    if hasattr(value, "stamps_ns"):
        parts.append(f"{len(value.stamps_ns)} poses")
    if delivered.get("coverage") is not None:
        parts.append(f"coverage {float(delivered['coverage']):.2f}")
    if delivered.get("age_s") is not None:
        parts.append(f"{float(delivered['age_s']):.1f} s old")
    if delivered.get("source"):
        parts.append(f"from {delivered['source']}")
    return ", ".join(parts)
