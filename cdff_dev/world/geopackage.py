# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A world as GeoPackage: the positions of the frames and the outlines of the items, in one frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

from cdff_common.errors import StorageError
from cdff_common.formats.geotiff import engineering_crs
from cdff_common.geometry import se3
from cdff_common.output import removed_after_error
from cdff_common.types.message import Message
from cdff_common.world import World, WorldItem
from cdff_dev.world.export import pose_in


def write_geopackage(world: World, root: str, path: Path) -> None:
    """Write the layers ``frames`` (points) and ``items`` (polygons) in the axes of ``root``, metres.

    Frames and items that are not connected with ``root`` are left out. The CRS is an engineering CRS of
    ``root``.

    Raises
    ------
    StorageError
        If the file cannot be written.
    """
    path.unlink(missing_ok=True)
    with removed_after_error(path):
        _write_layers(world, root, path)


def _write_layers(world: World, root: str, path: Path) -> None:
    """Write the frames as points and the outlines of items as polygons."""
    points, rows = [], []
    for frame in world.frames:
        if (T := pose_in(world, root, frame)) is not None:
            points.append(shapely.Point(T.matrix[:3, 3]))
            sigma_m = np.nan if T.covariance is None else float(np.sqrt(np.trace(T.covariance[:3, :3])))
            heading_deg = float(np.degrees(np.arctan2(T.matrix[1, 0], T.matrix[0, 0])))
            rows.append((frame, heading_deg, sigma_m))
    _write(path, "frames", root, points, rows, ("frame", "yaw_deg", "sigma_m"))
    outlines, properties = [], []
    for item in world.items:
        if (outline := _outline(world, root, item)) is not None:
            outlines.append(outline)
            properties.append((item.name, item.type_name, str(item.stamp_ns)))
    _write(path, "items", root, outlines, properties, ("name", "type", "stamp_ns"))


def _outline(world: World, root: str, item: WorldItem) -> shapely.Polygon | None:
    """Return the outline of the box of an item seen along z of the root; None without one."""
    box = item.value.extent_m() if isinstance(item.value, Message) else None
    T = None if box is None else pose_in(world, root, item.frame)
    if box is None or T is None:
        return None
    corners = np.array([(x, y, z) for x in box[0::3] for y in box[1::3] for z in box[2::3]])
    outline = shapely.MultiPoint(se3.transform_points(T.matrix, corners)[:, :2]).convex_hull
    return outline if isinstance(outline, shapely.Polygon) else None


def _write(
    path: Path, layer: str, root: str, shapes: list[Any], rows: list[tuple[Any, ...]], names: tuple[str, ...]
) -> None:
    """Write one layer of shapes with its columns; nothing without shapes."""
    columns = [np.array([row[i] for row in rows]) for i in range(len(names))]
    if not shapes:
        return
    try:
        pyogrio.raw.write(
            str(path),
            geometry=np.array(shapely.to_wkb(shapes), dtype=object),
            field_data=columns,
            fields=list(names),
            geometry_type="Point Z" if layer == "frames" else "Polygon",
            crs=engineering_crs(root),
            layer=layer,
            driver="GPKG",
            append=path.exists(),
        )
    except (DataSourceError, DataLayerError, FeatureError) as error:
        raise StorageError(f"{path}: {error}") from error
