# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Life cycle, wiring and status of one DFPC, without thread, process or middleware.

``HostedDfpc`` adds subscriptions, a step thread and storage; the replay of a mission can use the same class.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

from cdff_common.bus import Reply, Request, keys
from cdff_common.contract.wiring import Wiring
from cdff_common.errors import (
    CdffError,
    ConflictError,
    InputError,
    NotActiveError,
    UnavailableError,
    public_text,
)
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.registry import Registry
from cdff_core.consistency.finding import Finding
from cdff_core.orchestration.catalogue import description_of
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS
from cdff_core.runtime import Runner

logger = logging.getLogger(__name__)


class DfpcState(StrEnum):
    """State of a hosted DFPC; the transitions are ``DFPC_TRANSITIONS``."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    ERROR = "error"


def next_state(verb: str, state: DfpcState, name: str) -> DfpcState:
    """Return the state after ``verb``; raises NotActiveError if the verb is not allowed."""
    target = DFPC_TRANSITIONS.get((str(state), verb))
    if target is None:
        allowed = sorted({s for s, v in DFPC_TRANSITIONS if v == verb})
        raise NotActiveError(f"{name} is {state}: {verb} is allowed when {' or '.join(allowed)}")
    return DfpcState(target)


@dataclass(frozen=True, slots=True)
class Adjustment:
    """Implementation of a DFPC, by default that of the profile, and values of adjustable parameters."""

    implementation: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)


class DfpcLifeCycle(ABC):
    """A DFPC of a robot with its state, wiring and counters.

    Not thread-safe: a caller with threads serialises the calls.

    Attributes
    ----------
    robot, entry
        Robot and DFPC entry of the profile.
    dfpc : Dfpc
    runner : Runner or None
        None while the DFPC is unconfigured.
    wired : dict of str to str
        Source of each connected input port; empty unless active.
    adjusted : dict of str to float
        Parameters that requests have adjusted.
    changes : int
        Number of changes of state or configuration; orders status messages.
    last_error : str
    """

    def __init__(self, robot: Robot, entry: DfpcEntry) -> None:
        self.robot, self.entry = robot, entry
        self.description = Registry.default().dfpc(entry.name)
        self.dfpc: Dfpc = Registry.default().make_dfpc(entry.name)
        self.runner: Runner | None = None
        self.wired: dict[str, str] = {}
        self.adjusted: dict[str, float] = {}
        self.changes = 0
        self.last_error = ""
        self._state = DfpcState.UNCONFIGURED

    @property
    def state(self) -> DfpcState:
        """Current state."""
        return self._state

    @state.setter
    def state(self, state: DfpcState) -> None:
        self.changes += state is not self._state
        self._state = state

    def state_after(self, verb: str) -> DfpcState:
        """Return the state after ``verb``; raises NotActiveError if the verb is not allowed."""
        return next_state(verb, self._state, self.entry.name)

    @property
    def config_hash(self) -> str:
        """Hash of the configuration; empty while the DFPC is unconfigured."""
        return "" if self.runner is None else self.dfpc.config_hash

    def configure(self, parameters: Mapping[str, Any] | None = None, if_match: str | None = None) -> None:
        """Create the DFPC with the parameters of the profile, overridden by ``parameters``.

        Parameters
        ----------
        parameters : mapping, optional
        if_match : str, optional
            Hash of the configuration from which the parameters were made, so that they do not overwrite those
            of another client.

        Raises
        ------
        ConflictError
            If the DFPC has another configuration than ``if_match``.
        """
        target = self.state_after("configure")
        if if_match is not None and if_match != self.config_hash:
            raise ConflictError(
                f"{self.entry.name}: if_match={if_match[:40]}: the configuration is {self.config_hash!r}; "
                "describe the DFPC again"
            )
        self.dfpc, self.adjusted = self._configured(parameters or {}, None), {}
        self.runner = Runner(self.dfpc)
        self.state = target

    def _configured(self, parameters: Mapping[str, Any], implementation: str | None) -> Dfpc:
        """Return a new DFPC with parameters in place of those of the profile, and an implementation."""
        dfpc = Registry.default().make_dfpc(self.entry.name)
        name = implementation or self.entry.choices(self.description)[0]
        try:
            dfpc.configure({**self.entry.parameters, **parameters}, self.robot.context(self.entry), name)
        except CdffError as error:
            self.last_error = str(error)
            raise
        return dfpc

    def activate(self, inputs: Mapping[str, str] | None = None, adjustment: Adjustment | None = None) -> None:
        """Become active with the sources in ``inputs``; an active DFPC only changes its sources.

        Raises
        ------
        InputError
            If a source is not among the alternatives of its port in the profile, or an adjustment is not
            allowed.
        """
        target = self.state_after("activate")
        sources = self.sources(inputs or {})
        self.adjust(adjustment)
        self.wired = sources
        self.state = target

    def adjust(self, adjustment: Adjustment | None) -> bool:
        """Change implementation and adjustable parameters; return True if the DFPC was configured again.

        Before that it steps the queued samples and publishes the products that are due; its state, if it has
        one, is continued. None and an equal adjustment change nothing.

        Raises
        ------
        InputError
            If a parameter is not adjustable or outside its bounds, or the profile does not admit the
            implementation.
        UnavailableError
            If the DFPC fails at a queued sample; it is then in state error.
        """
        if adjustment is None or self.runner is None:
            return False
        name = self.checked_implementation(adjustment)
        if (name, adjustment.parameters) == (self.dfpc.implementation, self.adjusted):
            return False
        live = {a.parameter for a in self.description.adjustable if a.live}
        changed = {p for p, _ in adjustment.parameters.items() ^ self.adjusted.items()}
        new = self._configured(adjustment.parameters, name)
        is_live = name == self.dfpc.implementation and changed <= live
        if is_live:
            self.dfpc.config = new.config
            new = self.dfpc
        elif self._state is DfpcState.ACTIVE and not self._publish_pending(self.runner):
            raise UnavailableError(f"{self.entry.name}: {self.last_error}")
        self._replace(new, adjustment.parameters)
        logger.info("%s is adjusted: %s %s", self.entry.name, name, self.adjusted or "as in the profile")
        return not is_live

    def _replace(self, new: Dfpc, adjusted: Mapping[str, float]) -> None:
        """Continue with another DFPC, to which the state is passed if it has one that fits."""
        if new is not self.dfpc and (state := self.dfpc.state()) is not None:
            try:
                new.resume(state)
            except CdffError as error:
                new.reset()
                logger.warning("%s starts without its state: %s", self.entry.name, error)
        self.continue_queue(new)
        self.dfpc, self.adjusted = new, dict(adjusted)
        self.changes += 1

    def continue_queue(self, new: Dfpc) -> None:
        """Step the queued samples with another DFPC from now on."""
        assert self.runner is not None
        self.runner = self.runner.continued(new)

    def checked_implementation(self, adjustment: Adjustment) -> str:
        """Return the implementation of an adjustment; raises InputError as ``adjust``."""
        admitted = self.entry.choices(self.description)
        name = adjustment.implementation or admitted[0]
        if name not in admitted:
            raise InputError(
                f"{self.entry.name}: implementation {name!r}; the profile admits {', '.join(admitted)}"
            )
        adjustable = {a.parameter: a for a in self.description.adjustable}
        for parameter, value in adjustment.parameters.items():
            bounds = adjustable.get(parameter)
            if bounds is None:
                expected = ", ".join(adjustable) or "none"
                raise InputError(
                    f"{self.entry.name}: {parameter} is not adjustable; adjustable are {expected}"
                )
            if not bounds.least <= value <= bounds.greatest:
                allowed = f"{bounds.least:g} to {bounds.greatest:g}"
                raise InputError(f"{self.entry.name}: {parameter}={value}: expected {allowed}")
        return name

    def deactivate(self) -> None:
        """Become inactive, step the queued samples and publish the products that are due."""
        target, is_active = self.state_after("deactivate"), self._state is DfpcState.ACTIVE
        self.wired = {}
        self.state = target
        if not is_active or self.runner is None or not self._publish_pending(self.runner):
            return
        if (self.dfpc.implementation, self.adjusted) != (self.entry.choices(self.description)[0], {}):
            self._replace(self._configured({}, None), {})

    def _publish_pending(self, runner: Runner) -> bool:
        """Step the queued samples and publish each product; return False if the DFPC failed."""
        with self.failure_guard():
            for product in runner.finish():
                self.publish([product])
        return not self.has_failed()

    def clean_up(self) -> None:
        """Release the configured DFPC and discard its data."""
        target = self.state_after("clean_up")
        self.dfpc, self.runner = Registry.default().make_dfpc(self.entry.name), None
        self.wired = {}
        self.state, self.last_error = target, ""

    def sources(self, inputs: Mapping[str, str]) -> dict[str, str]:
        """Return the source of each wired port: the selected, the current or the first alternative.

        Raises
        ------
        InputError
            If a selected source is not among the alternatives of its port in the profile.
        """
        for port, source in inputs.items():
            wiring = self.entry.inputs.get(port)
            known = [str(s) for s in Wiring.parse(wiring).sources] if wiring else []
            if source not in known:
                raise InputError(
                    f"{self.entry.name}.{port}: {source!r} is not wired to it; expected {' or '.join(known)}"
                )
        current = self.wired if self._state is DfpcState.ACTIVE else {}
        first = {port: str(Wiring.parse(text).default) for port, text in self.entry.inputs.items()}
        return {**first, **current, **inputs}

    @abstractmethod
    def publish(self, products: Sequence[Product]) -> None:
        """Deliver products in their order."""

    def has_failed(self) -> bool:
        """Return True in state error."""
        return self._state is DfpcState.ERROR

    @abstractmethod
    def on_failure(self) -> None:
        """Report the switch to state error; called by ``failure_guard``."""

    @contextmanager
    def failure_guard(self) -> Iterator[None]:
        """Switch to state error on any exception: a bug in one DFPC must not stop the others."""
        try:
            yield
        except Exception as error:
            logger.exception("%s raised; it is switched to error", self.entry.name)
            self.last_error = public_text(error)
            self.state = DfpcState.ERROR
            self.on_failure()

    def describe(self) -> dict[str, Any]:
        """Return ports, wiring, needs, cost and state for the catalogue of the orchestrator."""
        body = description_of(self.robot, self.entry, self.description)
        for output in body["outputs"]:
            output["key"] = keys.product(self.robot.id, self.entry.name, output["port"])
        return {
            **body,
            "state": str(self.state),
            "wired": dict(self.wired),
            "config_hash": self.config_hash,
            "parameters": {} if self.runner is None else self.dfpc.config.model_dump(mode="json"),
            "operations": [op.name for op in self.description.operations],
            "store": [] if self.runner is None else list(self.dfpc.store.items),
        }

    def status(self) -> dict[str, Any]:
        """Return state, counters and last error."""
        counters = {} if self.runner is None else self.runner.counters.to_dict()
        step_error = str(counters.pop("last_error", ""))
        return {
            "name": self.entry.name,
            "robot": self.robot.id,
            "state": str(self.state),
            "changes": self.changes,
            "wired": dict(self.wired),
            "implementation": self.dfpc.implementation if self.runner else "",
            "adjusted": dict(self.adjusted),
            **counters,
            "sensor_findings": [finding.to_dict() for finding in self.sensor_findings],
            "unknown_frames": {} if self.runner is None else self.runner.sensors.unknown_frames,
            "last_error": self.last_error or step_error,
        }

    @property
    def sensor_findings(self) -> tuple[Finding, ...]:
        """Findings about the sensors of the inputs; none while the DFPC is not active."""
        is_active = self.runner is not None and self.state is DfpcState.ACTIVE
        return self.runner.sensors.findings if is_active and self.runner is not None else ()

    def event(self, **more: Any) -> dict[str, Any]:
        """Return the body of an event about this DFPC."""
        return {"robot": self.robot.id, "dfpc": self.entry.name, "state": str(self.state), **more}


class _Server(Protocol):
    """The part of a bus that answers calls."""

    def serve(self, key: str, handler: Callable[[Request], Reply], *, workers: int) -> object: ...


def serve_life_cycle(
    bus: _Server,
    dfpc: DfpcLifeCycle,
    status: Callable[[], Mapping[str, Any]],
    publish_status: Callable[[], None],
) -> None:
    """Answer ``@rpc/{describe|status|configure|activate|deactivate|clean_up}`` of a DFPC.

    ``configure?if_match=HASH`` is refused if ``config_hash`` of ``describe`` is not this hash.

    Parameters
    ----------
    bus : Bus
    dfpc : DfpcLifeCycle
    status : callable
        Returns the body of ``status``.
    publish_status : callable
        Called after each change of state.
    """
    reports = {"describe": dfpc.describe, "status": status}
    changes: dict[str, Callable[[Request], None]] = {
        "configure": lambda request: dfpc.configure(_parameters(request), request.parameters.get("if_match")),
        "activate": lambda request: dfpc.activate(*_activation(request)),
        "deactivate": lambda _: dfpc.deactivate(),
        "clean_up": lambda _: dfpc.clean_up(),
    }

    def answer(request: Request) -> Reply:
        verb = request.key.rsplit("/", 1)[1]
        request.check_parameters(*(("if_match",) if verb == "configure" else ()))
        if verb in reports:
            return Reply.of(reports[verb]())
        changes[verb](request)
        publish_status()
        implementation = dfpc.dfpc.implementation if dfpc.runner else ""
        body = {"state": str(dfpc.state), "implementation": implementation, "adjusted": dict(dfpc.adjusted)}
        return Reply.of(body, changes=dfpc.changes)

    for verb in (*reports, *changes):
        bus.serve(keys.dfpc_rpc(dfpc.robot.id, dfpc.entry.name, verb), answer, workers=1)


def _parameters(request: Request) -> dict[str, Any] | None:
    body = request.body() if request.payload else None
    if body is not None and not isinstance(body, dict):
        raise InputError(f"configure: body is a {type(body).__name__}, expected a map of parameters")
    return body


def _activation(request: Request) -> tuple[dict[str, str], Adjustment | None]:
    """Return the sources in the body of ``activate``, and the adjustment if it has one."""
    body = request.body() if request.payload else {}
    if not isinstance(body, dict) or body.keys() - {"inputs", "implementation", "parameters"}:
        raise InputError("activate: expected a body {inputs, implementation, parameters}, or none")
    inputs, parameters = body.get("inputs", {}), body.get("parameters", {})
    if not isinstance(inputs, dict):
        raise InputError("activate: expected inputs {port: source}")
    if not isinstance(parameters, dict) or not all(_is_number(v) for v in parameters.values()):
        raise InputError("activate: expected parameters {name: number}")
    sources = {str(port): str(source) for port, source in inputs.items()}
    if not body.keys() & {"implementation", "parameters"}:
        return sources, None
    implementation = body.get("implementation")
    name = None if implementation is None else str(implementation)
    return sources, Adjustment(name, {str(p): float(v) for p, v in parameters.items()})


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
