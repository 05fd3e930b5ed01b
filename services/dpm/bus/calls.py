# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters and bodies of a call on the bus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from cdff_common.bus import Request
from cdff_common.contract.parameters import Parameters
from cdff_common.errors import InputError
from services.dpm.queries.store_queries import robot_under

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
