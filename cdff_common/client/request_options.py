# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keyword arguments of a request, and their conversion to query parameters."""

from __future__ import annotations

from datetime import datetime
from typing import Any, TypedDict, Unpack

from cdff_common.contract.queries import RequestParameters

#: Default of ``as`` by product, if neither it nor a format is given: for a DEM all layers instead of one.
_DEFAULT_AS = {"dem": "ElevationMap"}
#: Names that differ on the wire.
WIRE_NAMES = {"t_ns": "t", "as_type": "as"}


class RequestOptions(TypedDict, total=False):
    """Keyword arguments of a request; None is the default of each.

    Attributes
    ----------
    region, region_frame
        ``bbox:… box:… circle:x,y,r polygon:… near:frame,r``, metres, and its frame, by default ``frame``.
    frame
        Frame of the product; default ``site``.
    child, t_ns
        Child frame and mission time of a pose, nanoseconds or a datetime with a time zone; default: base of
        the robot, the newest.
    max_age_s
        Largest age.
    resolution_m
        Cell size to which finer data are aggregated.
    min_coverage
        Smallest covered fraction of the region, 0 to 1.
    max_oldest_age_s
        Largest age of the oldest part of a map.
    max_sigma_m, max_sigma_deg
        Largest standard deviations of the position, or of the elevation of a map, and of the orientation.
    covariance_kind, status
        Weakest kind of covariance, ``formal`` or ``calibrated``; ``OK`` for no DEGRADED product.
    as_type, format, deliver
        InFuse type, encoding (``uper ber xer msgpack tif ply tum png``), ``auto inline reference``.
    priority
        0 to 9, default 5; 9 is served first.
    acquire
        One acquisition for the request: ``now``, or its parameters, as ``pan_deg:30,tilt_deg:-10``.
    """

    acquire: str | None
    region: str | None
    region_frame: str | None
    frame: str | None
    child: str | None
    t_ns: int | datetime | None
    max_age_s: float | None
    resolution_m: float | None
    min_coverage: float | None
    max_oldest_age_s: float | None
    max_sigma_m: float | None
    max_sigma_deg: float | None
    covariance_kind: str | None
    status: str | None
    as_type: str | None
    format: str | None
    deliver: str | None
    priority: int | None


def parameters_of(product: str, robot: str, **options: Unpack[RequestOptions]) -> dict[str, Any]:
    """Return the checked parameters of a request for ``product`` of ``robot`` (an id, or ``any``)."""
    if options.get("as_type") is None and options.get("format") is None:
        options["as_type"] = _DEFAULT_AS.get(product)
    parameters = {WIRE_NAMES.get(name, name): value for name, value in options.items() if value is not None}
    return RequestParameters.parse({"type": product, "robot": robot, **parameters}).to_parameters()
