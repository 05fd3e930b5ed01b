# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The player on a real bus: clock, samples, modes, end."""

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
from cdff_dev.play.player import Player, playable, wait_for

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
    """One second: images at 10 Hz, wheel poses at 20 Hz, and truth that nobody may be given."""
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
    opened = open_log(tmp_path / "log")
    yield opened
    opened.close()


class Ears:
    """What came over a bus."""

    def __init__(self, bus: Bus) -> None:
        self.samples: list[Message] = []
        self.ticks: list[dict[str, float]] = []
        bus.subscribe("cdff/@v1/*/sensor/**", self.samples.append, depth=1000)
        bus.subscribe(keys.CLOCK, lambda m: self.ticks.append(unpack(m.payload)), depth=1000)

    def of(self, sensor: str) -> list[Message]:
        return [m for m in self.samples if f"/sensor/{sensor}/" in m.key]


def until(condition: Callable[[], bool]) -> None:
    deadline_s = monotonic_s() + DEADLINE_S
    tick = threading.Event()
    while not condition():
        assert monotonic_s() < deadline_s, "the awaited did not happen"
        tick.wait(0.02)


def test_every_sensor_sample_arrives_as_recorded_with_the_clock_and_no_truth(endpoint: str, log: LogSource) -> None:
    with Bus.open(endpoint, name="ears") as ears_bus, Bus.open(endpoint, name="player") as bus:
        ears = Ears(ears_bus)
        progress = Player(bus, log, speed=4.0).run(threading.Event(), stay=False)
        assert progress.ended
        assert (progress.published, progress.dropped) == (32, 0)
        until(lambda: len(ears.samples) == 32)
        assert ears.of("truth") == []
        third = decode("Frame", ears.of("navcam")[3].payload, "uper")
        assert (third.image[0, 0], third.stamp_ns) == (6, T0 + 300 * MS)
        assert ears.ticks[0]["rate"] == 4.0
        nows = [t["now_ns"] for t in ears.ticks]
        assert nows == sorted(nows)
        assert nows[0] >= T0


def test_the_clock_runs_on_after_the_end_until_it_is_stopped(endpoint: str, log: LogSource) -> None:
    stop = threading.Event()
    with Bus.open(endpoint, name="ears") as ears_bus, Bus.open(endpoint, name="player") as bus:
        ears = Ears(ears_bus)
        player = Player(bus, log, speed=20.0)
        running = threading.Thread(target=player.run, args=(stop,))
        running.start()
        until(lambda: bool(ears.ticks) and ears.ticks[-1]["now_ns"] > T0 + 5_000 * MS)
        assert player.progress.ended
        stop.set()
        running.join(DEADLINE_S)
        assert not running.is_alive()


def test_a_sensor_the_icu_switched_off_is_silent_and_one_it_slows_is_thinned(endpoint: str, log: LogSource) -> None:
    modes = {"navcam": {"on": False, "rate_hz": None}, "wheels": {"on": True, "rate_hz": 5.0}}
    with Bus.open(endpoint, name="icu") as icu, Bus.open(endpoint, name="player") as bus:
        icu.serve(keys.icu_rpc("mana", "modes"), lambda _: Reply.of({"robot": "mana", "sensors": modes}))
        ears = Ears(icu)
        progress = Player(bus, log, speed=4.0).run(threading.Event(), stay=False)
        assert (progress.published, progress.gated) == (6, 26)
        until(lambda: len(ears.samples) == 6)
        assert ears.of("navcam") == []


def test_a_mode_event_during_play_takes_effect(endpoint: str, log: LogSource) -> None:
    modes = {"navcam": {"on": False, "rate_hz": None}}
    stop = threading.Event()
    with Bus.open(endpoint, name="icu") as icu, Bus.open(endpoint, name="player") as bus:
        icu.serve(keys.icu_rpc("mana", "modes"), lambda _: Reply.of({"robot": "mana", "sensors": modes}))
        ears = Ears(icu)
        player = Player(bus, log, speed=0.5)
        running = threading.Thread(target=player.run, args=(stop, False))
        running.start()
        until(lambda: len(ears.of("wheels")) > 2)
        icu.publish_map(
            keys.event("mana", "sensor_mode"), {"sensor": "navcam", "mode": "nominal", "on": True, "rate_hz": None}
        )
        until(lambda: len(ears.of("navcam")) > 0)
        stop.set()
        running.join(DEADLINE_S)


