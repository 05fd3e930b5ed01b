# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/retention``: what the profile's rules would let go, and why; nothing goes by asking."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from services.dpm.http.context import Ctx, jsonable
from services.dpm.http.native_models import RetentionPlan
from services.dpm.retention import plan_told, rules_of

router = APIRouter(prefix="/api/v1/retention", tags=["retention"])


@router.get("", response_model=RetentionPlan)
def plan(context: Ctx) -> dict[str, Any]:
    """What would go, and what stays though its rule lets it go: a dry run."""
    rules = rules_of(context.profile)
    data: dict[str, Any] = jsonable(plan_told(context.dpm.retire(rules), len(rules), applied=False))
    return data
