# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transforms of the frames that hold products into the frame of a query, and search boxes in them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from dpm_store.engine import schema
from dpm_store.engine.database import dialect_of
from dpm_store.frames.frames import IDENTITY, FrameTree
from dpm_store.search.outlines import corners_of

#: Relative margin of search boxes: rounding must not exclude a product that the exact comparison would keep.
_RELATIVE_MARGIN = 1e-6
_n = schema.frame_names.c
#: Frames that hold products, with their heights.
FRAMES = select(_n.ordinal, _n.frame, _n.zmin_m, _n.zmax_m).order_by(_n.frame)

Box = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ResolvedFrame:
    """A frame that holds products.

    Attributes
    ----------
    ordinal : int
        Its number in the index.
    transform : UncertainTransform
        ``T_query_frame``.
    heights_m : tuple of 2 float, or None
        Lowest and highest z of the boxes of its products; None if there is no box.
    """

    ordinal: int
    transform: UncertainTransform
    heights_m: tuple[float, float] | None

    @property
    def matrix(self) -> NDArray[np.float64]:
        """``T_query_frame`` (4, 4)."""
        return self.transform.matrix

    def boxes(self, region: Region) -> list[Box]:
        """Return boxes around the region in the coordinates of the frame."""
        return [box for piece in region.pieces if (box := self.box(piece)) is not None]

    def box(self, box_m: Box) -> Box | None:
        """Return a box in the coordinates of the frame around a box of the query's frame.

        Unbounded heights are replaced by those of the frame; None if it holds no box. Boxes are
        ``xmin ymin zmin xmax ymax zmax``.
        """
        if self.transform is IDENTITY:
            return box_m
        if not math.isinf(box_m[2]):
            corners = corners_of(np.array([box_m]))[0]
            inverse = self.transform.inverse().apply(corners)
            margin = _RELATIVE_MARGIN * (1.0 + float(np.abs(inverse).max()))
            return (*(inverse.min(axis=0) - margin), *(inverse.max(axis=0) + margin))
        return None if self.heights_m is None else _box_of_heights(box_m, self.matrix, self.heights_m)


def resolve_frames(
    connection: Connection, tree: FrameTree, frame: str
) -> tuple[dict[str, ResolvedFrame], tuple[str, ...]]:
    """Return the frames with products that are connected with ``frame``, by name, and the other names."""
    resolved, unplaced = {}, []
    for ordinal, name, zmin_m, zmax_m in dialect_of(connection).fetch(connection, FRAMES):
        T = tree.find(frame, name)
        if T is None:
            unplaced.append(name)
        else:
            heights_m = None if zmin_m is None or zmax_m is None else (zmin_m, zmax_m)
            resolved[name] = ResolvedFrame(ordinal, T, heights_m)
    return resolved, tuple(unplaced)


def _box_of_heights(box: Box, matrix: NDArray[np.float64], heights: tuple[float, float]) -> Box:
    """Return bounds in the frame of all points with query xy inside ``box`` and frame z within ``heights``.

    ``x_q = R x_f + t`` restricted to its first two rows is solved for ``(x_f, y_f)`` at each corner of the
    box and each end of the heights. If the z axis of the frame is in the query's plane, x and y are
    unbounded.
    """
    A = matrix[:2, :2]
    if abs(float(np.linalg.det(A))) < 1e-6:
        return (-math.inf, -math.inf, heights[0], math.inf, math.inf, heights[1])
    corners = np.array([[x, y] for x in (box[0], box[3]) for y in (box[1], box[4])])
    points = np.concatenate(
        [np.linalg.solve(A, (corners - matrix[:2, 3] - matrix[:2, 2] * z).T).T for z in heights]
    )
    (xmin, ymin), (xmax, ymax) = points.min(axis=0), points.max(axis=0)
    margin = _RELATIVE_MARGIN * (1.0 + max(abs(v) for v in (xmin, ymin, xmax, ymax)))
    return (xmin - margin, ymin - margin, heights[0], xmax + margin, ymax + margin, heights[1])
