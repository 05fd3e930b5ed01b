# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a scene at rest by sparse optical flow: plane and parallax.

References
----------
.. [1] Irani, M., Anandan, P. (1998). A unified approach to moving object detection in 2D and 3D scenes. IEEE
   TPAMI 20(6). doi:10.1109/34.683770
.. [2] Shi, J., Tomasi, C. (1994). Good features to track. CVPR. doi:10.1109/CVPR.1994.323794
"""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.scene_registration.interface import Inputs, Interface, Outputs

#: Window of the optical flow, and largest distance from its start of a point that is tracked forward and
#: back, pixels.
_WINDOW_PX, _MAX_RETURN_PX = 15, 0.3
#: Largest residual of a point that fits the homography, pixels.
_PLANE_PX = 1.0
#: Largest displacements in the images of a camera at rest, which are noise of the flow: of three quarters of
#: the points, and of the median in each quarter of the image, pixels.
_REST_PX, _REST_MEDIAN_PX = 0.5, 0.06
#: Side of a cell, pixels, and largest number of points taken from it, so that an object is not covered more
#: densely than the scene.
_CELL_PX, _PER_CELL = 24, 2
#: Least strength of a corner, and width of the border of the image without corners, pixels.
_LEAST_CORNER, _BORDER_PX = 1e-5, 4
#: Distance between the nodes of the parallax, pixels; number of points that determine the parallax of a
#: node, and their largest distance from it, pixels.
_NODE_PX, _NEIGHBOURS, _REACH_PX = 32, 16, 110.0
#: Least standard deviation of a position, pixels.
_FLOOR_PX = 0.05


class SparseFlowConfig(DfnConfig):
    """Parameters of SparseFlow."""

    max_points: int = Field(400, ge=20, le=5000, description="Number of points that are tracked")
    min_points: int = Field(
        12, ge=6, le=1000, description="Number of tracked points below which the image is refused"
    )
    max_motion_px: float = Field(
        40.0, gt=0.0, le=500.0, description="Largest displacement of a point from its expected place, px"
    )


class SparseFlow(Interface[SparseFlowConfig]):
    """Corners [2]_ are tracked forward and back; a homography fits most of them, and the median of the
    residuals of neighbours is the parallax [1]_.

    A moving object that has fewer points than its surroundings does not change the median.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the positions of the pixels in the previous image.

        Raises
        ------
        RefusedError
            If too few points are found in both images.
        """
        previous, current = inputs.previous, inputs.current
        start, end = self._track_points(previous, current, inputs.guess)
        rows, cols = current.shape
        grid = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).astype(np.float32)
        is_at_rest = _is_at_rest(start, end, rows, cols)
        H, parallax = np.eye(3), 0.0
        if is_at_rest:
            places, sigma = grid, np.full((2, 2), _FLOOR_PX)
        else:
            H = self._homography(start, end)
            residuals = start - _apply_homography(np.asarray(np.linalg.inv(H), np.float64), end)
            nodes, sigma = self._parallax(end, residuals, rows, cols)
            parallax = float(np.linalg.norm(nodes, axis=2).max())
            plane = cv2.perspectiveTransform(grid.reshape(1, -1, 2), np.linalg.inv(H)).reshape(grid.shape)
            places = np.asarray(plane + _interpolate_nodes(nodes, rows, cols), np.float32)
        return Outputs(
            homography=H,
            places=np.asarray(places, np.float32),
            sigma=np.asarray(_interpolate_nodes(sigma, rows, cols), np.float32),
            is_at_rest=bool(is_at_rest),
            parallax=parallax,
            matches=len(start),
        )

    def _track_points(
        self, previous: np.ndarray, current: np.ndarray, guess: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 2) of points in the previous and the current image."""
        current = _match_brightness(previous, current)
        start = _corners(previous)[: self.config.max_points]
        if len(start) < self.config.min_points:
            raise RefusedError(
                f"scene registration: {len(start)} points, expected at least {self.config.min_points}",
                reasons=["no_texture"],
            )
        expected = start if guess is None else _apply_homography(guess, start).astype(np.float32)
        end, has_flow = _flow(previous, current, start, expected)
        back, returns_to_start = _flow(current, previous, end, start)
        good = has_flow & returns_to_start
        good &= np.linalg.norm(back - start, axis=1) < _MAX_RETURN_PX
        good &= np.linalg.norm(end - expected, axis=1) < self.config.max_motion_px
        if good.sum() < self.config.min_points:
            raise RefusedError(
                f"scene registration: {int(good.sum())} points in both images,"
                f" expected at least {self.config.min_points}",
                reasons=["no_texture"],
            )
        return start[good].astype(np.float64), end[good].astype(np.float64)

    def _homography(self, start: FloatArray, end: FloatArray) -> FloatArray:
        cv2.setRNGSeed(1)
        H, _ = cv2.findHomography(start, end, cv2.RANSAC, _PLANE_PX, maxIters=500, confidence=0.999)
        if H is None or not np.isfinite(H).all() or abs(np.linalg.det(H)) < 1e-6:
            raise RefusedError("scene registration: no homography fits the points", reasons=["no_texture"])
        return np.asarray(H, np.float64)

    @staticmethod
    def _parallax(
        places: FloatArray, residuals: FloatArray, rows: int, cols: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return displacement (a, b, 2) and standard deviation (a, b) at the nodes."""
        v, u = (np.linspace(0.0, n - 1.0, max(round(n / _NODE_PX), 2)) for n in (rows, cols))
        nodes = np.stack(np.meshgrid(u, v), axis=-1)
        count = min(_NEIGHBOURS, len(places))
        distances, near = cKDTree(places).query(nodes.reshape(-1, 2), count)
        distances, near = distances.reshape(-1, count), near.reshape(-1, count)
        values = residuals[near]
        values[distances > _REACH_PX] = np.nan
        has_neighbours = (distances <= _REACH_PX).sum(axis=1) >= 3
        median = np.zeros((len(near), 2))
        spread = np.full(len(near), _FLOOR_PX)
        if has_neighbours.any():
            median[has_neighbours] = np.nanmedian(values[has_neighbours], axis=1)
            deviation = np.abs(values[has_neighbours] - median[has_neighbours][:, None]).max(axis=2)
            spread[has_neighbours] = np.maximum(1.4826 * np.nanmedian(deviation, axis=1), _FLOOR_PX)
        shape = nodes.shape[:2]
        return median.reshape(*shape, 2), spread.reshape(shape)


def _apply_homography(H: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(cv2.perspectiveTransform(points[None].astype(np.float64), H)[0])


def _is_at_rest(start: FloatArray, end: FloatArray, rows: int, cols: int) -> bool:
    """Return True if most points rest, and the median of each quarter of the image is zero."""
    motion = end - start
    if np.percentile(np.linalg.norm(motion, axis=1), 75.0) > _REST_PX:
        return False
    quarter = 2 * (start[:, 0] > 0.5 * cols) + (start[:, 1] > np.median(start[:, 1]))
    medians = [np.median(motion[quarter == k], axis=0) for k in range(4) if (quarter == k).sum() >= 5]
    return bool(all((np.abs(m) < _REST_MEDIAN_PX).all() for m in medians))


def _flow(
    first: np.ndarray, second: np.ndarray, start: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions (n, 2) of points in the second image, and which were found (n,)."""
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        start,
        guess.copy(),
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=3,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(end, np.float32), np.asarray(found).ravel() > 0


def _corners(image: np.ndarray) -> np.ndarray:
    """Return the best corners [2]_ of each cell, the best ones first, shape (n, 2), float32.

    The threshold is that of the image: one object with strong texture does not remove the corners of the
    scene.
    """
    strength = cv2.cornerMinEigenVal(image, 5)
    is_peak = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > _LEAST_CORNER)
    is_peak &= strength > 1.5 * np.median(strength)
    is_peak[:_BORDER_PX] = is_peak[-_BORDER_PX:] = False
    is_peak[:, :_BORDER_PX] = is_peak[:, -_BORDER_PX:] = False
    rows, cols = np.nonzero(is_peak)
    order = np.argsort(-strength[rows, cols], kind="stable")
    points = np.column_stack([cols, rows])[order]
    return points[_ranks(points) < _PER_CELL].astype(np.float32)


