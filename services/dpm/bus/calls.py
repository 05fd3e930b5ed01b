# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters and bodies of a call on the bus."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeVar

from cdff_common.bus import Request
from cdff_common.contract.names import ANY_ROBOT, GROUND, ROBOT_ID
from cdff_common.contract.parameters import Parameters
from cdff_common.errors import InputError

P = TypeVar("P", bound=Parameters)


def parse_call(model: type[P], request: Request, parameters: Mapping[str, str] | None = None) -> P:
    """Return the parameters of a call, or ``parameters``, as a checked model; raises InputError.
    Every call may have the parameters ``request`` and ``robot``, which must be the robot in the key; they are
    removed if the model has no such field.
    """
    fields = dict(request.parameters if parameters is None else parameters)
    robot_under(request.scope, fields)
    for name in ("request", "robot"):
        if name not in model.model_fields:
            fields.pop(name, None)
    return model.parse(fields)


def body_map(request: Request, what: str) -> Mapping[str, Any]:
    """Return the body of a call; raises InputError if it is not a map."""
    body = request.body()
    if not isinstance(body, Mapping):
        raise InputError(f"{what}: a {type(body).__name__}, expected a map")
    return body


def robot_under(scope: str, parameters: Mapping[str, str]) -> str | None:
    """Return the robot of a call under a scope, None for all robots.

    Raises
    ------
    InputError
        If the parameter is no robot id, or names another robot than the scope.
    """
    robot = parameters.get("robot")
    if robot is not None and not re.fullmatch(ROBOT_ID, robot):
        raise InputError(f"robot={robot[:80]!r}: expected a robot id or any")
    if scope != GROUND and robot not in (None, scope):
        raise InputError(
            f"robot={robot!r} asked under the keys of {scope}: ask there for it, or under ground"
        )
    return None if robot == ANY_ROBOT else robot
