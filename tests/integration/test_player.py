# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The player on a real bus: clock, samples, sensor modes and end of the log."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, Reply, keys
from cdff_common.bus.message import unpack
from cdff_common.clock import monotonic_s
from cdff_common.codecs import decode
from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Frame, TransformWithCovariance
from cdff_dev.logs import LogSource, LogWriter, open_log
from cdff_dev.play.player import Player
from cdff_dev.play.start import playable, wait_for

T0 = 1_785_585_600_000_000_000
MS = 1_000_000
DEADLINE_S = 20.0


@pytest.fixture
def endpoint() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with Bus.open_router(f"tcp/127.0.0.1:{port}"):
        yield f"tcp/127.0.0.1:{port}"


@pytest.fixture
def log(tmp_path: Path) -> Iterator[LogSource]:
    """One second of images at 10 Hz, wheel poses at 20 Hz, and ground truth that must not be published."""
    with LogWriter(tmp_path / "log") as writer:
        for i in range(21):
            stamp_ns = T0 + i * 50 * MS
            pose = UncertainTransform(se3.transform(np.eye(3), [0.1 * i, 0, 0]))
            value = TransformWithCovariance.from_transform(
                pose, parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
            )
            writer.write("/mana/wheels.odometry", value, stamp_ns)
            writer.write("/mana/truth.pose", value, stamp_ns)
            if i % 2 == 0:
                image = np.full((8, 8), i, dtype=np.uint8)
                writer.write("/mana/navcam.image", Frame.from_image(image, stamp_ns=stamp_ns), stamp_ns)
    log = open_log(tmp_path / "log")
    yield log
    log.close()


class Listener:
    """Collects the samples and clock messages of a bus."""

    def __init__(self, bus: Bus) -> None:
        self.samples: list[Message] = []
        self.ticks: list[dict[str, float]] = []
        bus.subscribe("cdff/@v1/*/sensor/**", self.samples.append, depth=1000)
        bus.subscribe(keys.CLOCK, lambda m: self.ticks.append(unpack(m.payload)), depth=1000)

    def of(self, sensor: str) -> list[Message]:
        return [m for m in self.samples if f"/sensor/{sensor}/" in m.key]


def wait_until(condition: Callable[[], bool]) -> None:
    deadline_s = monotonic_s() + DEADLINE_S
    tick = threading.Event()
    while not condition():
        assert monotonic_s() < deadline_s, f"the condition did not hold within {DEADLINE_S:g} s"
        tick.wait(0.02)


def test_the_player_publishes_every_sensor_sample_and_the_clock_but_no_ground_truth(
    endpoint: str, log: LogSource
) -> None:
    with Bus.open(endpoint, name="listener") as listener_bus, Bus.open(endpoint, name="player") as bus:
        listener = Listener(listener_bus)
        progress = Player(bus, log, speed=4.0).run(threading.Event(), stay=False)
        assert progress.ended
        assert (progress.published, progress.dropped) == (32, 0)
        wait_until(lambda: len(listener.samples) == 32)
        assert listener.of("truth") == []
        third = decode("Frame", listener.of("navcam")[3].payload, "uper")
        assert (third.image[0, 0], third.stamp_ns) == (6, T0 + 300 * MS)
        assert listener.ticks[0]["rate"] == 4.0
        times_ns = [t["now_ns"] for t in listener.ticks]
        assert times_ns == sorted(times_ns)
        assert times_ns[0] >= T0


def test_the_clock_continues_after_the_end_until_it_is_stopped(endpoint: str, log: LogSource) -> None:
    stop = threading.Event()
    with Bus.open(endpoint, name="listener") as listener_bus, Bus.open(endpoint, name="player") as bus:
        listener = Listener(listener_bus)
        player = Player(bus, log, speed=20.0)
        running = threading.Thread(target=player.run, args=(stop,))
        running.start()
        wait_until(lambda: bool(listener.ticks) and listener.ticks[-1]["now_ns"] > T0 + 5_000 * MS)
        assert player.progress.ended
        stop.set()
        running.join(DEADLINE_S)
        assert not running.is_alive()


def test_a_sensor_switched_off_is_silent_and_one_slowed_down_is_decimated(
    endpoint: str, log: LogSource
) -> None:
    modes = {"navcam": {"on": False, "rate_hz": None}, "wheels": {"on": True, "rate_hz": 5.0}}
    with Bus.open(endpoint, name="icu") as icu, Bus.open(endpoint, name="player") as bus:
        icu.serve(keys.icu_rpc("mana", "modes"), lambda _: Reply.of({"robot": "mana", "sensors": modes}))
        listener = Listener(icu)
        progress = Player(bus, log, speed=4.0).run(threading.Event(), stay=False)
        assert (progress.published, progress.gated) == (6, 26)
        wait_until(lambda: len(listener.samples) == 6)
        assert listener.of("navcam") == []


