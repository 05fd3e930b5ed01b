# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Player of a log: it runs the mission clock, publishes each sample at its time, and reports its progress.

With ``patience_s`` the clock is held while the lag of a DFPC exceeds this value, so that the mission is the
same on a slow machine and only takes longer. Without it samples are published in time, as by a sensor.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from cdff_common.bus import Bus, Message, Qos, keys
from cdff_common.bus.message import unpack
from cdff_common.clock import NS_PER_S, monotonic_s
from cdff_common.errors import CdffError, InputError, UnavailableError
from cdff_dev.logs.source import LogSource, split_stream
from cdff_dev.play.backlog import Backlog
from cdff_dev.play.feed import Feed
from cdff_dev.play.gate import SensorGate
from cdff_dev.play.looped_log import LoopedLog
from cdff_dev.play.mission_clock import Pace
from cdff_dev.play.prefetch import Item
from cdff_dev.play.start import playable

logger = logging.getLogger(__name__)

CLOCK_PERIOD_S = 0.05
PROGRESS_PERIOD_S = 1.0
#: Longest time in which a seek waits until the next sample is read, seconds.
_SEEK_TIMEOUT_S = 30.0
#: Longest time in which a step waits until the samples of the previous one are published, seconds.
_STEP_TIMEOUT_S = 2.0
#: Largest delay of a sample, seconds of real time; a later one is dropped.
LATE_LIMIT_S = 1.0


@dataclass(slots=True)
class Progress:
    """Progress of the player; the body of ``event/playback``.

    Attributes
    ----------
    published, gated, dropped : int
        Numbers of samples that were sent, withheld by the mode of their sensor, and dropped as too late.
    lag_s, worst_lag_s : float
        Delay of the newest sample and largest delay, seconds.
    held_s : float
        Total time for which the clock was held, seconds.
    """

    now_ns: int = 0
    t_end_ns: int = 0
    published: int = 0
    gated: int = 0
    dropped: int = 0
    lag_s: float = 0.0
    worst_lag_s: float = 0.0
    held_s: float = 0.0
    ended: bool = False


