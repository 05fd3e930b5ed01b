# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Areas of a navigation map as polygons, simplified conservatively."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.navigation import CLASS
from cdff_common.types.ground_areas_ext import AreaKind

if TYPE_CHECKING:
    from cdff_common.types import GroundAreas, NavigationMap

#: Known classes.
CLASSES = (AreaKind.SAFE, AreaKind.CAUTION, AreaKind.HAZARD)
#: Kinds that combine classes, and these classes; any other kind is a class itself.
_CLASSES_OF_KIND = {AreaKind.PASSABLE: (1, 2), AreaKind.BLOCKED: (0, 3)}
#: Kinds that are shrunk by a tolerance.
_SHRINKING = (AreaKind.SAFE, AreaKind.PASSABLE)


def area_outlines(value: NavigationMap, kinds: Sequence[AreaKind], tolerance_m: float = 0.0) -> GroundAreas:
    """Return the areas of the kinds, along the edges of their cells, or simplified within a tolerance.

    Cells with only a common corner are not connected.

    Parameters
    ----------
    value : NavigationMap
        Map with a layer ``class``.
    kinds : sequence of AreaKind
    tolerance_m : float, default 0
        Largest displacement of an outline: safe and passable areas only shrink, all others only grow.

    Returns
    -------
    GroundAreas
        Areas in the frame and with the time of the map.
    """
    import shapely

    from cdff_common.types import GroundAreas

    polygons_of_kinds = [(_polygons(value, kind, tolerance_m), kind) for kind in kinds]
    polygons = (
        np.concatenate([part for part, _ in polygons_of_kinds]) if polygons_of_kinds else np.zeros(0, object)
    )
    rings, area = shapely.get_rings(polygons, return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    closing_corners = np.flatnonzero(np.diff(ring, append=len(rings)))
    return GroundAreas.from_rings(
        np.repeat([kind for _, kind in polygons_of_kinds], [len(part) for part, _ in polygons_of_kinds]),
        np.bincount(area, minlength=len(polygons)),
        np.bincount(ring, minlength=len(rings)) - 1,
        np.delete(corners, closing_corners, axis=0),
        frame=value.frame,
        t0_ns=value.t0_ns,
        t1_ns=value.t1_ns,
        resolution_m=value.geometry.resolution_m,
        tolerance_m=tolerance_m,
    )


def _polygons(value: NavigationMap, kind: AreaKind, tolerance_m: float) -> NDArray[Any]:
    """Return the polygons of a kind, outer rings counter-clockwise, holes clockwise."""
    import rasterio
    import shapely
    from rasterio.features import shapes

    inside = np.isin(value.layer(CLASS), _CLASSES_OF_KIND.get(kind, (int(kind),))).astype(np.uint8)
    g = value.geometry
    cell_to_metres = rasterio.Affine(g.resolution_m, 0.0, g.xmin_m, 0.0, -g.resolution_m, g.ymax_m)
    polygons: Any = [
        shapely.geometry.shape(s)
        for s, _ in shapes(inside, mask=inside > 0, connectivity=4, transform=cell_to_metres)
    ]
    if tolerance_m > 0.0:
        # Half of the tolerance to the safe side, then at most half of it back.
        half_m = 0.5 * tolerance_m
        buffered = shapely.buffer(polygons, -half_m if kind in _SHRINKING else half_m, join_style="mitre")
        simplified = shapely.simplify(shapely.get_parts(shapely.union_all(buffered)), half_m)
        polygons = [part for part in simplified if not part.is_empty]
    oriented: NDArray[Any] = shapely.orient_polygons(np.array(polygons, dtype=object))
    return oriented
