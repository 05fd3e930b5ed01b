# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Observed and required state of all robots of a profile; one lock protects it and signals every change."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.contract.products import requestable_products
from cdff_common.contract.wiring import mode_names
from cdff_common.interfaces.profile import Profile, Robot
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.robot_profile import RobotProfile, with_robot
from cdff_core.orchestration.adjustment import union
from cdff_core.orchestration.catalogue import (
    ProviderCache,
    description_of,
    sensors_used,
    upstream_providers,
    world_of,
)
from cdff_core.orchestration.leases import ALWAYS, ALWAYS_PRIORITY, Leases
from cdff_core.orchestration.offers import describe_world, product_offers
from cdff_core.orchestration.planner import Plan
from cdff_core.orchestration.reconciliation import (
    Action,
    Configuration,
    ObservedState,
    SetMode,
    dependency_order,
    next_actions,
)
from cdff_core.orchestration.world import ProviderId, SensorId, World
from services.orchestrator.due_robots import DueRobots
from services.orchestrator.idle_modes import idle_modes
from services.orchestrator.pending_acquisitions import PendingAcquisitions
from services.orchestrator.plan_progress import LastProgress, PlanProgress
from services.orchestrator.provider_entry import provider_entry
from services.orchestrator.provider_monitor import ProviderMonitor
from services.orchestrator.refused_modes import RefusedModes
from services.orchestrator.timing import REAL, Timing
from services.orchestrator.watchers import Watcher, Watchers
from services.orchestrator.worlds import Worlds

#: Time for which a mode is not demanded after the instrument control unit refused or did not confirm it,
#: seconds.
REFUSAL_S = 30.0
#: Time in state active after which the failures of a DFPC are cleared, seconds.
HEALTHY_S = 5.0