class Player:
    """Publishes the sensor streams of a log on a bus.

    Parameters
    ----------
    speed : float
        Seconds of mission time per second.
    robots : collection of str, optional
        Robots to play, by default all.
    patience_s : float, optional
        Largest lag of a DFPC, mission seconds, above which the clock is held; None: it is never held.
    ready_ns : callable, optional
        For a log that is computed while it is played: returns the mission time up to which it is complete,
        at which the clock is held.
    ahead_bytes : int
        Size of the samples that are read and encoded ahead.
    via : mapping of str to Bus, optional
        Buses of robots with a router of their own, on which their samples are published: their sensors
        deliver without contact to the main router, too.
    is_paused : bool
        Start with the clock held until ``resume`` or ``step``.
    has_clock : bool
        Publish the mission clock; False if another program does.
    """

    def __init__(
        self,
        bus: Bus,
        log: LogSource,
        speed: float = 1.0,
        robots: Collection[str] | None = None,
        patience_s: float | None = None,
        ready_ns: Callable[[], int] | None = None,
        ahead_bytes: int = 48_000_000,
        via: Mapping[str, Bus] | None = None,
        *,
        is_paused: bool = False,
        has_clock: bool = True,
    ) -> None:
        if not 0.0 < speed < math.inf:
            raise InputError(f"speed={speed}: expected a number above 0")
        if patience_s is not None and not patience_s > 0:
            raise InputError(f"patience_s={patience_s}: expected above 0")
        self._bus, self._via = bus, dict(via or {})
        self._log = log
        self._patience_s, self._has_clock = patience_s, has_clock
        self._ready_ns = ready_ns
        self._streams = playable(log, robots)
        self._robots = sorted({split_stream(s)[0] for s in self._streams})
        unknown = sorted(set(self._via) - set(self._robots))
        if unknown:
            raise InputError(f"via {unknown[0]!r}: the robots that are played are {', '.join(self._robots)}")
        self.gate = SensorGate()
        infos = [log.streams[s] for s in self._streams]
        self.start_ns = min(i.t0_ns for i in infos)
        self.progress = Progress(now_ns=self.start_ns, t_end_ns=max(i.t1_ns for i in infos))
        self._pace = Pace(self.start_ns, speed)
        self._feed = Feed(log, self._streams, self.gate.is_on, ahead_bytes)
        self._is_paused = is_paused
        self._next_ns, self._has_next = self.start_ns, threading.Event()
        self._has_moved = threading.Condition()
        self._backlog = Backlog()

    def now_ns(self) -> int:
        """Return the mission time."""
        return self._pace.now_ns()

    def status(self) -> dict[str, Any]:
        """Return the progress with the start, the speed, and whether the player is paused and repeats."""
        self.progress.now_ns, self.progress.held_s = self.now_ns(), self._pace.held_s
        return {
            **asdict(self.progress),
            "start_ns": self.start_ns,
            "speed": self._pace.speed,
            "paused": self._is_paused,
            "loop": isinstance(self._log, LoopedLog) and self._log.is_repeated,
        }

    def pause(self) -> None:
        """Hold the clock until ``resume``."""
        self._is_paused = True
        self._pace.hold()

    def resume(self) -> None:
        """Let the clock run again."""
        self._is_paused = False
        self._hold_or_resume()

    def step(self) -> None:
        """Pause, and publish the next sample and those of the same time.

        A step waits until the samples of the previous one are published, so that each of several quick steps
        has its own.
        """
        self.pause()
        with self._has_moved:
            self._has_moved.wait_for(
                lambda: self._next_ns > self.now_ns() or self.progress.ended, _STEP_TIMEOUT_S
            )
        self._pace.advance_to(self._next_ns)

    def set_speed(self, speed: float) -> None:
        """Change the speed, seconds of mission time per second."""
        self._pace.set_speed(speed)

    def seek(self, stamp_ns: int) -> None:
        """Continue at another mission time, also an earlier one; a paused player stays paused.

        Raises InputError if the log has no such time, or is computed while it is played.
        """
        if self._ready_ns is not None:
            raise InputError("seek: this log is computed while it is played; expected a recorded log")
        if not self.start_ns <= stamp_ns <= self.progress.t_end_ns:
            last_s = (self.progress.t_end_ns - self.start_ns) / NS_PER_S
            raise InputError(
                f"seek to {(stamp_ns - self.start_ns) / NS_PER_S:g} s after the first sample: expected 0 to "
                f"{last_s:g}"
            )
        self._has_next.clear()
        self._feed.request(stamp_ns // 1000 * 1000)
        self._has_next.wait(_SEEK_TIMEOUT_S)

    def set_loop(self, is_repeated: bool) -> None:
        """Repeat the log after its end, or end after the current lap; raises InputError if it cannot be."""
        if not isinstance(self._log, LoopedLog):
            raise InputError("loop: this log is computed while it is played; expected a recorded log")
        self._log.is_repeated = is_repeated
        last_ns = max(info.t1_ns for info in self._log.streams.values())
        self.progress.t_end_ns = last_ns if is_repeated else self._log.lap_end_ns(self.now_ns())
        if is_repeated and self.progress.ended:
            self.seek(self._next_ns + 1000)

    def run(self, stop: threading.Event, stay: bool = True) -> Progress:
        """Play the log to its end; if ``stay``, keep the clock running until ``stop`` is set."""
        self._follow_modes(stop)
        if self._patience_s is not None:
            for bus in (self._bus, *self._via.values()):
                bus.subscribe(keys.dfpc_status("*", "*"), self._on_status)
        items = self._feed.items_from(self.start_ns)
        self._pace.start()
        if self._is_paused:
            self._pace.hold()
        clock_thread = threading.Thread(target=self._tick, args=(stop,), name="clock", daemon=True)
        clock_thread.start()
        try:
            while True:
                self._play(items, stop)
                position_ns = self._next_position_ns(stop, stay)
                if position_ns is None:
                    break
                items = self._feed.items_from(position_ns)
        finally:
            stop.set()
            self._has_next.set()
            self._feed.close()
            clock_thread.join(2.0)
        return self.progress

    def _next_position_ns(self, stop: threading.Event, stay: bool) -> int | None:
        """Return the stamp from which the log is played next; None if the player ends.

        After the end of the log it waits for a seek if ``stay``.
        """
        if not stop.is_set() and not self._feed.is_requested:
            if isinstance(self._log, LoopedLog) and self._log.is_repeated:
                return self._next_ns + 1000  # repetition was switched on after the last sample was read
            self.progress.ended = True
            self._has_next.set()
            logger.info("played", extra=asdict(self.progress))
            while stay and not self._feed.is_requested and not stop.wait(CLOCK_PERIOD_S):
                pass
        if stop.is_set() or (position_ns := self._feed.take_request()) is None:
            return None
        self.progress.ended = False
        self.gate.clear_times()
        self._pace.hold()
        self._pace.jump_to(position_ns)
        return position_ns

    def _play(self, items: Iterator[Item], stop: threading.Event) -> None:
        """Send the items in time until they end or ``stop`` is set."""
        for item in items:
            if item.stamp_ns > self.progress.t_end_ns and self._ready_ns is None:
                return  # repetition was switched off after the next lap was read
            with self._has_moved:
                self._next_ns = item.stamp_ns
                self._has_moved.notify_all()
            if self._feed.is_ready:
                self._has_next.set()
            if not self._pace.wait_until(item.stamp_ns, stop, lambda: self._feed.is_requested):
                return
            if not self.gate.passes(item.robot, item.sensor, item.stream, item.stamp_ns):
                self.progress.gated += 1
                continue
            if self._pace.late_s(item.stamp_ns) > LATE_LIMIT_S:
                self.progress.dropped += 1
                continue
            self._via.get(item.robot, self._bus).publish(
                item.key, item.encoded(), encoding=item.encoding, attachment=item.attachment, qos=Qos.STREAM
            )
            self.progress.published += 1
            self.progress.lag_s = self._pace.late_s(item.stamp_ns)
            self.progress.worst_lag_s = max(self.progress.worst_lag_s, self.progress.lag_s)

    def _tick(self, stop: threading.Event) -> None:
        """Publish the mission clock, and the progress every second."""
        reported_s = monotonic_s()
        while True:
            self._hold_or_resume()
            if self._has_clock:
                tick = {"now_ns": self.now_ns(), "rate": self._pace.rate}
                self._bus.publish_map(keys.CLOCK, tick, qos=Qos.POSE)
            if monotonic_s() - reported_s >= PROGRESS_PERIOD_S:
                reported_s = monotonic_s()
                self.progress.now_ns, self.progress.held_s = self.now_ns(), self._pace.held_s
                self._bus.publish_map(keys.event(keys.GROUND, "playback"), asdict(self.progress))
            if stop.wait(CLOCK_PERIOD_S):
                return

    def _hold_or_resume(self) -> None:
        """Hold the clock while paused, at the end of a growing log, and while a DFPC lags.

        It is resumed when the lag is at most half of ``patience_s``.
        """
        now_ns = self.now_ns()
        lag_s = 0.0 if self._patience_s is None else self._backlog.lag_s(now_ns)
        is_lagging = self._patience_s is not None and lag_s > self._patience_s
        is_waiting = self._is_paused or not self._feed.is_ready
        if is_waiting or is_lagging or self._is_at_end_of_growing_log(now_ns):
            self._pace.hold()
        elif self._patience_s is None or lag_s <= self._patience_s / 2:
            self._pace.resume()

    def _is_at_end_of_growing_log(self, now_ns: int) -> bool:
        """Return True if the clock would pass the end of a growing log before the next tick."""
        if self._ready_ns is None:
            return False
        return self._ready_ns() < now_ns + int(2.0 * CLOCK_PERIOD_S * self._pace.speed * NS_PER_S)

    def _on_status(self, message: Message) -> None:
        try:
            self._backlog.on_status(message.key, unpack(message.payload))
        except (CdffError, AttributeError) as error:
            logger.warning("%s: %s", message.key, error)

    def _follow_modes(self, stop: threading.Event) -> None:
        """Follow the sensor modes of each robot, by events.

        Read all modes now and whenever its ICU starts.
        """
        icu_started = threading.Event()

        def on_icu(_: str, is_alive: bool) -> None:
            if is_alive:
                icu_started.set()

        for robot in self._robots:
            self._bus.subscribe(keys.event(robot, "sensor_mode"), self._on_mode)
            self._bus.watch_alive(keys.alive(robot, "icu"), on_icu)
        self._read_modes()
        threading.Thread(
            target=self._read_modes_again, args=(icu_started, stop), name="modes", daemon=True
        ).start()

    def _read_modes_again(self, icu_started: threading.Event, stop: threading.Event) -> None:
        while not stop.is_set():
            if icu_started.wait(0.5):
                icu_started.clear()
                self._read_modes()

    def _read_modes(self) -> None:
        """Set the modes of the sensors that the instrument control units report."""
        for robot in self._robots:
            try:
                sensors = self._bus.call(keys.icu_rpc(robot, "modes"), timeout_s=2.0).body()["sensors"]
                for sensor, body in sensors.items():
                    self.gate.set(robot, sensor, body)
            except UnavailableError:
                logger.info(
                    "no instrument control unit answers for %s: its sensors keep their modes (initially: on)",
                    robot,
                )
            except (CdffError, KeyError, TypeError, AttributeError) as error:
                logger.warning("modes of %s: %s", robot, error)

    def _on_mode(self, message: Message) -> None:
        robot = message.key.split("/")[2]
        try:
            body = unpack(message.payload)
            self.gate.set(robot, str(body["sensor"]), body)
        except (CdffError, KeyError, TypeError) as error:
            logger.warning("%s: %s", message.key, error)
