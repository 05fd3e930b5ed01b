# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One DFPC in its host: subscriptions while active, a thread that steps it, products out, state and counters."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, Message, Qos, Subscription, keys
from cdff_common.clock import monotonic_s
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import CdffError, InputError, NotActiveError, OverloadedError, RefusedError
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.catalogue import description_of
from cdff_core.runtime import Runner
from services.dfpc_host.inputs import sample_of
from services.dfpc_host.keeping import Activity, Keeper, state_file
from services.dfpc_host.lifecycle import State, next_state
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.spool import Parcel
from services.dfpc_host.stored import StoredInput

logger = logging.getLogger(__name__)


class HostedDfpc:
    """A DFPC, its life cycle and its thread.

    Steps, operations and store queries never run at the same time: a DFPC is single-threaded.
    """

    def __init__(self, bus: Bus, outbox: Outbox, robot: Robot, entry: DfpcEntry) -> None:
        self.robot, self.entry = robot, entry
        self._state = State.UNCONFIGURED
        #: How often the state has changed: tells an old status from a new one.
        self.changes = 0
        self.step_started_s: float | None = None
        self.malformed = 0
        self.refused_inputs = 0
        self.last_error = ""
        self._bus, self._outbox = bus, outbox
        self._dfpc: Dfpc = Registry.default().make_dfpc(entry.name)
        self._runner: Runner | None = None
        self._keeper = Keeper(state_file(robot.id, entry.name))
        self._activity = Activity(state_file(robot.id, entry.name).with_suffix(".active"))
        self.wired: dict[str, str] = {}
        self._subscriptions: dict[str, Subscription | StoredInput] = {}
        self._dropped_before = 0
        self._use = threading.Lock()
        self._life = threading.RLock()
        self._queue = threading.Condition()
        self._times_s: dict[str, float] = {"last_step_s": 0.0, "max_step_s": 0.0, "step_cpu_s": 0.0}
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    @property
    def state(self) -> State:
        """Where it stands."""
        return self._state

    @state.setter
    def state(self, state: State) -> None:
        self.changes += state is not self._state
        self._state = state

    # -- life cycle ---------------------------------------------------------------------------------------------

    def configure(self, parameters: Mapping[str, Any] | None = None) -> None:
        """Make the DFPC anew with the profile's parameters, overridden by ``parameters``."""
        with self._life, self._use:
            target = next_state("configure", self.state, self.entry.name)
            dfpc = Registry.default().make_dfpc(self.entry.name)
            merged = {**self.entry.parameters, **(parameters or {})}
            try:
                dfpc.configure(merged, self.robot.context(self.entry), self.entry.implementation)
            except CdffError as error:
                self.last_error = str(error)
                raise
            try:
                self._keeper.give_back(dfpc)
            except (CdffError, OSError) as error:
                self.last_error = str(error)
                logger.warning("%s begins anew: %s", self.entry.name, error)
            self._dfpc, self._runner = dfpc, Runner(dfpc)
            self.state = target

    def activate(self, inputs: Mapping[str, str] | None = None) -> None:
        """Subscribe the inputs and start stepping; where it is active, take inputs from elsewhere.

        Parameters
        ----------
        inputs : mapping of str to str, optional
            For ports that the profile wires to alternatives: the one to take. Others take the first that is wired.

        Raises
        ------
        InputError
            If a source is none of those that the profile wires to the port.
        """
        with self._life:
            wired = self._chosen(inputs or {})
            if self.state is State.ERROR:
                self.configure()
            target = next_state("activate", self.state, self.entry.name)
            if self.state is State.ACTIVE:
                self._rewire({**self.wired, **{port: wired[port] for port in inputs or {}}})
                self._keep_activity()
                return
            self._stopping.clear()
            self._thread = threading.Thread(target=self._run, name=f"step {self.entry.name}", daemon=True)
            self._thread.start()
            self._rewire(wired)
            self.state = target
            self._keep_activity()
        self._announce("activated")

    def reactivate(self) -> None:
        """Go on where the last process of this DFPC was active when it ended: the orchestrator may be out of contact.

        Only what is to be on always; for requests the orchestrator decides.
        """
        wired = self._activity.left()
        if wired is None or self.entry.activation != "always":
            return
        try:
            self.activate(wired)
        except CdffError as error:  # the profile is another one now
            self.last_error = str(error)
            logger.warning("%s is not active again by itself: %s", self.entry.name, error)

    def _keep_activity(self) -> None:
        if self.entry.activation == "always":
            self._activity.keep(self.wired)

    def _chosen(self, inputs: Mapping[str, str]) -> dict[str, str]:
        """What feeds each wired port: as chosen, else the first of the profile's alternatives."""
        for port, source in inputs.items():
            known = self.entry.inputs.get(port, "").split("|")
            if source not in known:
                raise InputError(
                    f"{self.entry.name}.{port}: {source!r} is not wired to it; expected {' or '.join(known)}"
                )
        return {port: inputs.get(port, wiring.split("|")[0]) for port, wiring in self.entry.inputs.items()}

    def _rewire(self, wired: Mapping[str, str]) -> None:
        """Have each port fed from its source; those that are already stay subscribed."""
        types = {p.attribute: p.type_name for p in self._dfpc.description.input_ports}
        for port, source in wired.items():
            if self.wired.get(port) != source:
                self._unsubscribe(port)
                self._subscribe(port, types[port], source)
                self.wired[port] = source

    def deactivate(self) -> None:
        """Unsubscribe, step what has arrived, publish what is owed; nothing to do where it is inactive."""
        with self._life:
            target = next_state("deactivate", self.state, self.entry.name)
            if self.state is State.INACTIVE:
                return
            self._unsubscribe()
            self._stop_thread()
            self._activity.end()
            self.state = target
            with self._use:
                assert self._runner is not None
                self._publish_all(self._runner.finish())
                self._keeper.keep(self._dfpc, now=True)
        self._announce("deactivated")

    def clean_up(self) -> None:
        """Give back what configuration took; what it knew is forgotten."""
        with self._life:
            target = next_state("clean_up", self.state, self.entry.name)
            self._unsubscribe()
            self._stop_thread()
            self._activity.end()
            with self._use:
                self._dfpc, self._runner = Registry.default().make_dfpc(self.entry.name), None
                self.state, self.last_error = target, ""

    def close(self) -> None:
        """Let go of everything without publishing more; keep what must survive."""
        with self._life:
            self._unsubscribe()
            self._stop_thread()
            with self._use:
                if self._runner is not None:
                    self._keeper.keep(self._dfpc, now=True)

    # -- asked from outside ---------------------------------------------------------------------------------------

    def call(self, operation: str, parameters: Mapping[str, str], timeout_s: float) -> tuple[Any, dict[str, Any]]:
        """Run an operation; return the value and its provenance."""
        if self.state not in (State.ACTIVE, State.INACTIVE):
            raise NotActiveError(f"{self.entry.name} is {self.state}: {self.last_error or 'configure it first'}")
        self._acquire(timeout_s, operation)
        try:
            value = self._dfpc.call(operation, parameters)
        finally:
            self._use.release()
        return value, self._provenance(operation, value)

    def store_item(self, item: str, timeout_s: float) -> tuple[Any, dict[str, Any]]:
        """Return the value of an item of the local store and its provenance."""
        if self.state is State.UNCONFIGURED:
            raise NotActiveError(f"{self.entry.name} is {self.state}")
        self._acquire(timeout_s, f"store/{item}")
        try:
            value = self._dfpc.store.get(item)
        finally:
            self._use.release()
        return value, self._provenance(item, value)

    def _provenance(self, name: str, value: Any) -> dict[str, Any]:
        return {} if self._runner is None else self._runner.provenance(name, value)

    def describe(self) -> dict[str, Any]:
        """Ports, wiring, needs, cost and state, for the orchestrator's catalogue."""
        description = Registry.default().dfpc(self.entry.name)
        body = description_of(self.robot, self.entry, description)
        for output in body["outputs"]:
            output["key"] = keys.product(self.robot.id, self.entry.name, output["port"])
        return {
            **body,
            "state": str(self.state),
            "wired": dict(self.wired),
            "config_hash": "" if self._runner is None else self._dfpc.config_hash,
            "operations": [op.name for op in description.operations],
            "store": [] if self._runner is None else list(self._dfpc.store.items),
        }

    def status(self) -> dict[str, Any]:
        """State, counters, run times, last error."""
        counters = {} if self._runner is None else self._runner.counters.to_dict()
        step_error = str(counters.pop("last_error", ""))
        samples = max(int(counters.get("samples", 0)), 1)
        return {
            "name": self.entry.name,
            "robot": self.robot.id,
            "state": str(self.state),
            "changes": self.changes,
            "wired": dict(self.wired),
            **counters,
            "pending": 0 if self._runner is None else self._runner.pending,
            "oldest_ns": self._oldest_ns(),
            "dropped": self._dropped_before + sum(s.dropped for s in tuple(self._subscriptions.values())),
            "malformed": self.malformed,
            "refused_inputs": self.refused_inputs,
            "mean_step_cpu_s": self._times_s["step_cpu_s"] / samples,
            **self._times_s,
            "last_error": self.last_error or step_error or self._waiting(),
        }

    def _waiting(self) -> str:
        """Why an input from the DPM has not come; empty where all have."""
        stored = (s for s in tuple(self._subscriptions.values()) if isinstance(s, StoredInput))
        return next((s.waits for s in stored if s.waits), "")

    def _oldest_ns(self) -> int | None:
        """Capture time of the oldest sample that is not done with, None when nothing waits."""
        with self._queue:
            return None if self._runner is None else self._runner.oldest_ns

    # -- inside -----------------------------------------------------------------------------------------------------

    def _acquire(self, timeout_s: float, what: str) -> None:
        if not self._use.acquire(timeout=timeout_s):
            raise OverloadedError(f"{self.entry.name} is busy; {what} waited {timeout_s:g} s", retry_after_s=timeout_s)

    def _subscribe(self, port: str, type_name: str, source: str) -> None:
        def on_message(message: Message) -> None:
            self._take(message, port, type_name)

        if source.startswith("dpm/"):
            self._subscriptions[port] = StoredInput(self._bus, source, f"{self.entry.name}.{port}", on_message)
            return
        key = keys.source(self.robot.id, source)
        self._subscriptions[port] = self._bus.subscribe(key, on_message, depth=self.entry.queue)

    def _unsubscribe(self, *ports: str) -> None:
        """Close the subscriptions of some ports, of all without any."""
        for port in ports or tuple(self._subscriptions):
            subscription = self._subscriptions.pop(port, None)
            self.wired.pop(port, None)
            if subscription is not None:
                subscription.close()
                self._dropped_before += subscription.dropped

    def _stop_thread(self) -> None:
        self._stopping.set()
        with self._queue:
            self._queue.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=self.entry.step_timeout_s)
        self._thread = None

    def _take(self, message: Message, port: str, type_name: str) -> None:
        """Decode in the subscription's thread; wait there while the queue is full, so that the ring counts drops."""
        try:
            sample = sample_of(message, port, type_name)
        except RefusedError:  # its producer said FAILED: nothing is wrong with the message
            self.refused_inputs += 1
            return
        except CdffError as error:
            self.malformed += 1
            self.last_error = f"{port}: {error}"
            logger.warning("%s.%s: malformed input on %s: %s", self.entry.name, port, message.key, error)
            return
        assert self._runner is not None
        with self._queue:
            while self._runner.pending >= self.entry.queue and not self._stopping.is_set():
                self._queue.wait(0.1)
            if not self._stopping.is_set():
                self._runner.push(sample)
                self._queue.notify_all()

    def _run(self) -> None:
        assert self._runner is not None
        runner, stopping = self._runner, self._stopping
        while not stopping.is_set():
            with self._queue:
                self._queue.wait_for(lambda: runner.pending or stopping.is_set(), timeout=1.0)
            if not runner.pending:
                continue
            stopping.wait(self.entry.reorder_s)
            while not stopping.is_set() and self._step(runner):
                pass

    def _step(self, runner: Runner) -> bool:
        """Step one sample; False when nothing is queued or the DFPC broke."""
        with self._use:
            with self._queue:
                if not runner.pending:
                    return False
            started_s, cpu_s = monotonic_s(), time.thread_time()
            self.step_started_s = started_s
            try:
                products = runner.step_one()
                self._keeper.keep_first(self._dfpc)
                self._publish_all(products)
                self._keeper.keep(self._dfpc)
            except Exception as error:  # a bug in a DFPC must not take its neighbours along
                logger.exception("%s raised; it is switched to error", self.entry.name)
                self.last_error = f"{type(error).__name__}: {error}"
                self.state = State.ERROR
                self._stopping.set()
                self._announce("alarm", reason=self.last_error)
                return False
            finally:
                self.step_started_s = None
            took_s = monotonic_s() - started_s
            self._times_s["last_step_s"] = took_s
            self._times_s["max_step_s"] = max(self._times_s["max_step_s"], took_s)
            self._times_s["step_cpu_s"] += time.thread_time() - cpu_s
        with self._queue:
            self._queue.notify_all()
        return True

    def _publish_all(self, products: list[Product]) -> None:
        for product in products:
            payload = b"" if product.value is None else encode(product.value, "uper")
            encoding = encoding_string(product.type_name if product.value is None else wire_type(product.value), "uper")
            attachment = product.header.to_attachment()
            qos = Qos.POSE if product.type_name == "TransformWithCovariance" else Qos.PRODUCT
            self._bus.publish(
                keys.product(product.robot, product.dfpc, product.port),
                payload,
                encoding=encoding,
                attachment=attachment,
                qos=qos,
            )
            if payload and product.product:
                self._outbox.put(
                    Parcel(product.robot, product.dfpc, product.port, product.product, payload, encoding, attachment)
                )

    def _announce(self, kind: str, **more: Any) -> None:
        body = {"robot": self.robot.id, "dfpc": self.entry.name, "state": str(self.state), **more}
        self._bus.publish_map(keys.event(self.robot.id, kind), body)
