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


def search_query(parameters: SearchParameters) -> Query:
    """Return the store query of a search; raises InputError for an unknown product type."""
    for name in parameters.type:
        product_type(name)
    return _query(
        Query,
        parameters,
        frame=parameters.region_frame or parameters.frame,
        superseded=_SUPERSEDED[parameters.superseded],
    )


def cloud_query(parameters: CloudParameters) -> Query:
    """Return the store query of an assembled cloud."""
    return _query(Query, parameters)


def window_query(parameters: MapParameters | ProfileParameters, now_ns: int) -> WindowQuery:
    """Return the store query of a window or profile; ``max_age_s`` counts back from ``now_ns``."""
    other: dict[str, Any] = {}
    if isinstance(parameters, MapParameters) and parameters.max_age_s is not None:
        other["newest_after_ns"] = max(parameters.newest_after or 0, now_ns - int(parameters.max_age_s * 1e9))
    if isinstance(parameters, ElevationParameters):
        is_kept = parameters.disagreement is Disagreement.KEEP
        other["choice"] = parameters.choice or (Choice.WEIGHTED if is_kept else Choice.POOLED)
    if isinstance(parameters, NavigationWindowParameters):
        other |= {"choice": Choice.POOLED, "navigation_choice": parameters.choice}
    return _query(WindowQuery, parameters, **other)


def history_view(parameters: HistoryViewParameters) -> HistoryView:
    """Return the state of the store and of the frame tree to answer from."""
    return HistoryView(parameters.as_of, parameters.frames_revision)


def _query(kind: type[Q], parameters: RegionParameters | ProfileParameters, **other: Any) -> Q:
    """Return a store query with the parameters that it has fields for, and with other values."""
    values = {_STORE_NAMES.get(name, name): value for name, value in parameters} | {
        "robot": None if parameters.robot == ANY_ROBOT else parameters.robot,
        **other,
    }
    return kind(**{field.name: values[field.name] for field in fields(kind) if field.name in values})
