# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What may be wished of a product, as Python names, and the parameters of contract §5 that say it."""

from __future__ import annotations

from typing import TypedDict, Unpack

#: What a DEM is asked ``as`` where the caller names neither type nor format: all layers instead of one.
_DEFAULT_AS = {"dem": "ElevationMap"}
#: Names that differ on the wire.
_ON_THE_WIRE = {"t_ns": "t", "as_type": "as"}


class Wishes(TypedDict, total=False):
    """Keyword arguments of a request besides product, robot and deadline; None is not said."""

    region: str | None
    region_frame: str | None
    frame: str | None
    child: str | None
    t_ns: int | None
    max_age_s: float | None
    resolution_m: float | None
    min_coverage: float | None
    as_type: str | None
    format: str | None
    deliver: str | None
    priority: int | None


def parameters_of(product: str, robot: str, **wishes: Unpack[Wishes]) -> dict[str, object]:
    """Return the parameters of a request for ``product`` of ``robot`` (an id, or ``any``)."""
    if wishes.get("as_type") is None and wishes.get("format") is None:
        wishes["as_type"] = _DEFAULT_AS.get(product)
    said = {_ON_THE_WIRE.get(name, name): value for name, value in wishes.items() if value is not None}
    return {"type": product, "robot": robot, **said}
