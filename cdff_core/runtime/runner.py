# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The loop that orders samples and steps a DFPC: the same for the host process and for replay.

Samples are stepped in (stamp_ns, port, seq) order as far as they have arrived. Within a port time only goes
forward: an older or repeated sample is dropped and counted; a port that is described as ``ordered: false``
takes older ones, and drops repeated ones alone. Across ports a sample that comes after newer ones were
stepped is stepped all the same and counted as out of order, since delayed measurements are normal on a
robot. Several consecutive ascending samples of a port that are much older than its newest one indicate a
mission clock that was set back: the port continues from there.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

from cdff_common.errors import CdffError, ConfigurationError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Header, Product, Status, product_id

#: Age relative to the newest sample of the port from which a clock was set back, nanoseconds, and the number
#: of samples that confirm it.
_BACK_NS, _BACK_SAMPLES = 10_000_000_000, 3
#: Number of samples per unordered port that are remembered to detect repetitions.
_KNOWN = 1024


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
    samples_by_port: dict[str, int] = field(default_factory=dict)
    outputs_by_port: dict[str, int] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the counters as a dictionary."""
        return asdict(self)


class Runner:
    """Steps one configured DFPC and gives its outputs their identity."""

    def __init__(self, dfpc: Dfpc) -> None:
        self._dfpc = dfpc
        self._robot = dfpc.context.robot
        self._ports = {p.attribute: p for p in dfpc.description.output_ports}
        self._inputs = {p.attribute: p for p in dfpc.description.input_ports}
        self._config_hash = dfpc.config_hash
        self._producer = f"{dfpc.name}/{dfpc.implementation}/{dfpc.description.version}"
        self._heap: list[tuple[int, str, int, int, Sample]] = []
        self._arrivals = 0
        self._newest_ns: dict[str, int] = {}
        self._behind: dict[str, tuple[int, int]] = {}
        self._known: dict[str, dict[tuple[int, int], None]] = {}
        self._stepped_ns = -(1 << 62)
        self._stepping_ns: int | None = None
        self._next_seq: dict[str, int] = {}
        self.counters = Counters()

    @property
    def pending(self) -> int:
        """Number of queued samples."""
        return len(self._heap)

    @property
    def oldest_ns(self) -> int | None:
        """Capture time of the current sample, else of the next one; None without any."""
        if self._stepping_ns is not None:
            return self._stepping_ns
        return self._heap[0][0] if self._heap else None

    def push(self, sample: Sample) -> bool:
        """Queue a sample; return False if it is not newer than the newest of its port, or repeated.

        Raises ConfigurationError if the DFPC has no such port.
        """
        if sample.port not in self._inputs:
            raise ConfigurationError(
                f"{self._dfpc.name} has no input port {sample.port!r}; it has {sorted(self._inputs)}"
            )
        newer = self._newer(sample)
        if not newer if self._inputs[sample.port].ordered else self._repeated(sample):
            self.counters.late += 1
            return False
        heapq.heappush(self._heap, (sample.stamp_ns, sample.port, sample.seq, self._arrivals, sample))
        self._arrivals += 1
        return True

    def step_one(self) -> list[Product]:
        """Step the earliest queued sample and return the products it leads to; nothing queued, nothing
        returned.

        A ``CdffError`` of the DFPC is counted and kept as ``last_error``: one bad sample does not end a
        mission. Any other exception is a bug and passes through.
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
        try:
            return [self._product(output) for output in self._dfpc.step(sample)]
        except CdffError as error:
            self.counters.errors += 1
            self.counters.last_error = f"{type(error).__name__}: {error}"
            return []
        finally:
            self._stepping_ns = None

    def drain(self) -> Iterator[Product]:
        """Step all queued samples."""
        while self._heap:
            yield from self.step_one()

    def finish(self) -> list[Product]:
        """Step the queued samples and return the final outputs of the DFPC."""
        return [*self.drain(), *(self._product(output) for output in self._dfpc.finish())]

    def provenance(self, name: str, value: Any) -> dict[str, Any]:
        """Header fields of a value that was asked for: an item of the store, the result of an operation.

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

    def _newer(self, sample: Sample) -> bool:
        """Return whether a sample is newer than all of its port, or from a clock that was set back."""
        port, stamp_ns = sample.port, sample.stamp_ns
        newest_ns = self._newest_ns.get(port)
        if newest_ns is not None and stamp_ns <= newest_ns:
            count, last_ns = self._behind.get(port, (0, -(1 << 62)))
            much = stamp_ns < newest_ns - _BACK_NS
            count = (count + 1 if stamp_ns > last_ns else 1) if much else 0
            self._behind[port] = (count, stamp_ns)
            if count < _BACK_SAMPLES:
                return False
            self._stepped_ns = -(1 << 62)
            self._known.clear()  # a repeated log has the same times and numbers
        self._behind.pop(port, None)
        self._newest_ns[port] = stamp_ns
        return True

    def _repeated(self, sample: Sample) -> bool:
        """Return whether a sample of this time and number was already received on its port."""
        known = self._known.setdefault(sample.port, {})
        key = (sample.stamp_ns, sample.seq)
        if key in known:
            return True
        known[key] = None
        if len(known) > _KNOWN:
            del known[next(iter(known))]
        return False

    def _product(self, output: Output) -> Product:
        port = self._ports.get(output.port)
        if port is None:
            raise ConfigurationError(
                f"{self._dfpc.name} emitted on {output.port!r}, which its description does not have"
            )
        status = output.quality.status
        if (output.value is None) != (status is Status.FAILED):
            raise ConfigurationError(
                f"{self._dfpc.name}.{output.port}: status {status} with value {type(output.value).__name__}"
            )
        seq = self._next_seq.get(output.port, 0)
        self._next_seq[output.port] = seq + 1
        self.counters.outputs += 1
        self.counters.degraded += status is Status.DEGRADED
        self.counters.failed += status is Status.FAILED
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
            quality=output.quality,
            box_m=extent,
            resolution_m=None if geometry is None else float(geometry.resolution_m),
        )
        return Product(
            self._robot,
            self._dfpc.name,
            output.port,
            port.product or "",
            port.type_name,
            header,
            output.value,
        )
