# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC in its host process: subscriptions, step thread, publication, checkpoints and counters."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cdff_common import tracing
from cdff_common.bus import Bus, Message, Qos, Subscription, keys
from cdff_common.bus.message import with_context
from cdff_common.clock import monotonic_s
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.errors import CdffError, NotActiveError, OverloadedError, RefusedError
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_core.runtime.stream_counters import StreamCounters
from services.dfpc_host.calibration_alarms import CalibrationMonitor
from services.dfpc_host.inputs import StoredInput, decode_sample
from services.dfpc_host.lifecycle import Adjustment, DfpcLifeCycle, DfpcState
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.spool import SpooledProduct
from services.dfpc_host.state_store import ActivityRecord, StateStore, state_file
from services.dfpc_host.watchdog import ThreadTimes
from services.signing import Sign

logger = logging.getLogger(__name__)

#: Steps after an activation that belong to the trace of the request that activated the DFPC.
_TRACED_STEPS = 100


class HostedDfpc(DfpcLifeCycle):
    """A DFPC with its thread; steps, operations and store queries never run at the same time."""

    def __init__(
        self, bus: Bus, outbox: Outbox, robot: Robot, entry: DfpcEntry, sign: Sign | None = None
    ) -> None:
        super().__init__(robot, entry)
        self._sign = sign
        self.step_started_s: float | None = None
        self.calibration = CalibrationMonitor()
        self._malformed = 0
        self._refused_inputs = 0
        self._dropped_before = 0
        self._stored_bytes = 0
        self._trace, self._traced_steps = "", 0
        self._bus, self._outbox = bus, outbox
        file = state_file(robot.id, entry.name)
        self._state_store = StateStore(file)
        self._activity = ActivityRecord(file.with_suffix(".active"))
        self._subscriptions: dict[str, Subscription | StoredInput] = {}
        self._frames = frozenset({*robot.frame_graph().frames, f"{robot.id}/base"})
        self._streams: dict[str, StreamCounters] = {}
        self._newest_outputs: dict[str, dict[str, Any]] = {}
        self._use = threading.Lock()
        self._life = threading.RLock()
        self._queue = threading.Condition()
        self._times_s: dict[str, float] = {"last_step_s": 0.0, "max_step_s": 0.0, "step_cpu_s": 0.0}
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    # -- life cycle

    def configure(self, parameters: Mapping[str, Any] | None = None, if_match: str | None = None) -> None:
        """Create the DFPC with the parameters of the profile and restore its checkpoint."""
        with self._life, self._use:
            super().configure(parameters, if_match)
            try:
                self._state_store.restore(self.dfpc)
            except (CdffError, OSError) as error:
                self.last_error = str(error)
                logger.warning("%s starts without its checkpoint: %s", self.entry.name, error)

    def activate(self, inputs: Mapping[str, str] | None = None, adjustment: Adjustment | None = None) -> None:
        """Subscribe the inputs and start stepping; an active DFPC changes its sources or is adjusted."""
        with self._life:
            self._trace, self._traced_steps = tracing.current(), 0
            sources = self.sources(inputs or {})
            if self.state is DfpcState.ERROR:
                self.configure()
            target = self.state_after("activate")
            with self._use:
                self.adjust(adjustment)
            if self.state is DfpcState.ACTIVE:
                self._connect(sources)
                self._record_activity()
                return
            self._stopping.clear()
            self._thread = threading.Thread(target=self._run, name=f"step {self.entry.name}", daemon=True)
            self._thread.start()
            self._connect(sources)
            self.state = target
            self._record_activity()
        self._publish_event("activated")

    def continue_queue(self, new: Dfpc) -> None:
        """Step the queued samples with another DFPC from now on."""
        with self._queue:
            super().continue_queue(new)

    def reactivate(self) -> None:
        """Activate a DFPC with ``activation: always`` that was active when its last process ended.

        The orchestrator may be out of contact; for DFPCs that run on request it decides.
        """
        sources = self._activity.read()
        if sources is None or self.entry.activation != "always":
            return
        try:
            self.activate(sources)
        except CdffError as error:  # the profile has changed
            self.last_error = str(error)
            logger.warning("%s is not reactivated: %s", self.entry.name, error)

    def deactivate(self) -> None:
        """Unsubscribe, step the queued samples and publish the products that are due."""
        with self._life:
            self.state_after("deactivate")
            if self.state is DfpcState.INACTIVE:
                return
            self._stop()
            self._activity.remove()
            with self._use:
                super().deactivate()
                if self.has_failed():
                    return
                self._state_store.checkpoint(self.dfpc, now=True)
        self._publish_event("deactivated")

    def clean_up(self) -> None:
        """Release the configured DFPC and discard its data."""
        with self._life:
            self.state_after("clean_up")
            self._stop()
            self._activity.remove()
            with self._use:
                super().clean_up()

    def close(self) -> None:
        """Stop without publishing more, and write a checkpoint."""
        with self._life:
            self._stop()
            with self._use:
                if self.runner is not None:
                    self._state_store.checkpoint(self.dfpc, now=True)

    def _record_activity(self) -> None:
        if self.entry.activation == "always":
            self._activity.write(self.wired)

    def step_times(self) -> ThreadTimes | None:
        """Return the times of the thread of the steps; None if there is none."""
        thread = self._thread
        return None if thread is None else ThreadTimes.of(thread)

    # -- queries

    def call(
        self, operation: str, parameters: Mapping[str, str], timeout_s: float
    ) -> tuple[Any, dict[str, Any]]:
        """Run an operation; return the value and its provenance."""
        if self.state not in (DfpcState.ACTIVE, DfpcState.INACTIVE):
            raise NotActiveError(
                f"{self.entry.name} is {self.state}: {self.last_error or 'configure it first'}"
            )
        return self._query(operation, timeout_s, lambda: self.dfpc.call(operation, parameters))

    def store_item(self, item: str, timeout_s: float) -> tuple[Any, dict[str, Any]]:
        """Return the value of an item of the local store and its provenance."""
        if self.state is DfpcState.UNCONFIGURED:
            raise NotActiveError(f"{self.entry.name} is {self.state}")
        return self._query(item, timeout_s, lambda: self.dfpc.store.get(item))

    def _query(self, name: str, timeout_s: float, query: Callable[[], Any]) -> tuple[Any, dict[str, Any]]:
        """Return the value of a query between two steps, and its provenance."""
        if not self._use.acquire(timeout=timeout_s):
            raise OverloadedError(
                f"{self.entry.name} is busy; {name} waited {timeout_s:g} s", retry_after_s=timeout_s
            )
        try:
            value = query()
        finally:
            self._use.release()
        return value, {} if self.runner is None else self.runner.provenance(name, value)

    def status(self) -> dict[str, Any]:
        """Return state, counters, run times and last error."""
        body = super().status()
        samples = max(int(body.get("samples", 0)), 1)
        subscriptions = tuple(self._subscriptions.values())
        waiting = (s.waiting_reason for s in subscriptions if isinstance(s, StoredInput))
        with self._queue:
            oldest_ns = None if self.runner is None else self.runner.oldest_ns
        return {
            **body,
            "pending": self._pending,
            "stored_bytes": self._stored_bytes,
            "oldest_ns": oldest_ns,
            "dropped": self._dropped_before + sum(s.dropped for s in subscriptions),
            "malformed": self._malformed,
            "refused_inputs": self._refused_inputs,
            "streams": self._stream_status(),
            "newest_outputs": dict(self._newest_outputs),
            "mean_step_cpu_s": self._times_s["step_cpu_s"] / samples,
            **self._times_s,
            "last_error": body["last_error"] or next((reason for reason in waiting if reason), ""),
        }

    def _stream_status(self) -> dict[str, dict[str, Any]]:
        """Return the measurements of each connected source."""
        now_s = monotonic_s()
        streams, wired = dict(self._streams), dict(self.wired)  # other threads connect and disconnect ports
        return {source: streams[port].to_dict(now_s) for port, source in wired.items() if port in streams}

    # -- inputs

    def _connect(self, sources: Mapping[str, str]) -> None:
        """Subscribe each port to its source; a port with an unchanged source keeps its subscription."""
        types = {p.attribute: p.type_name for p in self.dfpc.description.input_ports}
        for port, source in sources.items():
            if self.wired.get(port) != source:
                self._disconnect(port)
                self._streams[port] = StreamCounters(self._frames)
                self._subscriptions[port] = self._subscribe(port, types[port], source)
                self.wired[port] = source

    def _subscribe(self, port: str, type_name: str, source: str) -> Subscription | StoredInput:
        def on_message(message: Message) -> None:
            self._receive(message, port, type_name)

        if source.startswith("dpm/"):
            return StoredInput(self._bus, source, f"{self.entry.name}.{port}", on_message)
        return self._bus.subscribe(keys.source(self.robot.id, source), on_message, depth=self.entry.queue)

    def _disconnect(self, port: str) -> None:
        subscription = self._subscriptions.pop(port, None)
        self._streams.pop(port, None)
        self.wired.pop(port, None)
        if subscription is not None:
            subscription.close()
            self._dropped_before += subscription.dropped

    def _stop(self) -> None:
        """Close the subscriptions and end the step thread."""
        for port in tuple(self._subscriptions):
            self._disconnect(port)
        self._stopping.set()
        with self._queue:
            self._queue.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=self.entry.step_timeout_s)
        self._thread = None

    def _receive(self, message: Message, port: str, type_name: str) -> None:
        """Decode and queue a message in the thread of its subscription.

        The thread waits while the queue is full, so that the ring buffer of the subscription counts drops.
        """
        try:
            sample = decode_sample(message, port, type_name)
        except RefusedError:  # the producer reported FAILED; the message itself is valid
            self._refused_inputs += 1
            return
        except CdffError as error:
            self._malformed += 1
            self.last_error = f"{port}: {error}"
            logger.warning("%s.%s: malformed input on %s: %s", self.entry.name, port, message.key, error)
            return
        if (stream := self._streams.get(port)) is not None:
            now_ns = self._bus.mission_clock.now_ns()
            stream.add(sample, now_ns, monotonic_s())
            if self.runner is not None:
                self.runner.sensors.add_arrival(sample, now_ns)
        assert self.runner is not None
        with self._queue:
            while self.runner.pending >= self.entry.queue and not self._stopping.is_set():
                self._queue.wait(0.1)
            if not self._stopping.is_set():
                self.runner.push(sample)
                self._queue.notify_all()

    # -- step thread

    def _run(self) -> None:
        stopping = self._stopping
        while not stopping.is_set():
            with self._queue:
                self._queue.wait_for(lambda: self._pending or stopping.is_set(), timeout=1.0)
            if not self._pending:
                continue
            stopping.wait(self.entry.reorder_s)
            while not stopping.is_set() and self._step():
                pass

    @property
    def _pending(self) -> int:
        """Number of queued samples."""
        return 0 if self.runner is None else self.runner.pending

    def _step(self) -> bool:
        """Step one sample; return False if the queue is empty or the DFPC failed."""
        with self._use:
            with self._queue:
                runner = self.runner
                if self.has_failed() or runner is None or not runner.pending:
                    return False
            started_s, cpu_s = monotonic_s(), time.thread_time()
            self.step_started_s = started_s
            with self.failure_guard(), tracing.span(f"{self.entry.name}.step", self._context_of_step()):
                products = runner.step_one()
                self._state_store.checkpoint_first(self.dfpc)
                self.publish(products)
                self._state_store.checkpoint(self.dfpc)
            self.step_started_s = None
            if self.has_failed():
                return False
            took_s = monotonic_s() - started_s
            self._times_s["last_step_s"] = took_s
            self._times_s["max_step_s"] = max(self._times_s["max_step_s"], took_s)
            self._times_s["step_cpu_s"] += time.thread_time() - cpu_s
        with self._queue:
            self._queue.notify_all()
        return True

    def _context_of_step(self) -> str:
        """Return the context of the activation for the first steps after it, then nothing."""
        self._traced_steps += 1
        return self._trace if self._traced_steps <= _TRACED_STEPS else ""

    def on_failure(self) -> None:
        """Stop stepping, and publish an alarm."""
        self._stopping.set()
        self._publish_event("alarm", reason=self.last_error)

    def publish(self, products: Sequence[Product]) -> None:
        """Publish products on their keys and queue them for the DPM."""
        self.calibration.add(product.header.quality for product in products)
        for product in products:
            quality = product.header.quality
            self._newest_outputs[product.port] = {
                "product": product.product,
                "t1_ns": product.header.t1_ns,
                "status": str(quality.status),
                "reasons": list(quality.reasons),
            }
            type_name = product.type_name if product.value is None else wire_type(product.value)
            payload = b"" if product.value is None else encode(product.value, "uper")
            encoding, header = encoding_string(type_name, "uper"), product.header
            names = {
                "robot": product.robot,
                "dfpc": product.dfpc,
                "port": product.port,
                "product": product.product,
            }
            if self._sign is not None and payload:
                header = self._sign(names, encoding, header, payload)
            attachment = header.to_attachment()
            self._bus.publish(
                keys.product(product.robot, product.dfpc, product.port),
                payload,
                encoding=encoding,
                attachment=attachment,
                qos=Qos.POSE if product.type_name == "TransformWithCovariance" else Qos.PRODUCT,
            )
            if payload and product.product:
                self._stored_bytes += len(payload)
                self._outbox.put(
                    SpooledProduct(
                        **names, payload=payload, encoding=encoding, attachment=with_context(attachment)
                    )
                )

    def _publish_event(self, kind: str, **more: Any) -> None:
        self._bus.publish_map(keys.event(self.robot.id, kind), self.event(**more))
