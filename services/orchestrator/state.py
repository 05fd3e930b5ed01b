# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the orchestrator knows and wants, behind one lock that wakes whoever waits for a change."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from typing import Any

from cdff_common.clock import monotonic_s
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.catalogue import description_of, feeds_of, uses_of, world_of
from cdff_core.orchestration.leases import ALWAYS, Leases
from cdff_core.orchestration.planner import plan
from cdff_core.orchestration.reconcile import Action, Observed, dependency_order, next_actions
from cdff_core.orchestration.world import MakerId, SensorId, World

#: How long a mode that the instrument control unit refused is not asked for again, seconds.
REFUSAL_S = 30.0
#: A DFPC that has been active for this long has got over its failures.
HEALTHY_S = 5.0


class State:
    """Descriptions, observations and leases of all robots of a profile.

    Every method takes the lock; ``version`` grows with each change and ``wait`` returns when it has.
    """

    def __init__(self, profile: Profile) -> None:
        registry = Registry.default()
        entries = [(robot.id, entry) for robot in profile.robots for entry in robot.dfpcs]
        self.profile = profile
        self.version = 0
        self._changed = threading.Condition()
        self._observed = Observed()
        self._refused: dict[tuple[SensorId, str], float] = {}
        self._inserted: dict[str, int] = {}
        self._changed_modes: set[SensorId] = set()
        self._active_since_s: dict[MakerId, float] = {}
        self._descriptions: dict[MakerId, Mapping[str, Any]] = {
            MakerId(robot, e.name): description_of(robot, e, registry.dfpc(e.name)) for robot, e in entries
        }
        self._leases = Leases({MakerId(robot, e.name): e.linger_s for robot, e in entries})
        for robot, entry in entries:
            if entry.activation == "always":
                modes = {SensorId(robot, sensor): mode for sensor, mode in entry.modes.items()}
                self._leases.acquire(ALWAYS, [MakerId(robot, entry.name)], modes)

    # -- waiting ----------------------------------------------------------------------------------------------------

    def touch(self) -> None:
        """Say that something changed."""
        with self._changed:
            self._touch()

    def wait(self, seen: int, timeout_s: float) -> int:
        """Return the version once it differs from ``seen``, or after ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self.version != seen, timeout=max(timeout_s, 0.0))
            return self.version

    def _touch(self) -> None:
        self.version += 1
        self._changed.notify_all()

    # -- what is seen -------------------------------------------------------------------------------------------------

    def knows(self, maker: MakerId) -> bool:
        """Whether the profile has it."""
        return maker in self._descriptions

    def described(self, maker: MakerId, description: Mapping[str, Any]) -> None:
        """Take a DFPC's own description."""
        with self._changed:
            self._descriptions[maker] = description
            self._touch()

    def seen_alive(self, maker: MakerId, alive: bool) -> None:
        """A liveliness token came or went; what has gone is not active any more."""
        with self._changed:
            (self._observed.alive.add if alive else self._observed.alive.discard)(maker)
            if not alive:
                self._observed.active.discard(maker)
                self._active_since_s.pop(maker, None)
            else:
                self._observed.succeeded(maker)
            self._touch()

    def seen_state(self, maker: MakerId, state: str, last_error: str = "") -> None:
        """A DFPC said which state it is in."""
        with self._changed:
            was, now_s = maker in self._observed.active, monotonic_s()
            if state == "active":
                self._observed.active.add(maker)
                since_s = self._active_since_s.setdefault(maker, now_s)
                if now_s - since_s > HEALTHY_S:
                    self._observed.succeeded(maker)
            else:
                self._observed.active.discard(maker)
                self._active_since_s.pop(maker, None)
                if state == "error" and was:
                    self._observed.attempt(maker).failed(last_error or "it went into error", now_s)
            if was != (maker in self._observed.active):
                self._touch()

    def seen_mode(self, sensor: SensorId, mode: str) -> None:
        """The instrument control unit confirmed a mode."""
        with self._changed:
            if self._observed.modes.get(sensor) != mode:
                self._observed.modes[sensor] = mode
                self._touch()

    def seen_inserted(self, product: str) -> None:
        """The DPM has a new product."""
        with self._changed:
            self._inserted[product] = self._inserted.get(product, 0) + 1
            self._touch()

    def inserted(self, products: Iterable[str]) -> int:
        """How many products of some kinds were seen to be inserted."""
        with self._changed:
            return sum(self._inserted.get(p, 0) for p in products)

    def failed(self, what: MakerId | SensorId, reason: str) -> None:
        """An activation or mode change failed; it is tried again after a back-off."""
        with self._changed:
            self._observed.attempt(what).failed(reason, monotonic_s())
            self._touch()

    def refused(self, sensor: SensorId, mode: str) -> None:
        """The instrument control unit refused a mode; for a while plans go without it."""
        with self._changed:
            self._refused[sensor, mode] = monotonic_s() + REFUSAL_S
            self._touch()

    def succeeded(self, what: MakerId | SensorId) -> None:
        """A mode change worked."""
        with self._changed:
            self._observed.succeeded(what)
            self._touch()

    def changed_mode(self, sensor: SensorId) -> None:
        """Remember that this orchestrator changed a sensor's mode: it sets it back when nobody needs the sensor."""
        with self._changed:
            if sensor.robot in self.profile.robot_ids and sensor.sensor in self.profile.robot(sensor.robot).sensors:
                self._changed_modes.add(sensor)

    def own(self, maker: MakerId, owned: bool) -> None:
        """Remember whether this orchestrator activated a DFPC, which is what it may deactivate."""
        with self._changed:
            (self._observed.owned.add if owned else self._observed.owned.discard)(maker)

    # -- what is wanted -----------------------------------------------------------------------------------------------

    def acquire(self, holder: str, makers: Iterable[MakerId], modes: Mapping[SensorId, str]) -> None:
        """Let a holder keep makers on and sensors in modes."""
        with self._changed:
            self._leases.acquire(holder, makers, modes)
            self._touch()

    def release(self, holder: str) -> None:
        """Let go of what a holder has."""
        with self._changed:
            self._leases.release(holder, monotonic_s())
            self._touch()

    def actions(self) -> tuple[list[Action], float | None]:
        """What to do now, and when to look again (monotonic seconds) if nothing changes before."""
        with self._changed:
            now_s = monotonic_s()
            self._leases.expire(now_s)
            world = self._world(hopeful=True)
            feeds = feeds_of(world)
            wanted = dependency_order(sorted(self._leases.wanted), feeds)
            modes = {**self._idle_modes(), **self._leases.wanted_modes()}
            actions = next_actions(wanted, modes, uses_of(world), feeds, self._observed, now_s)
            times = [a.not_before_s for a in self._observed.attempts.values() if a.not_before_s > now_s]
            expiry_s = self._leases.next_expiry_s()
            return actions, min([*times, *([] if expiry_s is None else [expiry_s])], default=None)

    # -- what jobs ask ------------------------------------------------------------------------------------------------

    def world(self, *, hopeful: bool = False) -> World:
        """The planner's view of now."""
        with self._changed:
            return self._world(hopeful=hopeful)

    def progress(self, makers: Iterable[MakerId], modes: Mapping[SensorId, str]) -> dict[str, Any]:
        """How far a plan is: what runs, what is still missing, and failures in a row with their reasons."""
        with self._changed:
            makers = list(makers)
            o = self._observed
            return {
                "missing": [str(m) for m in makers if m not in o.active],
                "dead": [str(m) for m in makers if m not in o.alive],
                "modes_missing": [str(s) for s, mode in modes.items() if o.modes.get(s) != mode],
                "failures": {
                    str(x): (a.failures, a.reason) for x, a in o.attempts.items() if x in makers or x in modes
                },
            }

    def catalogue(self, robots: Iterable[str]) -> dict[str, Any]:
        """What there is and what it could make, as plain data."""
        robots = set(robots)
        with self._changed:
            world, o = self._world(), self._observed
            makers = [
                {
                    **self._descriptions[m],
                    "alive": m in o.alive,
                    "active": m in o.active,
                    "failures": o.attempts[m].failures if m in o.attempts else 0,
                    "last_failure": o.attempts[m].reason if m in o.attempts else "",
                }
                for m in sorted(world.makers)
                if m.robot in robots
            ]
            sensors = [
                {
                    "robot": s.id.robot,
                    "sensor": s.id.sensor,
                    "mode": s.current,
                    "held": s.held,
                    "modes": sorted(s.modes),
                    "refused": sorted(s.refused),
                }
                for s in world.sensors.values()
                if s.id.robot in robots
            ]
            leases = [x for x in self._leases.describe() if str(x["dfpc"]).partition("/")[0] in robots]
        products = []
        for robot in sorted(robots):
            for product in sorted({p for m in world.makers.values() if m.id.robot == robot for p in m.products}):
                found = plan(world, product, [robot])
                entry: dict[str, Any] = {"type": product, "robot": robot}
                entry |= {"plan": found.describe()} if hasattr(found, "describe") else {"why_not": found.text}
                products.append(entry)
        return {"dfpcs": makers, "sensors": sensors, "leases": leases, "products": products}

    def leases(self) -> list[dict[str, Any]]:
        """Who holds what."""
        with self._changed:
            return self._leases.describe()

    def _idle_modes(self) -> dict[SensorId, str]:
        """Initial modes of the sensors that were changed, for those that nothing active or wanted uses any more."""
        used = {
            s
            for m, sensors in uses_of(self._world(hopeful=True)).items()
            for s in sensors
            if m in self._observed.active or m in self._leases.wanted
        }
        return {s: self.profile.robot(s.robot).sensors[s.sensor].initial_mode for s in self._changed_modes - used}

    def _world(self, *, hopeful: bool = False) -> World:
        now_s = monotonic_s()
        self._refused = {k: until_s for k, until_s in self._refused.items() if until_s > now_s}
        refused: dict[SensorId, frozenset[str]] = {}
        for sensor, mode in self._refused:
            refused[sensor] = refused.get(sensor, frozenset()) | {mode}
        return world_of(self.profile, self._descriptions, self._observed, self._leases, refused, hopeful=hopeful)
