# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the frames that hold products lie in the frame of a question, and where in them to look."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from dpm_store import sqlite
from dpm_store.frames import IDENTITY, FrameTree
from dpm_store.outlines import corners_of

#: Of the bounds of candidates, relative: rounding must not lose one that the exact comparison would keep.
_SLACK = 1e-6
SIDES = ("xmin_m", "ymin_m", "zmin_m", "xmax_m", "ymax_m", "zmax_m")

Box = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Placed:
    """A frame that holds products.

    Attributes
    ----------
    ordinal : int
        Its number in the index.
    transform : UncertainTransform
        ``T_query_frame``.
    heights_m : tuple of 2 float, or None
        Between which all boxes of its products lie; None without any box.
    """

    ordinal: int
    transform: UncertainTransform
    heights_m: tuple[float, float] | None

    @property
    def matrix(self) -> NDArray[np.float64]:
        """``T_query_frame`` (4, 4)."""
        return self.transform.matrix

    def boxes(self, region: Region) -> list[Box]:
        """Boxes around the region in the frame's own coordinates."""
        return [found for piece in region.pieces if (found := self.box(piece)) is not None]

    def box(self, box_m: Box) -> Box | None:
        """Box ``xmin ymin zmin xmax ymax zmax`` around one of the query's frame, in the frame's own coordinates.

        A free height is closed by the heights that the frame holds; None where it holds no box at all.
        """
        if self.transform is IDENTITY:
            return box_m
        if not math.isinf(box_m[2]):
            corners = corners_of(np.array([box_m]))[0]
            inverse = self.transform.inverse().apply(corners)
            slack = _SLACK * (1.0 + float(np.abs(inverse).max()))
            return (*(inverse.min(axis=0) - slack), *(inverse.max(axis=0) + slack))
        return None if self.heights_m is None else _free_height_box(box_m, self.matrix, self.heights_m)


def placed_frames(connection: Connection, tree: FrameTree, frame: str) -> tuple[dict[str, Placed], tuple[str, ...]]:
    """Frames that hold products and can be placed in ``frame``, by name; and the names of the others."""
    placed, unplaced = {}, []
    for ordinal, name, zmin_m, zmax_m in sqlite.frames_of_products(connection):
        T = tree.find(frame, name)
        if T is None:
            unplaced.append(name)
        else:
            placed[name] = Placed(ordinal, T, None if zmin_m is None or zmax_m is None else (zmin_m, zmax_m))
    return placed, tuple(unplaced)


def _free_height_box(box: Box, matrix: NDArray[np.float64], heights: tuple[float, float]) -> Box:
    """Bounds in the frame of all points with query xy inside ``box`` and frame z within ``heights``.

    ``x_q = R x_f + t`` restricted to its first two rows is solved for ``(x_f, y_f)`` at each corner of the box and each
    end of the heights; a frame that lies on its side against the query's plane leaves x and y free.
    """
    A = matrix[:2, :2]
    if abs(float(np.linalg.det(A))) < 1e-6:
        return (-math.inf, -math.inf, heights[0], math.inf, math.inf, heights[1])
    corners = np.array([[x, y] for x in (box[0], box[3]) for y in (box[1], box[4])])
    solved = np.concatenate([np.linalg.solve(A, (corners - matrix[:2, 3] - matrix[:2, 2] * z).T).T for z in heights])
    (xmin, ymin), (xmax, ymax) = solved.min(axis=0), solved.max(axis=0)
    slack = _SLACK * (1.0 + max(abs(v) for v in (xmin, ymin, xmax, ymax)))
    return (xmin - slack, ymin - slack, heights[0], xmax + slack, ymax + slack, heights[1])
