# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC of a mission replay: the life cycle of a DFPC host, without a process or thread of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from cdff_common.bus import keys
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_core.runtime import Runner
from cdff_dev.mission_replay.local_bus import LocalBus
from services.dfpc_host.lifecycle import Adjustment, DfpcLifeCycle, DfpcState, serve_life_cycle

_COUNTED = ("samples", "outputs", "degraded", "failed", "late", "out_of_order", "errors")


class ReplayedDfpc(DfpcLifeCycle):
    """A DFPC of one robot, with the services of its host.

    Parameters
    ----------
    bus : LocalBus
    robot : Robot
    entry : DfpcEntry
    on_products : callable
        Called with the products of each step.

    Attributes
    ----------
    totals : dict
        Sums of the counters over all its runs.
    """

    def __init__(
        self, bus: LocalBus, robot: Robot, entry: DfpcEntry, on_products: Callable[[Sequence[Product]], None]
    ) -> None:
        super().__init__(robot, entry)
        self._bus, self._on_products = bus, on_products
        self.totals: dict[str, Any] = {
            **dict.fromkeys(_COUNTED, 0),
            "activations": 0,
            "sensor_findings": [],
        }
        self.configure()
        serve_life_cycle(bus, self, self.status, self.publish_status)
        bus.declare_alive(robot.id, entry.name)

    def publish_status(self) -> None:
        """Publish the status of the DFPC."""
        self._bus.publish_latched(keys.dfpc_status(self.robot.id, self.entry.name), self.status())

    def take(self, source: str, sample: Sample) -> None:
        """Pass a sample of a source to every port that is wired to it."""
        if sample.quality.status is Status.FAILED:
            return
        for port in [port for port, wiring in self.wired.items() if wiring == source]:
            runner = self.runner if self.state is DfpcState.ACTIVE else None
            if runner is not None and runner.push(replace(sample, port=port)):
                with self.failure_guard():
                    self.publish(list(runner.drain()))

    def finish(self) -> None:
        """Deactivate at the end of the log, which outputs the remaining products."""
        if self.state is DfpcState.ACTIVE:
            self.deactivate()
        self._count(self.runner)

    def configure(self, parameters: Mapping[str, Any] | None = None, if_match: str | None = None) -> None:
        """Create the DFPC again and add the counters of the previous run."""
        previous = self.runner
        super().configure(parameters, if_match)
        self._count(previous)

    def activate(self, inputs: Mapping[str, str] | None = None, adjustment: Adjustment | None = None) -> None:
        """Become active, and count the activation."""
        previous_state = self.state
        super().activate(inputs, adjustment)
        self.totals["activations"] += previous_state is not DfpcState.ACTIVE

    def clean_up(self) -> None:
        """Release the DFPC and add the counters of its run."""
        previous = self.runner
        super().clean_up()
        self._count(previous)

    def publish(self, products: Sequence[Product]) -> None:
        """Pass products to ``on_products``."""
        self._on_products(products)

    def on_failure(self) -> None:
        """Publish the status and an alarm."""
        self.publish_status()
        alarm = self.event(reason=self.last_error)
        self._bus.publish_map(keys.event(self.robot.id, "alarm"), alarm)

    def status(self) -> dict[str, Any]:
        """Return the status; the cost of a step is that of the description, so that plans are repeatable.

        As in a DFPC host it is the mean over the samples of all ports, whose numbers are those of the log.
        """
        body = super().status()
        cost = self.description.cost.get(body["implementation"])
        if cost is None:
            return {**body, "mean_step_cpu_s": 0.0}
        by_port: Mapping[str, int] = body.get("samples_by_port", {})
        counted = sum(n for port, n in by_port.items() if not cost.ports or port in cost.ports)
        mean_cpu_s = cost.cpu_s / cost.samples * counted / max(sum(by_port.values()), 1)
        return {**body, "mean_step_cpu_s": mean_cpu_s}

    def _count(self, runner: Runner | None) -> None:
        """Add the counters of a run that ended."""
        if runner is not None:
            for name in _COUNTED:
                self.totals[name] += getattr(runner.counters, name)
            new_findings = [finding.to_dict() for finding in runner.sensors.history]
            self.totals["sensor_findings"] = [*self.totals["sensor_findings"], *new_findings]
