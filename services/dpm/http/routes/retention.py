# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/retention``: the plan of the profile's retention rules."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from services.dpm.bus.retention import plan_dict, rules_of
from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.native_models import RetentionPlan

router = APIRouter(prefix="/api/v1/retention", tags=["retention"])


@router.get("", response_model=RetentionPlan)
def plan(context: Ctx) -> Any:
    """Return the retention plan; nothing is deleted."""
    rules = rules_of(context.profile)
    return jsonable(plan_dict(context.dpm.writer.retire(rules), len(rules), applied=False))
