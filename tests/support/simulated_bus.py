# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated bus in virtual time, connected to simulated DFPCs, an ICU and a DPM with random faults.

It has the methods of ``cdff_common.bus.Bus`` that the orchestrator uses. Random draws from a seed decide how
long a call takes and whether it fails or hangs until its timeout.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.bus import Message, Reply, Request, keys, without_pauses
from cdff_common.bus.message import pack, unpack
from cdff_common.clock import NS_PER_S
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.errors import (
    DeadlineError,
    FrameNotFoundError,
    NoAnswerError,
    NotActiveError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import parse_region
from cdff_common.interfaces.product import Header, Quality, Status, product_id
from cdff_common.interfaces.profile import DfpcEntry, Profile, Robot
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap, TransformWithCovariance
from cdff_core.orchestration.catalogue import description_of
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS
from cdff_core.orchestration.world import ProviderId
from cdff_dev.mission_replay.virtual import Scheduler, VirtualTiming
from services.icu.unit import Faults, SimulatedIcu
from tests.support.orchestrator_mission import DFPCS

START_NS = 1_700_000_000 * NS_PER_S
MAP = GridGeometry("site", 1.0, 0.0, 4.0, 4, 4)
_PRODUCE_PERIOD_S = 5.0
#: Number of products of each type that the simulated DPM keeps.
_MAX_PRODUCTS = 20


class VirtualClock:
    """The mission clock in virtual time."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler

    def now_ns(self) -> int:
        return START_NS + int(self._scheduler.now_s * NS_PER_S) // 1000 * 1000


@dataclass
class Process:
    """The simulated process of a DFPC; the counters have the names of its status."""

    robot: Robot
    entry: DfpcEntry
    alive: bool = False
    state: str = "unconfigured"
    wired: dict[str, str] = field(default_factory=dict)
    is_hung: bool = False
    degraded: bool = False
    sigma_m: float = 0.01
    produces_nothing: bool = False
    receives_nothing: bool = False
    samples: int = 0
    outputs: int = 0
    failed: int = 0
    by_port: dict[str, int] = field(default_factory=dict)

    @property
    def id(self) -> ProviderId:
        return ProviderId(self.robot.id, self.entry.name)


@dataclass(frozen=True)
class Product:
    """A product in the simulated DPM."""

    header: Header
    robot: str
    dfpc: str
    product: str
    value: Any

    def item(self) -> dict[str, Any]:
        return {**self.header.to_dict(), "robot": self.robot, "dfpc": self.dfpc, "product": self.product}

    def reply(self, **fields: Any) -> Reply:
        encoding = encoding_string(wire_type(self.value), "uper")
        return Reply(encode(self.value, "uper"), encoding, {**self.item(), **fields})


class Mission:
    """All components that the orchestrator communicates with: DFPCs, ICU, DPM.

    ``connect`` returns the bus of an orchestrator process; the buses of earlier processes receive nothing.
    """

    def __init__(self, scheduler: Scheduler, profile: Profile, seed: int, failure_rate: float = 0.03) -> None:
        self.random, self.failure_rate = random.Random(seed), failure_rate
        self.scheduler, self.profile = scheduler, profile
        self.clock = VirtualClock(scheduler)
        self.processes = {ProviderId(r.id, e.name): Process(r, e) for r in profile.robots for e in r.dfpcs}
        faults = Faults(seed=seed, spread=0.3, refuses=failure_rate)
        self.icu = SimulatedIcu(profile, self._on_mode, faults, clock=lambda: scheduler.now_s)
        self.icu_up = self.dpm_up = True
        #: Answers of a faulty unit to ``set_mode`` by mode; None: no answer before the deadline.
        self.mode_answers: dict[str, Any] = {}
        self.modes_answer: Any = None  # answer of a faulty unit to ``modes``
        #: Demands that reached the unit: time, sensor, mode.
        self.mode_demands: list[tuple[float, str, str]] = []
        self.products: dict[tuple[str, str], list[Product]] = {}
        self.observed = {r.id: np.zeros((4, 4), dtype=bool) for r in profile.robots}
        self.tokens = {keys.alive(r.id, s) for r in profile.robots for s in ("icu", "dpm")}
        self.buses: list[SimulatedBus] = []
        self.history = 0
        for process in self.processes.values():
            scheduler.start(lambda p=process: self._live(p), f"dfpc {process.id}")  # type: ignore[misc]

    def connect(self, timing: VirtualTiming) -> SimulatedBus:
        self.buses = [SimulatedBus(self, timing)]
        return self.buses[0]

    def _live(self, process: Process) -> None:
        """Start the process, then produce and publish its status periodically while it is active."""
        self.scheduler.sleep(self.random.uniform(0.1, 3.0))
        self.start(process)
        while True:
            self.scheduler.sleep(_PRODUCE_PERIOD_S)
            if process.alive and process.state == "active" and not process.is_hung:
                self._produce(process)
                self.publish_status(process)

    def start(self, process: Process) -> None:
        """Start a process, inactive and with counters at zero."""
        process.alive, process.state, process.is_hung = True, "inactive", False
        process.samples = process.outputs = process.failed = 0
        process.by_port = {}
        self.token(keys.alive(*process.id), present=True)
        self.publish_status(process)

    def stop(self, process: Process) -> None:
        """End a process and withdraw its token."""
        process.alive, process.state, process.wired = False, "unconfigured", {}
        self.token(keys.alive(*process.id), present=False)

    def is_streaming(self, robot: str, source: str) -> bool:
        """Return whether a source of the wiring, a sensor stream or a product, sends samples."""
        kind, owner, _ = source.split("/")
        if kind == "product":
            provider = self.processes[ProviderId(robot, owner)]
            return provider.alive and provider.state == "active" and not provider.is_hung
        sensor = self.icu.modes(robot)["sensors"][owner]
        return bool(sensor["on"]) and sensor["state"] != "lost"

    def _produce(self, process: Process) -> None:
        has_input = {
            port: not process.receives_nothing and self.is_streaming(process.robot.id, source)
            for port, source in process.wired.items()
        }
        for port, has_samples in has_input.items():
            process.by_port[port] = process.by_port.get(port, 0) + 5 * has_samples
            process.samples += 5 * has_samples
        description = DFPCS[process.entry.name]
        required = [p.attribute for p in description.input_ports if not p.optional]
        if not any(has_input.values()) or not all(has_input.get(port) for port in required):
            return
        process.outputs += 1
        if process.produces_nothing:
            process.failed += 1
            return
        product = description.output_ports[0].product
        if product is not None and self.dpm_up:
            self._insert(process, product)

    def _insert(self, process: Process, product: str) -> None:
        robot, now_ns = process.robot.id, self.clock.now_ns()
        value: Any
        frame, child = "site", f"{robot}/base" if product == "pose" else None
        if product == "pose":
            T = UncertainTransform(np.eye(4), np.eye(6) * process.sigma_m**2)
            value = TransformWithCovariance.from_transform(
                T, parent="site", child=f"{robot}/base", stamp_ns=now_ns
            )
        elif product == "dem":
            observed = self.observed[robot]
            observed[self.random.randrange(4), self.random.randrange(4)] = True
            value = self._map(observed, now_ns)
        else:
            layers = {"class": np.ones((4, 4), np.uint8)}
            layers |= {
                n: np.zeros((4, 4), np.float32) for n in ("slope_deg", "step_m", "roughness_m", "cost")
            }
            value = NavigationMap.from_layers(MAP, layers, t0_ns=now_ns, t1_ns=now_ns)
        status = Status.DEGRADED if process.degraded else Status.OK
        header = Header(
            product_id(robot, process.entry.name, product, now_ns, 0, ""),
            0,
            now_ns,
            now_ns,
            frame,
            f"{process.entry.name}/Simulated/1",
            child=child,
            quality=Quality(status=status),
            box_m=value.extent_m(),
            resolution_m=None if product == "pose" else 1.0,
        )
        products = self.products.setdefault((robot, product), [])
        products.insert(0, Product(header, robot, process.entry.name, product, value))
        del products[_MAX_PRODUCTS:]
        self.publish(keys.event(robot, "inserted"), {"product": product, "id": header.id})

    @staticmethod
    def _map(observed: np.ndarray, now_ns: int) -> ElevationMap:
        mean = np.where(observed, 0.0, np.nan).astype(np.float32)
        layers = dict.fromkeys(("mean", "variance", "min", "max", "age_s"), mean)
        layers["count"] = observed.astype(np.float32)
        return ElevationMap.from_layers(MAP, layers, t0_ns=now_ns, t1_ns=now_ns)

    def publish_status(self, process: Process) -> None:
        self.publish(keys.dfpc_status(*process.id), self._status(process))

    def _status(self, process: Process) -> dict[str, Any]:
        return {
            "state": process.state,
            "wired": dict(process.wired),
            "last_error": "simulated",
            "samples": process.samples,
            "samples_by_port": dict(process.by_port),
            "outputs": process.outputs,
            "failed": process.failed,
            "mean_step_cpu_s": DFPCS[process.entry.name].cost["Simulated"].cpu_s,
            "last_step_s": 0.1,
            "rss_mb": 50.0,
        }

    def fail(self, process: Process) -> None:
        """Put an active process into the error state and publish an alarm."""
        if process.alive and process.state == "active":
            process.state = DFPC_TRANSITIONS["active", "fail"]
            self.publish(
                keys.event(process.robot.id, "alarm"),
                {"dfpc": process.entry.name, "state": "error", "reason": "simulated"},
            )
            self.publish_status(process)

    def switch(self, process: Process, verb: str, body: Mapping[str, Any]) -> Reply:
        """Change the state of a DFPC as its compound host does."""
        next_state = DFPC_TRANSITIONS.get((process.state, verb))
        if next_state is None:
            raise NotActiveError(f"{process.id} is {process.state}: {verb} is not allowed")
        if verb == "activate":
            defaults = {port: wiring.split("|")[0] for port, wiring in process.entry.inputs.items()}
            process.wired = {**defaults, **process.wired, **body.get("inputs", {})}
        elif verb != "configure":
            process.wired = {}
        if verb == "configure":
            process.samples = process.outputs = process.failed = 0
            process.by_port = {}
        process.state = next_state
        self.publish_status(process)
        return Reply.of({"state": next_state})

    def publish(self, key: str, body: Mapping[str, Any]) -> None:
        for bus in self.buses:
            bus.deliver(key, body)

    def token(self, key: str, *, present: bool) -> None:
        """Declare or withdraw a liveliness token."""
        (self.tokens.add if present else self.tokens.discard)(key)
        for bus in self.buses:
            bus.on_token(key, present)

    def _on_mode(self, robot: str, event: Mapping[str, object]) -> None:
        self.publish(keys.event(robot, "sensor_mode"), event)

    def add_history(self, entries: list[dict[str, Any]]) -> Reply:
        """Store records of the journal in the history of the DPM; assert that none is missing."""
        for entry in entries:
            assert entry["number"] <= self.history + 1, f"record {self.history + 1} is missing"
            self.history = max(self.history, entry["number"])
        return Reply.of({"last": self.history})

    def dpm(self, verb: str, p: Mapping[str, Any]) -> Reply:
        """Reply to a call of the DPM with parameters ``p``; a call without id and verb gets a fused map."""
        if verb == "pose":
            known_frames = {"site"} | {f"{r}/{f}" for r in self.profile.robot_ids for f in ("base", "odom")}
            unknown = {str(p["parent"]), str(p["child"])} - known_frames
            if unknown:
                raise FrameNotFoundError(f"frame {sorted(unknown)[0]!r} is not in the tree")
            return Reply.of({"T": np.eye(4).tolist(), "covariance": (np.eye(6) * 1e-4).tolist()})
        if verb == "search":
            return Reply.of({"items": [x.item() for x in self._search(p)[: int(p.get("limit", 10))]]})
        if "id" in p:
            stored = (x for products in self.products.values() for x in products)
            product = next((x for x in stored if x.header.id == p["id"]), None)
            if product is None:
                raise ProductNotFoundError(f"no product {p['id']}")
            return product.reply()
        if p["type"] != "dem":
            usable = [x for x in self._search(p) if x.header.quality.status != "FAILED"]
            if not usable:
                raise ProductNotFoundError("no product of that kind")
            if usable[0].header.id == p.get("known"):
                return Reply.of({"id": p["known"]}, kind="reference")
            return usable[0].reply()
        robots = self.profile.robot_ids if p.get("robot") == "any" else (str(p["robot"]),)
        patches = [x for r in robots for x in self.products.get((r, "dem"), [])]
        if not patches:
            raise ProductNotFoundError("no dem")
        newest = max(patches, key=lambda x: x.header.t1_ns)
        observed = np.logical_or.reduce([self.observed[r] for r in robots])
        fused = Product(newest.header, newest.robot, "dpm", "dem", self._map(observed, newest.header.t1_ns))
        return fused.reply(oldest_ns=min(x.header.t0_ns for x in patches))

    def _search(self, p: Mapping[str, Any]) -> list[Product]:
        """Return products by type, robot, DFPC and region, newest first."""
        robots = self.profile.robot_ids if p["robot"] == "any" else (str(p["robot"]),)
        result = [x for r in robots for x in self.products.get((r, str(p["type"])), [])]
        result = [x for x in result if p.get("dfpc", x.dfpc) == x.dfpc]
        if "region" in p:
            x0, y0, x1, y1 = parse_region(str(p["region"])).bounds
            result = [x for x in result if x0 < 4.0 and y0 < 4.0 and x1 > 0.0 and y1 > 0.0]
        return sorted(result, key=lambda x: -x.header.t1_ns)


class SimulatedBus:
    """The bus of one orchestrator process."""

    def __init__(self, mission: Mission, timing: VirtualTiming) -> None:
        self._mission, self._timing = mission, timing
        self.handlers: dict[str, Callable[[Request], Any]] = {}
        self._subscriptions: list[tuple[list[str], Callable[[Message], None]]] = []
        self._watcher: Callable[[str, bool], None] | None = None
        self.mission_clock = mission.clock

    def serve(self, key: str, handler: Callable[[Request], Any], **_: Any) -> None:
        self.handlers[key] = handler

    def subscribe(self, keyexpr: str, callback: Callable[[Message], None], **_: Any) -> None:
        self._subscriptions.append((keyexpr.split("/"), callback))
        if keyexpr.endswith("/status"):  # a late subscriber receives the last status
            for process in self._mission.processes.values():
                if process.alive:
                    self._mission.publish_status(process)

    def deliver(self, key: str, body: Mapping[str, Any]) -> None:
        parts = key.split("/")
        for pattern, callback in self._subscriptions:
            if len(pattern) == len(parts) and all(a in ("*", b) for a, b in zip(pattern, parts, strict=True)):
                callback(Message(key, pack(dict(body)), "", b""))

    def on_token(self, key: str, present: bool) -> None:
        if self._watcher is not None:
            self._watcher(key, present)

    def watch_alive(self, keyexpr: str, callback: Callable[[str, bool], None]) -> None:
        self._watcher = callback
        for key in sorted(self._mission.tokens):
            callback(key, True)

    def alive(self, keyexpr: str) -> set[str]:
        return {k for k in self._mission.tokens if k.endswith("/orchestrator")} & {keyexpr}

    def declare_alive(self, scope: str, service: str) -> None:
        self._mission.token(keys.alive(scope, service), present=True)

    def publish_map(self, key: str, body: Mapping[str, Any], **_: Any) -> None:
        self._mission.publish(key, body)

    def call(
        self,
        key: str,
        parameters: Mapping[str, Any] | None = None,
        *,
        payload: bytes = b"",
        timeout_s: float = 5.0,
        **_: Any,
    ) -> Reply:
        """Return the reply of the called component after a delay, or wait for the timeout if it hangs."""
        m, p = self._mission, {k: str(v) for k, v in (parameters or {}).items()}
        parts, verb = key.split("/"), key.rsplit("/", 1)[1]
        scheduler, until_s = m.scheduler, m.scheduler.now_s + timeout_s
        scheduler.sleep(min(m.random.choice([0.002, 0.005, 0.02, 0.2]), timeout_s))
        if scheduler.now_s >= until_s:
            raise DeadlineError("no answer before the deadline")
        if parts[3] == "dpm":
            if not m.dpm_up:
                raise NoAnswerError("no service answers")
            return m.add_history(unpack(payload)["entries"]) if verb == "history" else m.dpm(verb, p)
        if parts[3] == "icu":
            if not m.icu_up:
                raise NoAnswerError("no service answers")
            if verb == "modes":
                return Reply.of(m.icu.modes(parts[2]) if m.modes_answer is None else m.modes_answer)
            return Reply.of(self._set_mode(parts[2], p, until_s))
        process = m.processes[ProviderId(parts[2], parts[4])]
        if not process.alive:
            raise NoAnswerError("no service answers")
        if process.is_hung:
            scheduler.sleep(until_s - scheduler.now_s)
            raise DeadlineError("the process does not answer")
        if verb == "describe":
            return Reply.of(
                {
                    **description_of(process.robot, process.entry, DFPCS[process.entry.name]),
                    "state": process.state,
                    "wired": dict(process.wired),
                }
            )
        if m.random.random() < m.failure_rate:
            raise UnavailableError("simulated failure")
        request = Request(key, p, payload, "", b"")
        return m.switch(process, verb, request.body() if payload else {})

    def _set_mode(self, robot: str, p: Mapping[str, str], until_s: float) -> Any:
        """Set a mode like ``SimulatedIcu.set_mode``, but wait in virtual time."""
        icu, scheduler, answers = self._mission.icu, self._mission.scheduler, self._mission.mode_answers
        self._mission.mode_demands.append((scheduler.now_s, p["sensor"], p["mode"]))
        if p["mode"] in answers:
            if answers[p["mode"]] is None:
                scheduler.sleep(until_s - scheduler.now_s)
                raise DeadlineError("the unit does not answer")
            return answers[p["mode"]]
        demanded = icu.demand(robot, p["sensor"], p["mode"], "orchestrator")
        while (answer := icu.outcome(demanded)) is None:
            if scheduler.now_s >= until_s:
                raise DeadlineError("mode not reached before the deadline")
            next_s = demanded.machine.next_s() or 0.0
            scheduler.sleep(max(min(next_s, until_s) - scheduler.now_s, 0.001))
        return answer

    def query(self, key: str, parameters: Mapping[str, str]) -> Iterator[Reply]:
        """Query the orchestrator as a client would."""
        handler = self.handlers.get(key)
        if handler is None:
            raise NoAnswerError("no service answers")
        reply = handler(Request(key, dict(parameters), b"", "", b""))
        yield from [reply] if isinstance(reply, Reply) else without_pauses(reply)
