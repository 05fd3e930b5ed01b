# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC of a rehearsal: the life cycle of the host process without process or thread."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from cdff_common.bus import Reply, Request, keys
from cdff_common.errors import CdffError, InputError, NotActiveError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.catalogue import description_of
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS
from cdff_core.runtime import Runner
from services.rehearsal.local_bus import LocalBus

logger = logging.getLogger(__name__)

_COUNTED = ("samples", "outputs", "degraded", "failed", "late", "out_of_order", "errors")


class RehearsedDfpc:
    """One DFPC of one robot, with the endpoints of its process.

    Parameters
    ----------
    bus : LocalBus
    robot : Robot
    entry : DfpcEntry
    on_products : callable
        Takes what it makes.

    Attributes
    ----------
    totals : dict
        Counters of all its runs together.
    """

    def __init__(
        self, bus: LocalBus, robot: Robot, entry: DfpcEntry, on_products: Callable[[list[Product]], None]
    ) -> None:
        self._bus, self._robot, self._entry, self._on_products = bus, robot, entry, on_products
        self._described = Registry.default().dfpc(entry.name)
        self._runner: Runner | None = None
        self._wired: dict[str, str] = {}
        self._state, self._last_error = "unconfigured", ""
        self.totals: dict[str, Any] = {**dict.fromkeys(_COUNTED, 0), "activations": 0}
        self._configure({})
        endpoints: dict[str, Callable[[Request], dict[str, Any]]] = {
            "describe": self._describe, "status": lambda _: self.status(), "configure": self._configure_anew,
            "activate": self._activate, "deactivate": self._deactivate, "clean_up": self._clean_up,
        }  # fmt: skip
        for verb, handler in endpoints.items():
            bus.serve(keys.dfpc_rpc(robot.id, entry.name, verb), _answering(handler))
        bus.declare_alive(robot.id, entry.name)

    def beat(self) -> None:
        """Tell the status."""
        self._bus.publish_latched(keys.dfpc_status(self._robot.id, self._entry.name), self.status())

    def take(self, source: str, sample: Sample) -> None:
        """Step what a source delivers, on every port that it feeds now."""
        if sample.quality.status is Status.FAILED:
            return
        for port in [port for port, wiring in self._wired.items() if wiring == source]:
            if self._state == "active" and self._runner is not None and self._runner.push(replace(sample, port=port)):
                self._on_products(self._guarded(self._runner.drain))

    def finish(self) -> None:
        """Give out what it owes at the end of the log."""
        if self._state == "active":
            self._deactivate(None)
        self._count()

    # -- endpoints --------------------------------------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """As the host process tells it. What a step costs is what is declared, so that plans do not vary by machine."""
        counters = {} if self._runner is None else self._runner.counters.to_dict()
        implementation = self._entry.implementation or self._described.implementations[0].name
        cost = self._described.cost.get(implementation)
        return {
            "name": self._entry.name, "robot": self._robot.id, **counters, "state": self._state, "wired": self._wired,
            "mean_step_cpu_s": 0.0 if cost is None else cost.cpu_s / cost.samples,
            "last_error": self._last_error or counters.get("last_error", ""),
        }  # fmt: skip

    def _describe(self, _: Request) -> dict[str, Any]:
        described = description_of(self._robot, self._entry, self._described)
        return {**described, "state": self._state, "wired": self._wired}

    def _configure_anew(self, request: Request) -> dict[str, Any]:
        body = request.body() if request.payload else {}
        if not isinstance(body, dict):
            raise InputError(f"configure: body is a {type(body).__name__}, expected a map of parameters")
        return self._configure(body)

    def _configure(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        after = self._after("configure")
        dfpc = Registry.default().make_dfpc(self._entry.name)
        try:
            context = self._robot.context(self._entry)
            dfpc.configure({**self._entry.parameters, **parameters}, context, self._entry.implementation)
        except CdffError as error:
            self._last_error = str(error)
            raise
        self._count()
        self._runner = Runner(dfpc)
        return self._is_now(after)

    def _activate(self, request: Request) -> dict[str, Any]:
        after = self._after("activate")
        body = request.body() if request.payload else {}
        first = {port: wiring.split("|")[0] for port, wiring in self._entry.inputs.items()}
        self._wired = {**first, **self._wired, **body.get("inputs", {})}
        self.totals["activations"] += self._state != "active"
        return self._is_now(after)

    def _deactivate(self, _: Request | None) -> dict[str, Any]:
        after, was = self._after("deactivate"), self._state
        self._wired = {}
        told = self._is_now(after)
        if was == "active" and self._runner is not None:
            self._on_products(self._guarded(self._runner.finish))
        return told

    def _clean_up(self, _: Request) -> dict[str, Any]:
        after = self._after("clean_up")
        self._count()
        self._runner, self._wired = None, {}
        return self._is_now(after)

    # -- inside -----------------------------------------------------------------------------------------------------

    def _after(self, verb: str) -> str:
        after = DFPC_TRANSITIONS.get((self._state, verb))
        if after is None:
            raise NotActiveError(f"{self._robot.id}/{self._entry.name} is {self._state}: it cannot {verb}")
        return after

    def _is_now(self, state: str) -> dict[str, Any]:
        self._state = state
        self.beat()
        return {"state": state}

    def _guarded(self, run: Callable[[], Iterable[Product]]) -> list[Product]:
        try:
            return list(run())
        except Exception as error:  # a bug in a DFPC must not take its neighbours along
            logger.exception("%s of %s raised; it is switched to error", self._entry.name, self._robot.id)
            self._last_error = f"{type(error).__name__}: {error}"
            self._is_now(DFPC_TRANSITIONS["active", "fail"])
            body = {"robot": self._robot.id, "dfpc": self._entry.name, "state": "error", "reason": self._last_error}
            self._bus.publish_map(keys.event(self._robot.id, "alarm"), body)
            return []

    def _count(self) -> None:
        """Add the counters of the run that ends."""
        if self._runner is not None:
            counters = self._runner.counters
            for name in _COUNTED:
                self.totals[name] += getattr(counters, name)
            self._runner = None


def _answering(handler: Callable[[Request], dict[str, Any]]) -> Callable[[Request], Reply]:
    return lambda request: Reply.of(handler(request))
