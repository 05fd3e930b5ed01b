# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the orchestrator knows and wants, behind one lock that wakes whoever waits for a change."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.catalogue import Measured, description_of, feeds_of, uses_of, world_of
from cdff_core.orchestration.leases import ALWAYS, ALWAYS_PRIORITY, DEFAULT_PRIORITY, Leases
from cdff_core.orchestration.offers import describe_world, offers
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.reconcile import Action, Observed, dependency_order, next_actions
from cdff_core.orchestration.request import PRODUCTS
from cdff_core.orchestration.world import MakerId, SensorId, World
from services.orchestrator.timing import REAL, Timing

#: How long a mode that the instrument control unit refused is not asked for again, seconds.
REFUSAL_S = 30.0
#: A DFPC that has been active for this long has got over its failures.
HEALTHY_S = 5.0
#: A sensor that an active DFPC got no sample of for so long, seconds, is silent.
STARVED_S = 4.0
#: A process that has been gone for so long, seconds, is planned around where that can be.
GONE_S = 3.0
#: Outputs that a DFPC may refuse in a row before it is planned around.
REFUSED_OUTPUTS = 5


class State:
    """Descriptions, observations and leases of all robots of a profile.

    Every method takes the lock; ``version`` grows with each change and ``wait`` returns when it has.
    """

    def __init__(self, profile: Profile, timing: Timing = REAL) -> None:
        registry = Registry.default()
        entries = [(robot, entry) for robot in profile.robots for entry in robot.dfpcs]
        self.profile = profile
        self.version = 0
        self._timing = timing
        self._changed = timing.condition()
        self._observed = Observed()
        self._refused: dict[tuple[SensorId, str], float] = {}
        self._inserted: dict[str, int] = {}
        self._changed_modes: set[SensorId] = set()
        self._active_since_s: dict[MakerId, float] = {}
        self._gone_since_s: dict[MakerId, float] = {}
        self._changes: dict[MakerId, int] = {}
        self._fed: dict[MakerId, dict[str, tuple[int, float]]] = {}
        self._refusals: dict[MakerId, tuple[int, int, int]] = {}
        self._measured: dict[MakerId, Measured] = {}
        self._measured_at_s: dict[MakerId, float] = {}
        self._warm_up_s = {MakerId(robot.id, e.name): e.warm_up_s for robot, e in entries}
        self._descriptions: dict[MakerId, Mapping[str, Any]] = {
            MakerId(robot.id, e.name): description_of(robot, e, registry.dfpc(e.name)) for robot, e in entries
        }
        self._leases = Leases({MakerId(robot.id, e.name): e.linger_s for robot, e in entries})
        for robot, entry in entries:
            if entry.activation == "always":
                accepts = {SensorId(robot.id, s): modes.split("|") for s, modes in robot.modes_of(entry).items()}
                modes = {s: names[0] for s, names in accepts.items()}
                maker = MakerId(robot.id, entry.name)
                self._leases.acquire(ALWAYS, [maker], modes, priority=ALWAYS_PRIORITY, accepts=accepts)

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

    def products_of(self, maker: MakerId) -> frozenset[str]:
        """What a requester can get from a DFPC."""
        with self._changed:
            return frozenset(str(o["product"]) for o in self._descriptions[maker]["outputs"] if o["product"])

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
                self._gone_since_s.setdefault(maker, self._timing.now_s())
                self._seen_inactive(maker)
                self._observed.states.pop(maker, None)
                self._changes.pop(maker, None)
                self._measured.pop(maker, None)
            else:
                self._gone_since_s.pop(maker, None)
                self._observed.succeeded(maker)
            self._touch()

    def seen_state(
        self,
        maker: MakerId,
        state: str,
        last_error: str = "",
        wired: Mapping[str, str] | None = None,
        changes: int | None = None,
    ) -> None:
        """A DFPC said which state it is in, and what feeds it.

        ``changes`` counts its changes of state: what it said before the last one, and comes late, is passed over.
        """
        with self._changed:
            if changes is not None and changes < self._changes.get(maker, 0):
                return
            if changes is not None:
                self._changes[maker] = changes
            o, now_s = self._observed, self._timing.now_s()
            was = (maker in o.active, o.states.get(maker), o.wired.get(maker))
            if state in ("unconfigured", "inactive", "active", "error"):
                o.states[maker] = state
            if state == "active":
                o.active.add(maker)
                if maker not in self._active_since_s:
                    self._active_since_s[maker] = now_s
                    self._fed.pop(maker, None)
                    self._refusals.pop(maker, None)
                    if self._warm_up_s.get(maker):
                        o.warm_at_s[maker] = now_s + self._warm_up_s[maker]
                if now_s - self._active_since_s[maker] > HEALTHY_S:
                    o.succeeded(maker)
                if wired is not None:
                    o.wired[maker] = dict(wired)
            else:
                self._seen_inactive(maker)
                if state == "error" and was[0]:
                    o.attempt(maker).failed(last_error or "it went into error", now_s)
            if was != (maker in o.active, o.states.get(maker), o.wired.get(maker)):
                self._touch()

    def _seen_inactive(self, maker: MakerId) -> None:
        self._observed.active.discard(maker)
        self._observed.warm_at_s.pop(maker, None)
        self._observed.wired.pop(maker, None)
        for known in (self._active_since_s, self._fed, self._refusals):
            known.pop(maker, None)

    def seen_status(self, maker: MakerId, status: Mapping[str, Any]) -> None:
        """A heartbeat: what the DFPC takes, what reaches it, what it refuses. Raises InputError for a malformed one."""
        with self._changed:
            now_s = self._timing.now_s()
            taken = Measured.of(status, self._measured.get(maker), now_s - self._measured_at_s.get(maker, now_s))
            self._measured[maker], self._measured_at_s[maker] = taken, now_s
            if maker not in self._active_since_s:
                return
            before = (self._starved(maker, now_s), self._refuses(maker))
            counts = status.get("samples_by_port", {})
            fed = self._fed.setdefault(maker, {})
            for port in self._sensor_ports(maker):
                count = int(counts.get(port, 0))
                if port not in fed or fed[port][0] != count:
                    fed[port] = (count, now_s)
            failed = int(status.get("failed", 0))
            good = int(status.get("outputs", 0)) - failed
            last = self._refusals.get(maker)
            since = failed if last is None or last[1] != good else last[0]
            self._refusals[maker] = (since, good, failed)
            if before != (self._starved(maker, now_s), self._refuses(maker)):
                self._touch()

    def _sensor_ports(self, maker: MakerId) -> dict[str, tuple[bool, SensorId]]:
        """Ports that a sensor feeds now: whether each is optional, and the sensor."""
        ports = {}
        wired = self._observed.wired.get(maker, {})
        for i in self._descriptions[maker]["inputs"]:
            kind, _, rest = str(wired.get(i["port"], str(i["source"]).split("|")[0])).partition("/")
            if kind == "sensor":
                ports[str(i["port"])] = (bool(i["optional"]), SensorId(maker.robot, rest.partition("/")[0]))
        return ports

    def _starved(self, maker: MakerId, now_s: float) -> str:
        """Why an active DFPC is starved: a sensor that it must have sends nothing, or none of its sensors does."""
        fed, ports = self._fed.get(maker, {}), self._sensor_ports(maker)
        silent = {port for port in ports if port in fed and now_s - fed[port][1] > self._patience_s(ports[port][1])}
        if silent and (silent == set(ports) or any(not ports[port][0] for port in silent)):
            sensors = ", ".join(sorted({str(ports[port][1]) for port in silent}))
            return f"no sample of {sensors} reaches {maker}"
        return ""

    def _patience_s(self, sensor: SensorId) -> float:
        """How long a sensor may be silent: a while, or three samples."""
        known = self.profile.robot(sensor.robot).sensors[sensor.sensor]
        mode = known.modes.get(self._observed.modes.get(sensor, known.initial_mode))
        rate_hz = None if mode is None else mode.rate_hz
        return STARVED_S if not rate_hz else max(STARVED_S, 3.0 / rate_hz)

    def _refuses(self, maker: MakerId) -> bool:
        """Whether an active DFPC has refused its last outputs, one after the other."""
        known = self._refusals.get(maker)
        return known is not None and known[2] - known[0] >= REFUSED_OUTPUTS

    def seen_mode(self, sensor: SensorId, mode: str, lost: str = "") -> None:
        """The instrument control unit confirmed a mode, or says that a sensor is lost."""
        with self._changed:
            o = self._observed
            before = (o.modes.get(sensor), o.lost.get(sensor))
            o.modes[sensor] = mode
            if lost:
                o.lost[sensor] = lost
            elif o.lost.pop(sensor, None) is not None:
                o.succeeded(sensor)
            if before != (o.modes.get(sensor), o.lost.get(sensor)):
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
            self._observed.attempt(what).failed(reason, self._timing.now_s())
            self._touch()

    def refused(self, sensor: SensorId, mode: str) -> None:
        """The instrument control unit refused a mode; for a while plans go without it."""
        with self._changed:
            self._refused[sensor, mode] = self._timing.now_s() + REFUSAL_S
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

    def acquire(
        self, holder: str, makers: Iterable[MakerId], modes: Mapping[SensorId, str], priority: int = DEFAULT_PRIORITY
    ) -> None:
        """Let a holder keep makers on and sensors in modes."""
        with self._changed:
            self._leases.acquire(holder, makers, modes, priority=priority)
            self._touch()

    def hold(self, holder: str, made: Plan, priority: int) -> None:
        """Let a holder have what a plan needs, in place of what it had."""
        with self._changed:
            self._leases.release(holder, self._timing.now_s())
            self._leases.acquire(
                holder, made.order, made.modes, priority=priority, accepts=made.accepts, feeding=made.feeding
            )
            self._touch()

    def displaced(self, holder: str) -> list[str]:
        """Sensors that a holder lost to a request of higher priority, as reasons."""
        with self._changed:
            lost = self._leases.displaced(holder)
            return [
                f"sensor {s} is in mode {mode} for a request of higher priority" for s, mode in sorted(lost.items())
            ]

    def release(self, holder: str) -> None:
        """Let go of what a holder has."""
        with self._changed:
            self._leases.release(holder, self._timing.now_s())
            self._touch()

    def actions(self) -> tuple[list[Action], float | None]:
        """What to do now, and when to look again (monotonic seconds) if nothing changes before."""
        with self._changed:
            now_s = self._timing.now_s()
            self._leases.expire(now_s)
            world = self._world(hopeful=True)
            feeding = {m: f for m in self._leases.wanted if (f := self._leases.feeding(m))}
            feeds = feeds_of(world, feeding)
            wanted = dependency_order(sorted(self._leases.wanted), feeds)
            modes = {**self._idle_modes(), **self._leases.wanted_modes()}
            actions = next_actions(wanted, modes, uses_of(world), feeds, self._observed, now_s, feeding)
            times = [a.not_before_s for a in self._observed.attempts.values() if a.not_before_s > now_s]
            times += [at_s for at_s in self._observed.warm_at_s.values() if at_s > now_s]
            expiry_s = self._leases.next_expiry_s()
            return actions, min([*times, *([] if expiry_s is None else [expiry_s])], default=None)

    # -- what jobs ask ------------------------------------------------------------------------------------------------

    def world(self, *, hopeful: bool = False, priority: int = -1) -> World:
        """The planner's view of now, for a request of some priority."""
        with self._changed:
            return self._world(hopeful=hopeful, priority=priority)

    def progress(self, makers: Iterable[MakerId], modes: Mapping[SensorId, str]) -> dict[str, Any]:
        """How far a plan is: what runs, what is still missing, and failures in a row with their reasons.

        ``silent`` are makers that run and get nothing, refuse all they make, or are gone for long, and why.
        """
        with self._changed:
            makers, now_s = list(makers), self._timing.now_s()
            o = self._observed
            silent = {m: why for m in makers if (why := self._starved(m, now_s))}
            gone = {m for m in makers if now_s - self._gone_since_s.get(m, now_s) > GONE_S}
            silent |= {m: f"the process of {m} is gone" for m in gone}
            silent |= {m: f"{m} refuses all it makes" for m in makers if m not in silent and self._refuses(m)}
            return {
                "missing": [str(m) for m in makers if m not in o.active],
                "dead": [str(m) for m in makers if m not in o.alive],
                "modes_missing": [
                    str(s) for s in modes if o.modes.get(s) != (self._leases.held_mode(s) or modes[s]) or s in o.lost
                ],
                "lost": {str(s): f"sensor {s} is lost: {o.lost[s]}" for s in modes if s in o.lost},
                "silent": {str(m): why for m, why in silent.items()},
                "failures": {
                    str(x): (a.failures, a.reason) for x, a in o.attempts.items() if x in makers or x in modes
                },
            }

    def catalogue(self, robots: Iterable[str], product: str | None = None) -> dict[str, Any]:
        """What there is and what it could make, as plain data; of one product alone where it is named."""
        robots = sorted(set(robots))
        with self._changed:
            world, hopeful, o = self._world(), self._world(hopeful=True), self._observed
            descriptions = {
                m: {
                    **d,
                    "state": o.states.get(m, "unknown"),
                    "alive": m in o.alive,
                    "active": m in o.active,
                    "holders": sorted(self._leases.holders(m)),
                    "wired": dict(o.wired.get(m, {})),
                    "failures": o.attempts[m].failures if m in o.attempts else 0,
                    "last_failure": o.attempts[m].reason if m in o.attempts else "",
                    "measured": None if m not in self._measured else self._measured[m].describe(),
                }
                for m, d in self._descriptions.items()
            }
            leases = [x for x in self._leases.describe() if str(x["dfpc"]).partition("/")[0] in robots]
        body = describe_world(world, self.profile, descriptions, robots)
        asked = PRODUCTS if product is None else [product]
        return {**body, "leases": leases, "products": offers(world, hopeful, asked, robots)}

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

    def _world(self, *, hopeful: bool = False, priority: int = -1) -> World:
        now_s = self._timing.now_s()
        self._refused = {k: until_s for k, until_s in self._refused.items() if until_s > now_s}
        refused: dict[SensorId, frozenset[str]] = {}
        for sensor, mode in self._refused:
            refused[sensor] = refused.get(sensor, frozenset()) | {mode}
        return world_of(
            self.profile,
            self._descriptions,
            self._observed,
            self._leases,
            refused,
            hopeful=hopeful,
            priority=priority,
            measured=self._measured,
        )