class SystemState:
    """Descriptions, observations and leases of all robots of a profile.

    Every method takes the lock, which is reentrant. ``version`` increases with each change except insertions;
    ``wait`` waits for that. A change of a robot, or an insertion, wakes only the jobs that ``watch`` it.
    """

    def __init__(self, profile: Profile, timing: Timing = REAL) -> None:
        self.profile = profile
        self.version = 0
        self._timing = timing
        self._changed = timing.condition()
        self._descriptions: dict[ProviderId, Mapping[str, Any]] = {}
        self._by_robot: dict[str, dict[ProviderId, Mapping[str, Any]]] = {}
        self._observed = ObservedState()
        self._monitor = ProviderMonitor(profile, self._observed, self._descriptions)
        self._state_changes: dict[ProviderId, int] = {}
        self._warm_up_s: dict[ProviderId, float] = {}
        self._refused_modes = RefusedModes()
        self._changed_modes: set[SensorId] = set()
        self._watchers = Watchers()
        self._cache = ProviderCache()
        self._worlds = Worlds()
        self._due_robots = DueRobots()
        self._linger_s: dict[ProviderId, float] = {}
        self._leases = Leases(self._linger_s)
        self._left: set[str] = set()
        self._elsewhere: set[str] = set()
        self._acquisitions = PendingAcquisitions()
        self._last_progress = LastProgress(self._observed, self._leases, self._acquisitions)
        self._absent: set[ProviderId] = set()
        for robot in profile.robots:
            self._add_dfpcs(robot)

    def _add_dfpcs(self, robot: Robot) -> None:
        """Add the DFPCs of a robot, and leases of those that are always active."""
        registry = Registry.default()
        for entry in robot.dfpcs:
            provider = ProviderId(robot.id, entry.name)
            description = description_of(robot, entry, registry.dfpc(entry.name))
            self._descriptions[provider] = description
            self._by_robot.setdefault(robot.id, {})[provider] = description
            self._warm_up_s[provider], self._linger_s[provider] = entry.warm_up_s, entry.linger_s
            if entry.activation == "always":
                accepts = {SensorId(robot.id, s): mode_names(m) for s, m in robot.modes_of(entry).items()}
                modes = {s: names[0] for s, names in accepts.items()}
                self._leases.acquire(ALWAYS, [provider], modes, priority=ALWAYS_PRIORITY, accepts=accepts)

    # -- robots that join and leave

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """Ids of the robots of the profile and of those that have joined, without those that have left."""
        with self._changed:
            return tuple(r for r in self.profile.robot_ids if r not in self._left)

    def set_robot(self, joined: RobotProfile) -> None:
        """Add a robot, or replace it by another revision of its profile; its DFPCs are then observed again.

        Raises
        ------
        ConfigurationError
            If the robot has a DFPC that is not installed here.
        """
        robot, registry = joined.robot, Registry.default()
        for entry in robot.dfpcs:
            registry.dfpc(entry.name)
        with self._change(robot.id):
            self._clear_robot(robot.id)
            self.profile = with_robot(self.profile, joined)
            self._monitor.set_profile(self.profile)
            self._left.discard(robot.id)
            self._absent -= {ProviderId(robot.id, entry.name) for entry in robot.dfpcs}
            self._add_dfpcs(robot)

    def remove_robot(self, robot: str) -> None:
        """Take the DFPCs of a robot that has left out of planning and catalogue; its products stay stored."""
        with self._change(robot):
            self._clear_robot(robot)
            self._left.add(robot)

    def _clear_robot(self, robot: str) -> None:
        """Clear leases and observations of a robot, and mark its DFPCs as absent."""
        providers = [p for p in self._descriptions if p.robot == robot]
        o = self._observed
        for provider in providers:
            self.set_alive(provider, alive=False)
        for subject in [s for s in o.failures if s.robot == robot]:
            o.clear_failures(subject)
        for by_sensor in (o.modes, o.lost):
            for sensor in [s for s in by_sensor if s.robot == robot]:
                del by_sensor[sensor]
        self._changed_modes = {s for s in self._changed_modes if s.robot != robot}
        self._refused_modes.remove_robot(robot)
        self._leases.remove_robot(robot)
        self._absent.update(providers)

    # -- control of robots

    def controls(self, robot: str) -> bool:
        """Return True if this orchestrator controls a robot; otherwise the robot's own one does."""
        with self._changed:
            return robot not in self._elsewhere

    def set_control(self, robot: str, controlled: bool) -> None:
        """Begin or end the control of a robot: only then are its DFPCs and sensors switched."""
        with self._change(robot):
            (self._elsewhere.discard if controlled else self._elsewhere.add)(robot)

    def changes(self, robot: str) -> tuple[set[ProviderId], set[SensorId]]:
        """Return the owned DFPCs and changed sensors of a robot."""
        with self._changed:
            owned = {p for p in self._observed.owned if p.robot == robot}
            return owned, {s for s in self._changed_modes if s.robot == robot}

    def drop_changes(self, robot: str) -> None:
        """Own no DFPC and no changed sensor of a robot any more: its next owner does."""
        with self._changed:
            owned, sensors = self.changes(robot)
            self._observed.owned -= owned
            self._changed_modes -= sensors

    # -- change signal

    def notify(self, *robots: str) -> None:
        """Signal a change of some robots, by default of all."""
        with self._changed:
            self.version += 1
            self._due_robots.add(robots or self._by_robot)
            self._worlds.clear(robots)
            self._changed.notify_all()
            self._watchers.notify(robots or None)

    @contextmanager
    def watch(
        self, watcher: Watcher, robots: Collection[str], products: Collection[tuple[str, str]]
    ) -> Iterator[None]:
        """Call ``watcher.set`` at each change of ``robots`` and insertion of ``products``.

        A product is ``(robot, name)``; its robot may be ``any``.
        """
        with self._changed:
            self._watchers.add(watcher, robots, products)
        try:
            yield
        finally:
            with self._changed:
                self._watchers.remove(watcher, robots, products)

    def wait(self, version: int, timeout_s: float) -> None:
        """Return once the version differs from ``version``, or after ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self.version != version, timeout=max(timeout_s, 0.0))

    @contextmanager
    def _change(self, *robots: str) -> Iterator[None]:
        """Take the lock and signal a change of some robots, by default of all."""
        with self._changed:
            yield
            self.notify(*robots)

    # -- observations of DFPCs

    def has_provider(self, provider: ProviderId) -> bool:
        """Return True if the profile has the DFPC, and its robot has not left."""
        return provider in self._descriptions and provider not in self._absent

    def products_of(self, provider: ProviderId) -> frozenset[str]:
        """Return the products that can be requested from a DFPC."""
        with self._changed:
            return frozenset(
                str(o["product"]) for o in self._descriptions[provider]["outputs"] if o["product"]
            )

    def product_of(self, provider: ProviderId, port: str) -> str:
        """Return the product of an output port; empty if it has none, or there is no such DFPC."""
        with self._changed:
            outputs = self._descriptions.get(provider, {}).get("outputs", ())
            return next((str(o["product"]) for o in outputs if o["port"] == port), "")

    def set_description(self, provider: ProviderId, description: Mapping[str, Any]) -> None:
        """Record the description reported by a DFPC."""
        with self._change(provider.robot):
            self._descriptions[provider] = self._by_robot[provider.robot][provider] = description

    def set_alive(self, provider: ProviderId, alive: bool) -> None:
        """Record that the process of a DFPC appeared or disappeared."""
        with self._change(provider.robot):
            self._monitor.set_alive(provider, alive, self._timing.now_s())
            if alive:
                self._observed.alive.add(provider)
                self._observed.clear_failures(provider)
            else:
                self._observed.alive.discard(provider)
                self._set_inactive(provider)
                self._observed.states.pop(provider, None)
                self._state_changes.pop(provider, None)

    def set_state(
        self,
        provider: ProviderId,
        state: str,
        last_error: str = "",
        wired: Mapping[str, str] | None = None,
        changes: int | None = None,
        configuration: Configuration | None = None,
    ) -> None:
        """Record the reported state, input sources and configuration of a DFPC.

        A late report, with fewer state ``changes`` than the last one, is ignored.
        """
        with self._changed:
            if changes is not None:
                if changes < self._state_changes.get(provider, 0):
                    return
                self._state_changes[provider] = changes
            o, now_s = self._observed, self._timing.now_s()
            before = self._seen(provider)
            if state in ("unconfigured", "inactive", "active", "error"):
                o.states[provider] = state
            if state == "active":
                o.active.add(provider)
                active_s = self._monitor.set_active(provider, now_s)
                if not before[0] and self._warm_up_s.get(provider):
                    o.warm_at_s[provider] = now_s + self._warm_up_s[provider]
                if active_s > HEALTHY_S and provider in o.failures:
                    o.clear_failures(provider)
                    self.notify(provider.robot)
                if wired is not None and o.wired.get(provider) != wired:
                    o.wired[provider] = dict(wired)
                if configuration is not None:
                    o.configurations[provider] = configuration
            else:
                self._set_inactive(provider)
                if state == "error" and before[0]:
                    o.add_failure(provider, last_error or "it reported state error", now_s)
            if before != self._seen(provider):
                self.notify(provider.robot)

    def _seen(self, provider: ProviderId) -> tuple[object, ...]:
        """Return whether a provider is active, and its state, sources and configuration."""
        o, p = self._observed, provider
        return p in o.active, o.states.get(p), o.wired.get(p), o.configurations.get(p)

    def _set_inactive(self, provider: ProviderId) -> None:
        self._observed.active.discard(provider)
        self._observed.warm_at_s.pop(provider, None)
        self._observed.wired.pop(provider, None)
        self._observed.configurations.pop(provider, None)
        self._monitor.set_inactive(provider)

    def add_status(self, provider: ProviderId, status: Mapping[str, Any]) -> None:
        """Record a heartbeat of a DFPC; raises InputError for a malformed one."""
        with self._changed:
            if self._monitor.add_status(provider, status, self._timing.now_s()):
                self.notify(provider.robot)

    def set_owned(self, provider: ProviderId, owned: bool) -> None:
        """Record if this orchestrator owns a DFPC, having activated it; it deactivates only owned ones."""
        with self._changed:
            (self._observed.owned.add if owned else self._observed.owned.discard)(provider)

    # -- observations of sensors, actions and the DPM

    def set_mode(self, sensor: SensorId, mode: str, lost: str = "") -> None:
        """Record a confirmed mode, or the reason of a lost sensor, from the instrument control unit."""
        with self._changed:
            o = self._observed
            before = (o.modes.get(sensor), o.lost.get(sensor))
            o.modes[sensor] = mode
            if lost:
                o.lost[sensor] = lost
            elif o.lost.pop(sensor, None) is not None:
                o.clear_failures(sensor)
            if before != (o.modes.get(sensor), o.lost.get(sensor)):
                self.notify(sensor.robot)

    def add_mode_refusal(self, sensor: SensorId, mode: str, reason: str) -> None:
        """Record a mode that was refused or not confirmed; it is not demanded for ``REFUSAL_S``."""
        with self._change(sensor.robot):
            now_s = self._timing.now_s()
            self._refused_modes.add(sensor, mode, now_s + REFUSAL_S, reason)
            self._observed.add_failure(sensor, reason, now_s)
            self._observed.failures[sensor].not_before_s = now_s  # another mode may be demanded at once
            self._leases.avoid(self._refused_modes.at(now_s))

    def add_mode_change(self, sensor: SensorId) -> None:
        """Record a sensor whose mode this orchestrator changed, for its reset after the last use."""
        with self._changed:
            self._changed_modes.add(sensor)

    def recover(self, owned: Iterable[ProviderId], changed_modes: Iterable[SensorId]) -> None:
        """Record the DFPCs and modes that another process changed; its DFPCs of the profile linger."""
        sensors = {SensorId(robot.id, name) for robot in self.profile.robots for name in robot.sensors}
        owned = set(owned)
        with self._change():
            self._observed.owned |= owned
            self._changed_modes |= sensors.intersection(changed_modes)
            self._leases.acquire("restart", owned & self._descriptions.keys(), {})
            self._leases.release("restart", self._timing.now_s())

    def add_failure(self, subject: ProviderId | SensorId, reason: str) -> None:
        """Record a failed activation or mode change; it is repeated after a back-off."""
        with self._change(subject.robot):
            self._observed.add_failure(subject, reason, self._timing.now_s())

    def clear_failures(self, subject: ProviderId | SensorId) -> None:
        """Clear the failures of a provider or sensor."""
        with self._change(subject.robot):
            self._observed.clear_failures(subject)

    def add_insertion(self, robot: str, product: str) -> None:
        """Count a product of a robot that was inserted in the DPM."""
        with self._changed:
            self._watchers.add_insertion(robot, product)

    def insertions(self, products: Iterable[tuple[str, str]]) -> int:
        """Return the number of inserted products, each given as ``(robot, name)``; the robot may be any."""
        with self._changed:
            return self._watchers.insertions(products)

    # -- leases and actions

    def hold(self, holder: str, plan: Plan, priority: int) -> None:
        """Replace the lease of a holder by the needs of a plan."""
        robots = {provider.robot for provider in (*plan.order, *plan.takes)}
        with self._change_of_leases(robots | self._leases.robots_of(holder)):
            world = self.world(optimistic=True, priority=priority, robots=robots)
            self._leases.release(holder, self._timing.now_s())
            self._leases.take(plan.takes, priority)
            self._leases.acquire(
                holder,
                plan.order,
                plan.modes,
                priority=priority,
                accepts=plan.accepts,
                chosen_sources=plan.chosen_sources,
                uses=sensors_used(world, plan.chosen_sources),
                implementations=plan.implementations,
                settings=plan.settings,
            )
            self._acquisitions.set(holder, plan.acquisitions)
            if plan.acquisitions:  # acquisitions are not part of the leases, whose change is signalled
                self.notify(*{sensor.robot for sensor in plan.acquisitions})

    def release(self, holder: str) -> None:
        """Release the lease of a holder."""
        with self._change_of_leases(self._leases.robots_of(holder)):
            self._acquisitions.remove(holder)
            self._leases.release(holder, self._timing.now_s())
            self._last_progress.remove(holder)

    def renew(self, provider: ProviderId) -> None:
        """Restart the linger times of a provider and of its inputs: a stored product served a request."""
        with self._changed:
            self._leases.renew(provider, self._timing.now_s())

    def end_acquisition(
        self, holder: str, sensor: SensorId, parameters: Mapping[str, float], begun_ns: int
    ) -> None:
        """Record the end of a single acquisition for a holder, which began at a mission time, and the last
        parameters of the sensor.
        """
        with self._change(sensor.robot):
            self._acquisitions.end(holder, sensor, begun_ns)
            self._observed.acquired[sensor] = dict(parameters)

    def is_acquisition_pending(self, holder: str, sensor: SensorId) -> bool:
        """Return True if a single acquisition for a holder is not made yet."""
        with self._changed:
            return self._acquisitions.is_pending(holder, sensor)

    @contextmanager
    def _change_of_leases(self, robots: set[str]) -> Iterator[None]:
        """Take the lock, and signal a change of some robots if their leases require something else."""
        with self._changed:
            before = self._leases.effect(robots)
            yield
            if before != self._leases.effect(robots):
                self.notify(*robots)

    def leases(self) -> list[dict[str, Any]]:
        """Return all leases as plain data."""
        with self._changed:
            return self._leases.describe()

    def actions(self) -> tuple[list[Action], float | None]:
        """Return all due actions, and the next time at which they change (monotonic seconds)."""
        with self._changed:
            now_s = self._timing.now_s()
            return self._actions(self._by_robot, now_s), self._next_s(now_s)

    def new_actions(self) -> tuple[list[Action], float | None]:
        """Return the due actions for the robots that have changed since the last call, or one of whose times
        has come, now and then for all, and the time of the next call as ``actions``.
        """
        with self._changed:
            now_s = self._timing.now_s()
            robots = self._due_robots.take(self._by_robot, self._times_s(), now_s)
            try:
                actions = self._actions(robots, now_s)
            except Exception:
                self._due_robots.add(robots)
                raise
            times_s = (self._next_s(now_s), self._due_robots.complete_at_s)
            return actions, min(t for t in times_s if t is not None)

    def _actions(self, robots: Collection[str], now_s: float) -> list[Action]:
        # A process that is not observed yet, after a restart of this one, may be active.
        unknown = self._leases.wanted - self._observed.alive
        expired = {p.robot for p in self._leases.expire(now_s, self._observed.active | unknown)}
        refusals = self._refused_modes.at(now_s)
        self._leases.avoid(refusals)
        if changed := expired | {s.robot for s in refusals}:
            self._worlds.clear(changed)
        robots = {*robots, *expired} - self._elsewhere
        o = self._observed
        owned = {p for p in o.owned if p.robot in robots}
        wanted = {p for p in self._leases.wanted if p.robot in robots}
        in_use = wanted | owned | {p for p in o.active if p.robot in robots}
        world = self.world(optimistic=True, robots={p.robot for p in in_use})
        sources = {m: s for m in wanted if (s := self._leases.chosen_sources(m))}
        upstream = upstream_providers(world, sources)
        leased_modes = {s: m for s, m in self._leases.wanted_modes().items() if s.robot in robots}
        unleased = {s for s in self._changed_modes - leased_modes.keys() if s.robot in robots}
        modes = idle_modes(self.profile, unleased, world, self._leases, o) | leased_modes
        actions = next_actions(
            wanted=dependency_order(sorted(wanted), upstream),
            wanted_modes={s: mode for s, mode in modes.items() if self._is_held(s, mode)},
            uses=sensors_used(world, sources),
            upstream=upstream,
            observed=replace(o, owned=owned),
            now_s=now_s,
            chosen_sources=sources,
            configurations={p: c for p in wanted if (c := self._configuration(p, world)) is not None},
        )
        acquisitions = self._acquisitions.due(self._leases, o, now_s)
        actions += [a for a in acquisitions if a.sensor.robot in robots]
        # A refused mode stays wanted, so that its DFPCs wait, but it is not demanded again for a while.
        return [a for a in actions if not (isinstance(a, SetMode) and a.mode in refusals.get(a.sensor, ()))]

    def _next_s(self, now_s: float) -> float | None:
        return min((t for _, t in self._times_s() if t > now_s), default=None)

    def _times_s(self) -> Iterator[tuple[str, float]]:
        """Return the robots with the times at which their actions change, monotonic seconds."""
        yield from self._refused_modes.ends_s
        yield from self._leases.expiries_s
        yield from ((s.robot, history.not_before_s) for s, history in self._observed.failures.items())
        yield from ((p.robot, warm_s) for p, warm_s in self._observed.warm_at_s.items())

    def _is_held(self, sensor: SensorId, mode: str) -> bool:
        """Return False for a mode of single acquisitions, which ends with each acquisition."""
        declared = self.profile.robot(sensor.robot).sensors[sensor.sensor].modes.get(mode)
        return declared is None or declared.acquires is None

    def _configuration(self, provider: ProviderId, world: World) -> Configuration | None:
        """Return the implementation and parameters that the holders want; None without holders or choice."""
        current, choices = world.providers.get(provider), self._descriptions[provider].get("choices", ())
        is_fixed = current is None or not (current.adjustables or len(choices) > 1)
        if current is None or is_fixed or not self._leases.holders(provider):
            return None
        settings = union(current.adjustables, self._leases.settings(provider))
        implementation = self._leases.implementation(provider) or next(iter(choices), None)
        return Configuration(implementation, tuple(settings.items()))

    # -- views for planning and replies

    def world(
        self,
        *,
        optimistic: bool = False,
        priority: int = -1,
        holder: str = "",
        robots: Collection[str] | None = None,
        acquire: AcquisitionParameters | None = None,
    ) -> World:
        """Return the current world of the planner for a request of some priority, of all robots or of some.

        The leases of ``holder``, which a new plan replaces, do not count. Equal requests that arrive together
        get the same world.
        """
        with self._changed:
            if holder and self._leases.is_holder(holder):
                return self._new_world(optimistic, priority, holder, robots, acquire)
            now_s = self._timing.now_s()
            key = (optimistic, priority, frozenset(self._by_robot if robots is None else robots), acquire)
            world = self._worlds.get(key, now_s)
            if world is None:
                world = self._new_world(optimistic, priority, "", robots, acquire)
                self._worlds.add(key, world, now_s)
            return world

    def _new_world(
        self,
        optimistic: bool,
        priority: int,
        holder: str,
        robots: Collection[str] | None,
        acquire: AcquisitionParameters | None,
    ) -> World:
        selected = self._by_robot if robots is None else robots
        return world_of(
            self.profile,
            {p: d for robot in selected for p, d in self._by_robot.get(robot, {}).items()},
            self._observed,
            self._leases.without(holder) if holder else self._leases,
            self._refused_modes.at(self._timing.now_s()),
            optimistic=optimistic,
            priority=priority,
            measured=self._monitor.usage,
            absent=self._absent,
            cache=self._cache,
            robots=robots,
            acquire=acquire,
        )

    def progress(self, plan: Plan, holder: str) -> PlanProgress:
        """Return the progress of the plan of a holder."""
        with self._changed:
            problems = self._monitor.problems(plan.order, self._timing.now_s())
            return self._last_progress.get(plan, holder, self.version, problems)

    def catalogue(self, robots: Iterable[str], product: str | None = None) -> dict[str, Any]:
        """Return DFPCs, sensors, leases and product offers as plain data; only of ``product`` if it is given.

        ``robots`` that have left have none.
        """
        robots = sorted(set(robots).intersection(self.robot_ids))
        with self._changed:
            world, optimistic, o = self.world(), self.world(optimistic=True), self._observed
            usage = self._monitor.usage
            descriptions = {
                m: {**d, **provider_entry(m, o, usage.get(m)), "holders": sorted(self._leases.holders(m))}
                for robot in robots
                for m, d in self._by_robot.get(robot, {}).items()
            }
            world = replace(
                world, providers={m: p for m, p in world.providers.items() if m not in self._absent}
            )
            leases = [x for x in self._leases.describe() if str(x["dfpc"]).partition("/")[0] in robots]
        body = describe_world(world, self.profile, descriptions, robots)
        products = requestable_products() if product is None else [product]
        return {**body, "leases": leases, "products": product_offers(world, optimistic, products, robots)}
