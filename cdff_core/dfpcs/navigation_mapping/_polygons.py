# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Areas of a navigation map as polygons that err to the safe side when they are made simpler."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import NavigationMap

Float = NDArray[np.float64]

#: Classes of each kind of area, and whether simpler means larger.
KINDS = {"free": ((1,), False), "passable": ((1, 2), False), "hazard": ((3,), True), "blocked": ((0, 3), True)}


def rings(value: NavigationMap, kind: str, tolerance_m: float) -> Float:
    """Rings ``(n, 2)`` of the areas of a kind, one after another, each closed by its first corner; metres.

    Parameters
    ----------
    kind : str
        Of ``KINDS``.
    tolerance_m : float
        How far an outline may move: free areas only shrink, hazards only grow.

    Notes
    -----
    Outer rings run counter-clockwise, holes clockwise after the ring they are in.
    """
    import rasterio
    import shapely
    from rasterio.features import shapes

    classes, grows = KINDS[kind]
    inside = np.isin(value.layer("class"), classes).astype(np.uint8)
    g = value.geometry
    placed = rasterio.Affine(g.resolution_m, 0.0, g.xmin_m, 0.0, -g.resolution_m, g.ymax_m)
    found = [shapely.geometry.shape(s) for s, _ in shapes(inside, mask=inside > 0, connectivity=4, transform=placed)]
    area = shapely.union_all(found)
    if tolerance_m > 0.0:
        moved = area.simplify(tolerance_m).buffer(tolerance_m) if grows else area.buffer(-tolerance_m)
        area = moved if grows else shapely.intersection(moved.simplify(tolerance_m), area)
    corners: list[Float] = []
    for polygon in shapely.get_parts(shapely.orient_polygons(area)):
        if polygon.geom_type == "Polygon" and not polygon.is_empty:
            corners += [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return np.vstack(corners) if corners else np.zeros((0, 2))
