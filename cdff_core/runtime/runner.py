# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runner that orders samples and steps a DFPC, the same for the host process and for replay.

Samples that have arrived are stepped in the order (stamp_ns, port, seq). Within a port, a sample that is not
newer than the last one is dropped and counted as late; a port described as ``ordered: false`` accepts older
samples and drops only repeated ones. Across ports, a sample that arrives after newer samples were stepped is
stepped nevertheless and counted as out of order, since delayed measurements are normal on a robot. Several
consecutive ascending samples of a port that are much older than its newest one indicate that the mission
clock was set back: the port continues from there.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from cdff_common.errors import CdffError, ConfigurationError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Header, Product, Quality, Status, product_id
from cdff_core.consistency.monitor import SensorMonitor

#: Evidence that the clock was set back: age of samples relative to the newest one of their port, nanoseconds,
#: and number of such samples.
_BACK_NS, _BACK_SAMPLES = 10_000_000_000, 3
#: Number of samples per unordered port that are stored to detect repetitions.
_HISTORY_LENGTH = 1024


@dataclass(slots=True)
class Counters:
    """Numbers of inputs and outputs of a DFPC since it was configured."""

    samples: int = 0
    outputs: int = 0
    degraded: int = 0
    failed: int = 0
    late: int = 0
    out_of_order: int = 0
    errors: int = 0
    last_error: str = ""
    last_failure: str = ""  # reasons of the last FAILED output
    samples_by_port: dict[str, int] = field(default_factory=dict)
    outputs_by_port: dict[str, int] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the counters as a dictionary."""
        return asdict(self)


class Runner:
    """Steps one configured DFPC and adds ids and headers to its outputs."""

    def __init__(self, dfpc: Dfpc) -> None:
        self._dfpc = dfpc
        self._robot = dfpc.context.robot
        #: Product name and type of each output port.
        self._ports = {p.attribute: (p.product or "", p.type_name) for p in dfpc.description.output_ports}
        self._inputs = {p.attribute: p for p in dfpc.description.input_ports}
        self._config_hash = dfpc.config_hash
        self._producer = f"{dfpc.name}/{dfpc.implementation}/{dfpc.description.version}"
        self._heap: list[tuple[int, str, int, int, Sample]] = []
        self._arrivals = 0
        self._newest_ns: dict[str, int] = {}  # newest accepted sample of each port
        #: Number of consecutive much older samples of each port, and the stamp of the last one.
        self._behind: dict[str, tuple[int, int]] = {}
        self._received: dict[str, dict[tuple[int, int], None]] = {}  # stamps and numbers, oldest first
        self._stepped_ns = -(1 << 62)  # newest stepped sample
        self._stepping_ns: int | None = None  # sample that is being stepped
        self._next_seq: dict[str, int] = {}
        self.counters = Counters()
        #: Comparison of the sensors of the inputs; its findings are reasons of the products.
        self.sensors = SensorMonitor(dfpc.context, dfpc.description.input_ports)

    def continued(self, dfpc: Dfpc) -> Runner:
        """Return a runner of a DFPC that replaces this one's: with its queue, order and counters."""
        runner = Runner(dfpc)
        for name in (
            *("_heap", "_arrivals", "_newest_ns", "_behind", "_received", "_stepped_ns", "_next_seq"),
            *("counters", "sensors"),
        ):
            setattr(runner, name, getattr(self, name))
        return runner

    @property
    def pending(self) -> int:
        """Number of queued samples."""
        return len(self._heap)

    @property
    def oldest_ns(self) -> int | None:
        """Capture time of the sample that is being stepped, else of the next one; None without samples."""
        if self._stepping_ns is not None:
            return self._stepping_ns
        return self._heap[0][0] if self._heap else None

    def push(self, sample: Sample) -> bool:
        """Queue a sample; return False if it is dropped as late or repeated.

        Raises ConfigurationError if the DFPC has no such port.
        """
        if sample.port not in self._inputs:
            raise ConfigurationError(
                f"{self._dfpc.name} has no input port {sample.port!r}; it has {sorted(self._inputs)}"
            )
        is_newer = self._is_newer(sample)
        is_accepted = is_newer if self._inputs[sample.port].ordered else not self._is_repeated(sample)
        if not is_accepted:
            self.counters.late += 1
            return False
        heapq.heappush(self._heap, (sample.stamp_ns, sample.port, sample.seq, self._arrivals, sample))
        self._arrivals += 1
        return True

    def step_one(self) -> list[Product]:
        """Step the earliest queued sample and return its products; empty if no sample is queued.

        A ``CdffError`` of the DFPC is counted and stored as ``last_error``, so that one unusable sample does
        not end a mission. Any other exception is a programming error and propagates.
        """
        if not self._heap:
            return []
        sample = heapq.heappop(self._heap)[-1]
        if sample.stamp_ns < self._stepped_ns:
            self.counters.out_of_order += 1
        self._stepped_ns = max(self._stepped_ns, sample.stamp_ns)
        self.counters.samples += 1
        by_port = self.counters.samples_by_port
        by_port[sample.port] = by_port.get(sample.port, 0) + 1
        self._stepping_ns = sample.stamp_ns
        self.sensors.add(sample)
        try:
            return [self._product(output) for output in self._dfpc.step(sample)]
        except CdffError as error:
            self.counters.errors += 1
            self.counters.last_error = f"{type(error).__name__}: {error}"
            return []
        finally:
            self._stepping_ns = None

    def drain(self) -> Iterator[Product]:
        """Step all queued samples and yield their products."""
        while self._heap:
            yield from self.step_one()

    def finish(self) -> Iterator[Product]:
        """Step the queued samples and yield their products, then the final outputs of the DFPC."""
        yield from self.drain()
        yield from map(self._product, self._dfpc.finish())

    def provenance(self, name: str, value: Any) -> dict[str, Any]:
        """Return the header fields of a requested value: a store item or the result of an operation.

        Fields that the value does not have (time, frame) are omitted.
        """
        fields: dict[str, Any] = {"producer": self._producer, "config_hash": self._config_hash}
        geometry = getattr(value, "geometry", None)
        frame = (
            getattr(value, "parent_frame", None)
            or getattr(value, "frame", None)
            or getattr(geometry, "frame", None)
        )
        stamp_ns = getattr(value, "stamp_ns", None)
        if frame and stamp_ns is not None:
            extent = value.extent_m()
            header = Header(
                id=product_id(self._robot, self._dfpc.name, name, stamp_ns, 0, self._config_hash),
                seq=0,
                t0_ns=getattr(value, "t0_ns", stamp_ns),
                t1_ns=stamp_ns,
                frame=frame,
                child=getattr(value, "child_frame", None) or None,
                box_m=None if extent is None else tuple(extent),
                resolution_m=None if geometry is None else float(geometry.resolution_m),
                **fields,
            )
            return header.to_dict()
        return fields

    def _is_newer(self, sample: Sample) -> bool:
        """Return whether a sample is newer than all others of its port, or the clock was set back."""
        port, stamp_ns = sample.port, sample.stamp_ns
        newest_ns = self._newest_ns.get(port)
        if newest_ns is not None and stamp_ns <= newest_ns:
            count, last_ns = self._behind.get(port, (0, -(1 << 62)))
            is_far_behind = stamp_ns < newest_ns - _BACK_NS
            count = (count + 1 if stamp_ns > last_ns else 1) if is_far_behind else 0
            self._behind[port] = (count, stamp_ns)
            if count < _BACK_SAMPLES:
                return False
            self._stepped_ns = -(1 << 62)
            self._received.clear()  # a repeated log has the same times and numbers
        self._behind.pop(port, None)
        self._newest_ns[port] = stamp_ns
        return True

    def _is_repeated(self, sample: Sample) -> bool:
        """Return whether a sample of this time and number was already received on its port."""
        received = self._received.setdefault(sample.port, {})
        key = (sample.stamp_ns, sample.seq)
        if key in received:
            return True
        received[key] = None
        if len(received) > _HISTORY_LENGTH:
            del received[next(iter(received))]
        return False

    def _with_sensor_reasons(self, quality: Quality, stamp_ns: int) -> Quality:
        """Return a quality that is at most DEGRADED while sensors of the inputs disagree."""
        reasons = tuple(r for r in self.sensors.reasons(stamp_ns) if r not in quality.reasons)
        if not reasons:
            return quality
        status = Status.FAILED if quality.status is Status.FAILED else Status.DEGRADED
        return replace(quality, status=status, reasons=(*quality.reasons, *reasons))

    def _product(self, output: Output) -> Product:
        """Return the product of an output; raises ConfigurationError if it contradicts the description."""
        port = self._ports.get(output.port)
        if port is None:
            raise ConfigurationError(
                f"{self._dfpc.name}: output on port {output.port!r}, which is not in its description"
            )
        quality = self._with_sensor_reasons(output.quality, output.t1_ns)
        status = quality.status
        if (output.value is None) != (status is Status.FAILED):
            raise ConfigurationError(
                f"{self._dfpc.name}.{output.port}: status {status} with value {type(output.value).__name__}"
            )
        seq = self._next_seq.get(output.port, 0)
        self._next_seq[output.port] = seq + 1
        self.counters.outputs += 1
        self.counters.degraded += status is Status.DEGRADED
        if status is Status.FAILED:
            self.counters.failed += 1
            self.counters.last_failure = ", ".join(quality.reasons)
        by_port = self.counters.outputs_by_port
        by_port[output.port] = by_port.get(output.port, 0) + 1
        extent = None if output.value is None else output.value.extent_m()
        geometry = getattr(output.value, "geometry", None)
        header = Header(
            id=product_id(self._robot, self._dfpc.name, output.port, output.t1_ns, seq, self._config_hash),
            seq=seq,
            t0_ns=output.t0_ns,
            t1_ns=output.t1_ns,
            frame=output.frame,
            child=output.child,
            producer=self._producer,
            config_hash=self._config_hash,
            inputs=output.inputs,
            quality=quality,
            box_m=extent,
            resolution_m=None if geometry is None else float(geometry.resolution_m),
        )
        return Product(
            self._robot,
            self._dfpc.name,
            output.port,
            *port,
            header,
            output.value,
        )
