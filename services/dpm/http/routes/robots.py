# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/robots``: robots, their poses and DFPCs."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from cdff_common.errors import CdffError, ProductNotFoundError
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.native_models import Items, Robot

router = APIRouter(prefix="/api/v1/robots", tags=["robots"])


@router.get("", response_model=Items[Robot])
def robots(context: Ctx) -> dict[str, Any]:
    """Return every robot of the profile, with products, or with running services."""
    return {"items": [_robot(context, robot) for robot in sorted(_known(context))]}


@router.get("/{robot}", response_model=Robot)
def robot(context: Ctx, robot: str) -> Any:
    """Return one robot."""
    if robot not in _known(context):
        raise ProductNotFoundError(f"no robot {robot[:64]!r}")
    return _robot(context, robot)


def _known(context: Context) -> set[str]:
    robots = {robot for robot, _ in context.dpm.store.statistics().products}
    robots |= {robot.robot for robot in context.dpm.store.robots.all()}
    if context.profile is not None:
        robots |= set(context.profile.robot_ids)
    if context.watch is not None:
        robots |= context.watch.robots()
    return robots - {"ground"}


def _robot(context: Context, robot: str) -> Any:
    try:
        pose: dict[str, Any] | None = context.dpm.frames.pose("site", f"{robot}/base", None, robot=robot)
        missing = ""
    except CdffError as error:
        pose, missing = None, str(error)
    services = context.watch.services().get(robot, []) if context.watch is not None else []
    dfpcs = context.watch.dfpcs(robot) if context.watch is not None else []
    described = {known.robot: known.to_dict() for known in context.dpm.store.robots.all()}
    return jsonable(
        {
            "id": robot,
            "pose": pose,
            "pose_missing": missing,
            "dfpcs": dfpcs,
            "services": services,
            "described": described.get(robot),
            "profile_revision": context.watch.revision(robot) if context.watch is not None else "",
            "has_left": context.watch.has_left(robot) if context.watch is not None else False,
        }
    )
