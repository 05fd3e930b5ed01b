# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Store queries of the parameters of an operation."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from cdff_common.contract.names import ANY_ROBOT
from cdff_common.contract.products import product_type
from cdff_common.contract.queries import (
    CloudParameters,
    ElevationParameters,
    HistoryViewParameters,
    MapParameters,
    NavigationWindowParameters,
    ProfileParameters,
    RegionParameters,
    SearchParameters,
)
from cdff_common.raster.cell_selection import Choice, Disagreement
from dpm_store import Query
from dpm_store.frames.frames import HistoryView
from dpm_store.maps.windows import WindowQuery

Q = TypeVar("Q", Query, WindowQuery)
#: Fields of store queries whose parameters have another name.
_STORE_NAMES = {
    "type": "types",
    "t0": "t0_ns",
    "t1": "t1_ns",
    "after": "inserted_after",
    "tag": "tags",
    "as_of": "as_of_ns",
    "quality": "metrics",
    "newest_after": "newest_after_ns",
}
_SUPERSEDED = {"include": None, "exclude": False, "only": True}


def search_query(p: SearchParameters) -> Query:
    """Return the store query of a search; raises InputError for an unknown product type."""
    for name in p.type:
        product_type(name)
    return _query(Query, p, frame=p.region_frame or p.frame, superseded=_SUPERSEDED[p.superseded])


def cloud_query(p: CloudParameters) -> Query:
    """Return the store query of an assembled cloud."""
    return _query(Query, p)


def window_query(p: MapParameters | ProfileParameters, now_ns: int) -> WindowQuery:
    """Return the store query of a window or profile; ``max_age_s`` counts back from ``now_ns``."""
    other: dict[str, Any] = {}
    if isinstance(p, MapParameters) and p.max_age_s is not None:
        other["newest_after_ns"] = max(p.newest_after or 0, now_ns - int(p.max_age_s * 1e9))
    if isinstance(p, ElevationParameters):
        is_kept = p.disagreement is Disagreement.KEEP
        other["choice"] = p.choice or (Choice.WEIGHTED if is_kept else Choice.POOLED)
    if isinstance(p, NavigationWindowParameters):
        other |= {"choice": Choice.POOLED, "navigation_choice": p.choice}
    return _query(WindowQuery, p, **other)


def history_view(p: HistoryViewParameters) -> HistoryView:
    """Return the state of the store and of the frame tree to answer from."""
    return HistoryView(p.as_of, p.frames_revision)


def _query(kind: type[Q], p: RegionParameters | ProfileParameters, **other: Any) -> Q:
    """Return a store query with the parameters that it has fields for, and with other values."""
    values = {_STORE_NAMES.get(name, name): value for name, value in p} | {
        "robot": None if p.robot == ANY_ROBOT else p.robot,
        **other,
    }
    return kind(**{field.name: values[field.name] for field in fields(kind) if field.name in values})