def test_it_waits_for_those_it_is_told_to_wait_for_and_says_who_did_not_come(endpoint: str) -> None:
    with Bus.open(endpoint, name="host") as host, Bus.open(endpoint, name="player") as bus:
        host.declare_alive("mana", "position_manager")
        wait_for(bus, ["cdff/@v1/mana/@alive/position_manager"], DEADLINE_S, threading.Event())
        with pytest.raises(UnavailableError, match="minnie"):
            wait_for(bus, ["cdff/@v1/minnie/@alive/icu"], 0.1, threading.Event())


def test_a_robot_that_is_not_in_the_log_is_refused(log: LogSource) -> None:
    with pytest.raises(InputError, match="mana"):
        playable(log, ["rosalind"])


def test_a_patient_clock_stands_still_while_a_dfpc_is_behind(endpoint: str, log: LogSource) -> None:
    with Bus.open(endpoint, name="dfpc") as dfpc, Bus.open(endpoint, name="player") as bus:
        ears, stop = Ears(dfpc), threading.Event()
        player = Player(bus, log, patience_s=0.2)
        running = threading.Thread(target=player.run, args=(stop, False))
        behind = {"state": "active", "oldest_ns": T0 + 100 * MS}
        running.start()
        until(lambda: bool(ears.of("wheels")))
        until(lambda: _told(dfpc, behind) and bool(ears.ticks) and ears.ticks[-1]["rate"] == 0.0)
        stood_ns = player.now_ns()
        assert stood_ns < T0 + 1_000 * MS
        heard = len(ears.ticks)
        until(lambda: _told(dfpc, behind) and len(ears.ticks) >= heard + 5)
        assert player.now_ns() == stood_ns
        until(lambda: _told(dfpc, {"state": "active", "oldest_ns": None}) and not running.is_alive())
        assert (player.progress.published, player.progress.dropped, player.progress.ended) == (32, 0, True)


def _told(bus: Bus, status: dict[str, object]) -> bool:
    bus.publish_map(keys.dfpc_status("mana", "mapper"), status)
    return True


def test_sensors_of_a_robot_with_a_router_of_its_own_deliver_there_out_of_contact_too(
    endpoint: str, log: LogSource
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        aboard = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with (
        Bus.open_router(aboard),
        Bus.open(endpoint, name="ground") as ground,
        Bus.open(aboard, name="rover") as rover,
        Bus.open(endpoint, name="player") as bus,
        Bus.open(aboard, name="player") as via,
    ):
        on_ground, on_rover = Ears(ground), Ears(rover)
        with pytest.raises(InputError, match="via 'minnie'"):
            Player(bus, log, via={"minnie": via})
        Player(bus, log, speed=4.0, via={"mana": via}).run(threading.Event(), stay=False)
        until(lambda: len(on_rover.samples) == 32)
        assert on_ground.samples == []
        assert on_ground.ticks


def test_the_clock_stands_where_a_log_is_not_made_yet_and_goes_on_when_it_is(endpoint: str, log: LogSource) -> None:
    made_ns = T0 + 500 * MS
    stop = threading.Event()
    with Bus.open(endpoint, name="ears") as ears_bus, Bus.open(endpoint, name="player") as bus:
        ears = Ears(ears_bus)
        player = Player(bus, log, speed=2.0, ready_ns=lambda: made_ns)
        running = threading.Thread(target=player.run, args=(stop, False))
        running.start()
        until(lambda: bool(ears.ticks) and ears.ticks[-1]["rate"] == 0.0)
        stood_at, count = ears.ticks[-1]["now_ns"], len(ears.ticks)
        until(lambda: len(ears.ticks) > count + 5)
        assert ears.ticks[-1]["now_ns"] == stood_at
        assert stood_at > T0
        assert running.is_alive()
        made_ns = T0 + 60_000 * MS
        running.join(DEADLINE_S)
        assert player.progress.ended
        assert (player.progress.published, player.progress.dropped) == (32, 0)
        assert player.progress.held_s > 0.0 or ears.ticks[-1]["now_ns"] > stood_at