def _ranks(points: np.ndarray) -> np.ndarray:
    """Return the rank (n,) of each point in its cell, for points (n, 2) in descending order."""
    cell = points // _CELL_PX
    key = cell[:, 0] + 100_000 * cell[:, 1]
    order = np.argsort(key, kind="stable")
    rank = np.empty(len(key), np.int64)
    rank[order] = np.arange(len(key)) - np.searchsorted(key[order], key[order])
    return rank


def _match_brightness(previous: np.ndarray, current: np.ndarray) -> np.ndarray:
    """Return the current image with the brightness of the previous one."""
    a, b = previous[::4, ::4].astype(np.float32), current[::4, ::4].astype(np.float32)
    good = (a > 4.0) & (b > 4.0) & (a < 250.0) & (b < 250.0)
    if good.sum() < 100:
        return current
    return np.asarray(cv2.convertScaleAbs(current, alpha=float(np.median(a[good] / b[good]))))


def _interpolate_nodes(nodes: FloatArray, rows: int, cols: int) -> np.ndarray:
    """Return values at the nodes, interpolated at all pixels; the first and last node are at the border."""
    a, b = nodes.shape[:2]
    v, u = np.linspace(0.0, a - 1.0, rows), np.linspace(0.0, b - 1.0, cols)
    uu, vv = (m.astype(np.float32) for m in np.meshgrid(u, v))
    return np.asarray(
        cv2.remap(nodes.astype(np.float32), uu, vv, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    )
