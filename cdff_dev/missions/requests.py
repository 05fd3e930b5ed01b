# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scripted requests: they are sent at their mission times; answers are assessed and looked up over HTTP."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Answer, Client
from cdff_common.clock import NS_PER_S
from cdff_common.codecs.warm import warm_wire
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.formats.geotiff import read_map
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import Quality
from cdff_common.mission_clock import MissionClock
from cdff_common.types import Mesh, ObjectTrack
from cdff_core.orchestration.accuracy import sigmas_of
from cdff_dev.missions.answer_assessment import assess_answer
from cdff_dev.missions.script import TimedRequest
from cdff_dev.missions.tracks import http_json

#: Longest wait for the first tick of the clock, seconds: the player encodes samples before it starts the
#: clock.
CLOCK_S = 60.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a request; it has no faults if the answer satisfies the request.

    ``explanation`` is that of the orchestrator before the request, one item a line; ``answer`` is None after
    an error.
    """

    request: TimedRequest
    faults: tuple[str, ...]
    duration_s: float
    summary: str = ""
    explanation: tuple[str, ...] = ()
    answer: Answer | None = None

    @property
    def text(self) -> str:
        """The explanation of the plan, if there is one, and the outcome."""
        return "\n".join([*self.explanation, str(self)])

    def __str__(self) -> str:
        mark = "FAIL" if self.faults else "ok  "
        text = "; ".join(self.faults) or self.summary
        return f"{mark} {self.duration_s:5.1f} s  {self.request.title}: {text}"


def wait_for_clock(
    bus: Bus, check: Callable[[], None], timeout_s: float = CLOCK_S
) -> tuple[MissionClock, int]:
    """Wait for the first tick of the mission clock; return the clock and its time.

    ``check`` is called while waiting and may raise an error. Raises UnavailableError after ``timeout_s``.
    """
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
    """Send every request at its mission time, each in its own thread.

    Return the outcomes in the given order.
    """
    warm_wire()  # loading a codec must not delay an answer, whose age is measured on arrival
    outcomes: list[Outcome | None] = [None] * len(requests)

    def send_at_its_time(index: int, request: TimedRequest) -> None:
        while clock.now_ns() < start_ns + int(request.at_s * NS_PER_S):
            time.sleep(0.02)
        try:
            outcome = send_request(request, clock, connect, http)
        except Exception as error:  # noqa: BLE001  # a bug must count as a failed request
            outcome = Outcome(request, (f"{type(error).__name__}: {error}",), 0.0)
        outcomes[index] = outcome
        on_outcome(outcome)

    threads = [
        threading.Thread(target=send_at_its_time, args=item, name=f"request {item[1].type}", daemon=True)
        for item in enumerate(requests)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [o for o in outcomes if o is not None]


def send_request(request: TimedRequest, clock: MissionClock, connect: str, http: str) -> Outcome:
    """Send a request at once and return its outcome with the faults of the answer."""
    start_s = time.monotonic()
    explanation: tuple[str, ...] = ()
    try:
        with Client(connect) as client:
            if request.explain:
                explanation = tuple(plan_lines(client.explain(request.type, **request.parameters)))
                start_s = time.monotonic()
            answer = client.request(request.type, **request.parameters)
            now_ns, duration_s = clock.now_ns(), time.monotonic() - start_s
            value = read_map(answer.data) if answer.value is None else answer.value
            region = _region(request, answer, client)
            faults = list(assess_answer(request, value, answer.header, now_ns, region))
    except CdffError as error:
        faults = [f"{type(error).__name__}: {error}"]
        return Outcome(request, tuple(faults), time.monotonic() - start_s, explanation=explanation)
    if not any(_is_available(http, id_) for id_ in (answer.header.id, *answer.header.inputs[:20])):
        faults.append(f"neither product {answer.header.id} nor its inputs is available over HTTP")
    return Outcome(request, tuple(faults), duration_s, _summary(answer, value), explanation, answer)


def plan_lines(explanation: dict[str, Any]) -> list[str]:
    """Return an explanation of the orchestrator as lines: the plan, its sources and sensor modes."""
    plan, lines = explanation["plan"], []
    if plan is None:
        return [f"     no plan: {'; '.join(explanation['why_not'])}"]
    sources = plan["sources"]
    for part in plan["order"]:
        ports = ", ".join(f"{port} from {source}" for port, source in sorted(sources.get(part, {}).items()))
        lines.append(f"     plan: {part}{f' ({ports})' if ports else ''}")
    changes = [f"{sensor} {old} -> {new}" for sensor, (old, new) in sorted(plan["changes"].items())]
    lines += [f"     sensor modes: {', '.join(changes)}"] if changes else []
    for item in explanation.get("accuracy", ()):
        unmet = f": {'; '.join(item['unmet'])}" if item["unmet"] else ": meets the bounds"
        lines.append(f"     newest product of {item['provider']}{unmet}")
    return lines


def _region(request: TimedRequest, answer: Answer, client: Client) -> Region | None:
    """Return the requested region.

    ``near:`` is replaced by a circle around the position at the end of capture, as in the orchestrator.
    """
    if request.region is None:
        return None
    region = parse_region(request.region)
    if region.near_frame is None:
        return region
    robot = region.near_frame.split("/")[0]
    pose = client.pose(robot, parent=request.frame, child=region.near_frame, t_ns=answer.header.t1_ns)
    x, y, _ = pose.matrix[:3, 3]
    return region.resolved(float(x), float(y))


def _is_available(http: str, product_id: str) -> bool:
    """Return whether the DPM serves a product by HTTP."""
    try:
        return bool(http_json(http, f"products/{product_id}", timeout_s=5.0).get("id") == product_id)
    except (OSError, ValueError):
        return False


def counts_over_http(http: str) -> str:
    """Return a text with the number of products of each robot by kind, from the HTTP server."""
    try:
        counts_of = http_json(http, "status", timeout_s=10.0)["by_robot"]
    except (OSError, ValueError, KeyError) as error:
        return f"nothing ({error})"
    return "; ".join(
        f"{robot}: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())
        for robot, counts in counts_of.items()
    )


def _summary(answer: Answer, value: Any) -> str:
    """Return a line that describes an answer."""
    delivered = answer.delivered
    parts = [type(value).__name__]
    if hasattr(value, "points_m"):
        parts.append(f"{len(value.points_m)} points")
    if isinstance(value, ObjectTrack):
        has_bearings = len(value.data.bearings) > 0
        parts.append(_bearing_text(value, answer.header.quality) if has_bearings else _pose_text(value))
    elif isinstance(value, Mesh):
        parts.append(f"{len(value.data.triangles)} triangles in {value.metadata.frame_id}")
    elif hasattr(value, "stamps_ns"):
        parts.append(f"{len(value.stamps_ns)} poses")
    if delivered.get("coverage") is not None:
        parts.append(f"coverage {float(delivered['coverage']):.2f}")
    if delivered.get("age_s") is not None:
        parts.append(f"{float(delivered['age_s']):.1f} s old")
    if delivered.get("source"):
        parts.append(f"from {delivered['source']}")
    return ", ".join(parts)


def _pose_text(track: ObjectTrack) -> str:
    """Return the distance and the angular rate of a tracked body, with standard deviations if known."""
    distance_m = float(np.linalg.norm(track.data.poses[-1, :3]))
    sigma_m, sigma_deg = sigmas_of(track)
    text = f"{track.metadata.label} at {distance_m:.2f} m"
    if sigma_m is not None and sigma_deg is not None:
        text += f" ± {1000.0 * sigma_m:.0f} mm, attitude ± {sigma_deg:.2f}°"
    if len(track.data.velocities):
        rate_deg_s = math.degrees(float(np.linalg.norm(track.data.velocities[-1, 3:])))
        text += f", rotating at {rate_deg_s:.2f} °/s"
    return text


def _bearing_text(track: ObjectTrack, quality: Quality) -> str:
    """Return the newest direction of an object and, if known, its range, with standard deviations.

    A range that is not informative is given with its interval.
    """
    azimuth, elevation, sigma_a, sigma_e, range_m, sigma_m = track.data.bearings[-1].tolist()
    text = (
        f"{track.metadata.label} at {math.degrees(azimuth):.4f}°, {math.degrees(elevation):.4f}° "
        f"± {math.degrees(max(sigma_a, sigma_e)) * 3600:.0f}″"
    )
    if not math.isfinite(range_m):
        return f"{text}, range unobservable"
    text = f"{text}, {range_m:.0f} ± {sigma_m:.0f} m"
    if not any(reason.startswith("range_uninformative") for reason in quality.reasons):
        return text
    low, high = (quality.metrics.get(name, math.nan) for name in ("range_low_m", "range_high_m"))
    return f"{text} (range between {low:.0f} and {high:.0f} m: not informative)"
