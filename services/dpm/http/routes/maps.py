# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/maps/{layer}``: windows assembled from patches."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.responses import Response

from services.dpm.http.context import Ctx
from services.dpm.http.routes.products import file_response
from services.dpm.parameters import GROUND, window_request

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])

Text = Annotated[str | None, Query(max_length=20_000)]


@router.get("/{layer}/window", response_class=Response)
def window(
    context: Ctx, layer: Literal["dem"], region: Text = None, frame: Text = None, resolution_m: Text = None,
    robot: Text = None, max_age_s: Text = None, min_coverage: Text = None, t1: Text = None,
    as_of: Text = None, choice: Text = None, disagreement: Text = None,
    format: Annotated[str, Query(max_length=16)] = "tif",
) -> Response:  # fmt: skip
    """The elevation of a region, pooled from every patch; ``CDFF-…`` headers say from what and how complete."""
    given = {
        "region": region, "frame": frame, "resolution_m": resolution_m, "robot": robot, "max_age_s": max_age_s,
        "min_coverage": min_coverage, "t1": t1, "as_of": as_of, "choice": choice, "disagreement": disagreement,
    }  # fmt: skip
    asked = {name: text for name, text in given.items() if text is not None}
    answer = context.dpm.window(window_request(GROUND, asked, context.dpm.clock.now_ns()), format, deliver="inline")
    response = file_response(answer.body, f"{layer}_window")
    m = answer.metadata
    response.headers["CDFF-Coverage"] = f"{m['coverage']:.4f}"
    response.headers["CDFF-Resolution-M"] = f"{m['resolution_m']:g}"
    response.headers["CDFF-Patches"] = str(len(m["patches"]))
    response.headers["CDFF-Disagreeing"] = str(m["disagreeing"])
    response.headers["CDFF-Newest-Ns"], response.headers["CDFF-Oldest-Ns"] = str(m["newest_ns"]), str(m["oldest_ns"])
    return response
