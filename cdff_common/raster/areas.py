# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Areas of a navigation map as polygons that err to the safe side when they are made simpler."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.navigation import CLASS
from cdff_common.types.ground_areas_ext import AreaKind

if TYPE_CHECKING:
    from cdff_common.types import GroundAreas, NavigationMap

#: The classes that say something.
CLASSES = (AreaKind.SAFE, AreaKind.CAUTION, AreaKind.HAZARD)
#: Kinds that join classes, and the classes; any other kind is a class itself.
_JOINED = {AreaKind.PASSABLE: (1, 2), AreaKind.BLOCKED: (0, 3)}
#: Kinds that a tolerance makes smaller.
_SHRINKING = (AreaKind.SAFE, AreaKind.PASSABLE)


def outlined(value: NavigationMap, kinds: Sequence[AreaKind], tolerance_m: float = 0.0) -> GroundAreas:
    """Areas of the kinds, along the edges of their cells, or fewer corners within a tolerance of those.

    Cells that touch at a corner only are apart.

    Parameters
    ----------
    value : NavigationMap
        Of its layers ``class`` is looked at.
    kinds : sequence of AreaKind
    tolerance_m : float, default 0
        How far an outline may move: what is safe or passable only shrinks, everything else only grows.

    Returns
    -------
    GroundAreas
        In the map's frame and of its time.
    """
    import shapely

    from cdff_common.types import GroundAreas

    found = [(_polygons(value, kind, tolerance_m), kind) for kind in kinds]
    polygons = np.concatenate([part for part, _ in found]) if found else np.zeros(0, object)
    rings, area = shapely.get_rings(polygons, return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    first_again = np.flatnonzero(np.diff(ring, append=len(rings)))
    return GroundAreas.from_rings(
        np.repeat([kind for _, kind in found], [len(part) for part, _ in found]),
        np.bincount(area, minlength=len(polygons)),
        np.bincount(ring, minlength=len(rings)) - 1,
        np.delete(corners, first_again, axis=0),
        frame=value.frame,
        t0_ns=value.t0_ns,
        t1_ns=value.t1_ns,
        resolution_m=value.geometry.resolution_m,
        tolerance_m=tolerance_m,
    )


def _polygons(value: NavigationMap, kind: AreaKind, tolerance_m: float) -> NDArray[Any]:
    """Polygons of a kind, outer rings counter-clockwise, holes clockwise."""
    import rasterio
    import shapely
    from rasterio.features import shapes

    inside = np.isin(value.layer(CLASS), _JOINED.get(kind, (int(kind),))).astype(np.uint8)
    g = value.geometry
    placed = rasterio.Affine(g.resolution_m, 0.0, g.xmin_m, 0.0, -g.resolution_m, g.ymax_m)
    found: Any = [
        shapely.geometry.shape(s) for s, _ in shapes(inside, mask=inside > 0, connectivity=4, transform=placed)
    ]
    if tolerance_m > 0.0:
        # Half of the tolerance to the safe side, then no more than half of it back.
        half_m = 0.5 * tolerance_m
        moved = shapely.buffer(found, -half_m if kind in _SHRINKING else half_m, join_style="mitre")
        simpler = shapely.simplify(shapely.get_parts(shapely.union_all(moved)), half_m)
        found = [part for part in simpler if not part.is_empty]
    oriented: NDArray[Any] = shapely.orient_polygons(np.array(found, dtype=object))
    return oriented