def test_a_mode_event_during_play_takes_effect(endpoint: str, log: LogSource) -> None:
    modes = {"navcam": {"on": False, "rate_hz": None}}
    stop = threading.Event()
    with Bus.open(endpoint, name="icu") as icu, Bus.open(endpoint, name="player") as bus:
        icu.serve(keys.icu_rpc("mana", "modes"), lambda _: Reply.of({"robot": "mana", "sensors": modes}))
        listener = Listener(icu)
        player = Player(bus, log, speed=0.5)
        running = threading.Thread(target=player.run, args=(stop, False))
        running.start()
        wait_until(lambda: len(listener.of("wheels")) > 2)
        icu.publish_map(
            keys.event("mana", "sensor_mode"),
            {"sensor": "navcam", "mode": "nominal", "on": True, "rate_hz": None},
        )
        wait_until(lambda: len(listener.of("navcam")) > 0)
        stop.set()
        running.join(DEADLINE_S)


def test_the_player_waits_for_the_given_services_and_reports_missing_ones(endpoint: str) -> None:
    with Bus.open(endpoint, name="host") as host, Bus.open(endpoint, name="player") as bus:
        host.declare_alive("mana", "position_manager")
        wait_for(bus, ["cdff/@v1/mana/@alive/position_manager"], DEADLINE_S, threading.Event())
        with pytest.raises(UnavailableError, match="minnie"):
            wait_for(bus, ["cdff/@v1/minnie/@alive/icu"], 0.1, threading.Event())


def test_a_robot_that_is_not_in_the_log_is_refused(log: LogSource) -> None:
    with pytest.raises(InputError, match="mana"):
        playable(log, ["rosalind"])


def test_a_player_with_patience_stops_its_clock_while_a_dfpc_has_a_backlog(
    endpoint: str, log: LogSource
) -> None:
    with Bus.open(endpoint, name="dfpc") as dfpc, Bus.open(endpoint, name="player") as bus:
        listener, stop = Listener(dfpc), threading.Event()
        player = Player(bus, log, patience_s=0.2)
        running = threading.Thread(target=player.run, args=(stop, False))
        backlog_status = {"state": "active", "oldest_ns": T0 + 100 * MS}
        running.start()
        wait_until(lambda: bool(listener.of("wheels")))
        wait_until(
            lambda: (
                _publish_status(dfpc, backlog_status)
                and bool(listener.ticks)
                and listener.ticks[-1]["rate"] == 0.0
            )
        )
        stopped_ns = player.now_ns()
        assert stopped_ns < T0 + 1_000 * MS
        tick_count = len(listener.ticks)
        wait_until(lambda: _publish_status(dfpc, backlog_status) and len(listener.ticks) >= tick_count + 5)
        assert player.now_ns() == stopped_ns
        wait_until(
            lambda: _publish_status(dfpc, {"state": "active", "oldest_ns": None}) and not running.is_alive()
        )
        assert (player.progress.published, player.progress.dropped, player.progress.ended) == (32, 0, True)


def _publish_status(bus: Bus, status: dict[str, object]) -> bool:
    bus.publish_map(keys.dfpc_status("mana", "mapper"), status)
    return True


def test_sensor_samples_are_published_on_the_router_of_their_robot_only(
    endpoint: str, log: LogSource
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        rover_endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with (
        Bus.open_router(rover_endpoint),
        Bus.open(endpoint, name="ground") as ground,
        Bus.open(rover_endpoint, name="rover") as rover,
        Bus.open(endpoint, name="player") as bus,
        Bus.open(rover_endpoint, name="player") as via,
    ):
        on_ground, on_rover = Listener(ground), Listener(rover)
        with pytest.raises(InputError, match="via 'minnie'"):
            Player(bus, log, via={"minnie": via})
        Player(bus, log, speed=4.0, via={"mana": via}).run(threading.Event(), stay=False)
        wait_until(lambda: len(on_rover.samples) == 32)
        assert on_ground.samples == []
        assert on_ground.ticks


def test_the_clock_stops_at_the_end_of_an_unfinished_log_and_then_continues(
    endpoint: str, log: LogSource
) -> None:
    ready_ns = T0 + 500 * MS
    stop = threading.Event()
    with Bus.open(endpoint, name="listener") as listener_bus, Bus.open(endpoint, name="player") as bus:
        listener = Listener(listener_bus)
        player = Player(bus, log, speed=2.0, ready_ns=lambda: ready_ns)
        running = threading.Thread(target=player.run, args=(stop, False))
        running.start()
        wait_until(lambda: bool(listener.ticks) and listener.ticks[-1]["rate"] == 0.0)
        stopped_ns, count = listener.ticks[-1]["now_ns"], len(listener.ticks)
        wait_until(lambda: len(listener.ticks) > count + 5)
        assert listener.ticks[-1]["now_ns"] == stopped_ns
        assert stopped_ns > T0
        assert running.is_alive()
        ready_ns = T0 + 60_000 * MS
        running.join(DEADLINE_S)
        assert player.progress.ended
        assert (player.progress.published, player.progress.dropped) == (32, 0)
        assert player.progress.held_s > 0.0 or listener.ticks[-1]["now_ns"] > stopped_ns
