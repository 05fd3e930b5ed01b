# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The exchange as a part of a DPM process: its end, and ``dpm/@rpc/contact``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.contract.names import GROUND
from cdff_common.contract.queries import ContactParameters, RequestParameters
from cdff_common.errors import CdffError, InputError
from cdff_common.interfaces.contact_plan import load_contact_plan
from cdff_common.interfaces.profile import Exchange
from services.contact.ground_end import GroundEnd
from services.contact.robot_end import RobotEnd
from services.dpm.bus.calls import body_map, parse_call
from services.dpm.operations.dpm import Dpm

#: Time for the answer of the orchestrator after its own deadline, seconds.
_GRACE_S = 1.0
#: Longest deadline of a request on the robot, seconds.
_DEADLINE_S = 600.0


def start_exchange(
    bus: Bus, dpm: Dpm, plan: Path, endpoint: str, robot: str | None, exchange: Exchange
) -> RobotEnd | GroundEnd:
    """Start the end of a robot, or that of the ground if ``robot`` is None, and answer calls about it.

    Raises
    ------
    ConfigurationError
        If the plan cannot be read.
    UnavailableError
        If the endpoint of the ground cannot be listened on.
    """
    contact_plan = load_contact_plan(plan)
    if robot is None:
        ground = GroundEnd(dpm, contact_plan, endpoint, exchange)
        bus.serve(keys.dpm_rpc(GROUND, "contact"), lambda request: Reply.of(answer(ground, request)))
        return ground

    def execute(parameters: dict[str, str], left_s: float) -> dict[str, Any]:
        return execute_on_bus(bus, robot, parameters, left_s)

    end = RobotEnd(robot, dpm, contact_plan, endpoint, exchange, execute)
    bus.serve(keys.dpm_rpc(robot, "contact"), lambda _: Reply.of(end.status()))
    return end


def answer(ground: GroundEnd, request: Request) -> dict[str, Any]:
    """Return the status of all robots, windows, the estimate of a robot, or requests.

    With a body a request is kept; with ``first`` a product is sent before all others.

    Raises
    ------
    InputError
        If a parameter is missing or wrong.
    ProductNotFoundError
        For an unknown request.
    """
    p = parse_call(ContactParameters, request)
    if request.payload:
        body = body_map(request, "request")
        parameters = body.get("parameters")
        if p.robot is None or not isinstance(parameters, dict):
            raise InputError("a request for a robot: expected robot= and a body {parameters: {type: …}}")
        expires = {} if p.expires_s is None else {"expires_s": p.expires_s}
        return ground.requests.add(p.robot, parameters, request_id=p.id, **expires)
    if p.first is not None:
        if p.robot is None:
            raise InputError("first: the parameter robot is missing")
        return ground.prioritise(p.robot, p.first)
    if p.id is not None:
        return ground.requests.get(p.id)
    match p.what:
        case "status":
            return {"robots": ground.status()}
        case "plan":
            return {"items": ground.windows(p.robot)}
        case "requests":
            return {"items": ground.requests.everything()}
        case _ if p.robot is None:
            raise InputError("what=estimate: the parameter robot is missing")
    return ground.estimate(p.robot, p.limit)


def execute_on_bus(bus: Bus, robot: str, parameters: dict[str, str], left_s: float) -> dict[str, Any]:
    """Return the answer of the orchestrator on the robot: ``{id}``, or ``{error}``."""
    asked = {name: value for name, value in parameters.items() if name != "robot"}
    try:
        deadline_ms = RequestParameters.parse(asked).deadline_ms
        deadline_s = min(deadline_ms / 1000.0, left_s, _DEADLINE_S)
        asked |= {"deliver": "reference", "deadline_ms": str(int(deadline_s * 1000))}
        reply = bus.call(keys.orchestrator_rpc(robot, "request"), asked, timeout_s=deadline_s + _GRACE_S)
    except CdffError as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {"id": reply.attachment.get("id")}
