# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Searches of the patches of a tile."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from dpm_store.maps.patches import Patches, PatchSelection
from dpm_store.products.records import Query

if TYPE_CHECKING:
    from cdff_common.raster import GridGeometry
    from cdff_common.raster.tiles import Tile

#: A rectangle with more patches is cut from tiles.
FEW = 24
#: Largest number of patches of a tile of an earlier state, which is computed from the patches.
MOST_PATCHES = 1000
#: Margin that excludes patches which end at the edge of a rectangle.
_INSET_M = 1e-4


def tile_parts(patches: Patches, frame: str, tile: Tile) -> tuple[PatchSelection, Iterable[Tile]]:
    """Return the patches to pool in a tile with many, and the tiles of the next level to add to them."""
    from cdff_common.raster.tiles import LAST_LEVEL, cell_m

    geometry = tile.geometry(frame)
    if tile.z == LAST_LEVEL:
        return patches.find(tile_query(frame, geometry)), ()
    finer_m = cell_m(tile.z + 1) * (1.0 + 1e-6)
    coarse = patches.find(tile_query(frame, geometry, above_cell_m=finer_m))
    has_finer = patches.any(tile_query(frame, geometry, max_cell_m=finer_m))
    return coarse, tile.children() if has_finer else ()


def tile_query(
    frame: str, geometry: GridGeometry, *, above_cell_m: float | None = None, max_cell_m: float | None = None
) -> Query:
    """Return the query of patches in a rectangle with cells that are not larger than its own."""
    b = geometry.bounds
    region = Region("bbox", (b.xmin + _INSET_M, b.ymin + _INSET_M, b.xmax - _INSET_M, b.ymax - _INSET_M))
    limit_m = geometry.resolution_m * (1.0 + 1e-6) if max_cell_m is None else max_cell_m
    return Query(frame=frame, region=region, resolution_max_m=limit_m, resolution_above_m=above_cell_m)


def patches_in_state(patches: Patches, query: Query) -> PatchSelection:
    """Return the patches of a tile of a state.

    Only those that end at the query's ``t1_ns`` or before belong to it. Raises InputError if they are too
    many.
    """
    selection = patches.find(query)
    records = selection.records
    if query.t1_ns is not None:
        records = tuple(r for r in records if r.t1_ns <= query.t1_ns)
    if len(records) > MOST_PATCHES:
        raise InputError(
            f"tile of {len(records)} {patches.product} patches: expected at most {MOST_PATCHES} with a time, "
            "robot or quality; zoom in"
        )
    return replace(selection, records=records)
