# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a demonstration: asks by the script while the log plays, judges each answer, looks it up over HTTP."""

from __future__ import annotations

import json
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Answer, Client
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.codecs.warm import warm_wire
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import Header
from cdff_dev.demo.script import Ask, Script
from cdff_dev.demo.verdict import Delivered, faults

#: The clock must tick within this after the player was started: it encodes ahead first.
CLOCK_S = 60.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """One request and what came of it; no faults means that it was answered as asked."""

    ask: Ask
    faults: tuple[str, ...]
    took_s: float
    product_id: str = ""
    summary: str = ""


def wait_for_clock(bus: Bus, check: Callable[[], None], timeout_s: float = CLOCK_S) -> tuple[MissionClock, int]:
    """Return the mission clock and the time at which it was first seen, once somebody publishes it."""
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
            raise UnavailableError(f"the player's clock does not tick after {timeout_s:g} s")
    return clock, clock.now_ns()


def run_script(
    script: Script, clock: MissionClock, begin_ns: int, connect: str, http: str, on_outcome: Callable[[Outcome], None]
) -> list[Outcome]:
    """Send every request at its time, each in a thread of its own, and return the outcomes in the script's order."""
    warm_wire()  # an answer's age is judged when it is in hand: loading a codec must not make it older
    outcomes: list[Outcome | None] = [None] * len(script.requests)

    def ask_one(index: int, ask: Ask) -> None:
        while clock.now_ns() < begin_ns + int(ask.at_s * NS_PER_S):
            time.sleep(0.02)
        try:
            outcome = _ask(ask, clock, connect, http)
        except Exception as error:  # noqa: BLE001  # a bug must not take the request out of the count
            outcome = Outcome(ask, (f"{type(error).__name__}: {error}",), 0.0)
        outcomes[index] = outcome
        on_outcome(outcome)

    threads = [
        threading.Thread(target=ask_one, args=item, name=f"ask {item[1].type}", daemon=True)
        for item in enumerate(script.requests)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [o for o in outcomes if o is not None]


def _ask(ask: Ask, clock: MissionClock, connect: str, http: str) -> Outcome:
    started_s = time.monotonic()
    try:
        with Client(connect) as client:
            answer = client.request(ask.type, **ask.parameters)
            now_ns = clock.now_ns()
            took_s = time.monotonic() - started_s
            header = answer.header
            delivered = Delivered(_value_of(answer), header.frame, header.child, header.t1_ns)
            found = faults(ask, delivered, now_ns, _region(ask, answer, client))
    except CdffError as error:
        return Outcome(ask, (f"{type(error).__name__}: {error}",), time.monotonic() - started_s)
    found += _http_faults(http, answer.header)
    return Outcome(ask, tuple(found), took_s, answer.header.id, summary_of(answer, delivered.value))


def _region(ask: Ask, answer: Answer, client: Client) -> Region | None:
    """The region asked for; ``near`` is resolved at the end of capture, as the orchestrator is to do."""
    if ask.region is None:
        return None
    region = parse_region(ask.region)
    if region.near_frame is None:
        return region
    robot = region.near_frame.split("/")[0]
    pose = client.pose(robot, parent=ask.frame, child=region.near_frame, t_ns=answer.header.t1_ns)
    x, y, _ = pose.matrix[:3, 3]
    return region.resolved(float(x), float(y))


def _value_of(answer: Answer) -> Any:
    """The value in hand: decoded, or a GeoTIFF read back."""
    if answer.value is not None:
        return answer.value
    from cdff_common.formats.geotiff import read_map

    return read_map(answer.data)


def _http_faults(http: str, header: Header) -> list[str]:
    """What keeps a ground operator from finding the product behind an answer, or what that was made from."""
    found = [product_id for product_id in (header.id, *header.inputs[:20]) if _is_found(http, product_id)]
    if not found:
        return [f"neither product {header.id} nor what it was made from is found over HTTP"]
    return []


def _is_found(http: str, product_id: str) -> bool:
    try:
        with urllib.request.urlopen(f"http://{http}/api/v1/products/{product_id}", timeout=5) as response:
            return bool(json.load(response).get("id") == product_id)
    except (urllib.error.URLError, TimeoutError, ValueError):
        return False


def found_over_http(http: str) -> str:
    """How many products of which kind each robot has, as the HTTP server says."""
    try:
        with urllib.request.urlopen(f"http://{http}/api/v1/status", timeout=10) as response:
            robots = json.load(response)["by_robot"]
    except (urllib.error.URLError, TimeoutError, ValueError, KeyError) as error:
        return f"nothing ({error})"
    counts = {robot: ", ".join(f"{n} {kind}" for kind, n in kinds.items()) for robot, kinds in robots.items()}
    return "; ".join(f"{robot}: {text}" for robot, text in counts.items())


def summary_of(answer: Answer, value: Any) -> str:
    """The answer in a few words."""
    delivered = answer.delivered
    parts = [type(value).__name__]
    if hasattr(value, "points_m"):
        parts.append(f"{len(value.points_m)} points")
    if hasattr(value, "stamps_ns"):
        parts.append(f"{len(value.stamps_ns)} poses")
    if "coverage" in delivered and delivered["coverage"] is not None:
        parts.append(f"coverage {float(delivered['coverage']):.2f}")
    if "age_s" in delivered and delivered["age_s"] is not None:
        parts.append(f"{float(delivered['age_s']):.1f} s old")
    if delivered.get("source"):
        parts.append(f"from {delivered['source']}")
    return ", ".join(parts)
