# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Camera pose by RANSAC over the poses of samples of three points."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.perspective_n_point_solving.interface import Inputs, Interface, Outputs

#: Number of samples that are compared with the points at once.
_FIRST_BATCH, _LARGEST_BATCH = 8, 64


class P3pRansacConfig(DfnConfig):
    """Parameters of P3pRansac."""

    threshold_px: float = Field(2.0, gt=0, le=50, description="Largest reprojection error of an inlier")
    max_iterations: int = Field(
        500, ge=1, le=100_000, description="Maximum number of samples of three points"
    )
    confidence: float = Field(
        0.9999, gt=0, lt=1, description="Probability that at least one sample has no outliers"
    )
    min_inliers: int = Field(12, ge=4, description="Minimum number of inliers; fewer are refused")
    seed: int = Field(0, ge=0, description="Seed of the random samples; every call starts with it")


class P3pRansac(Interface[P3pRansacConfig]):
    """RANSAC [1]_ on the three-point pose problem [2]_, with a guess as the first hypothesis.

    The guess is selected only if no sample has more inliers.

    References
    ----------
    .. [1] M. Fischler, R. Bolles, Random Sample Consensus, CACM 24(6), 1981, doi:10.1145/358669.358692
    .. [2] T. Ke, S. Roumeliotis, An Efficient Algebraic Solution to the Perspective-Three-Point Problem, CVPR
       2017, doi:10.1109/CVPR.2017.491
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the pose; raises RefusedError with ``few_points`` or ``few_inliers``."""
        c = self.config
        points = np.ascontiguousarray(inputs.points, np.float64)
        pixels = np.ascontiguousarray(inputs.projections, np.float64)
        K = np.ascontiguousarray(inputs.camera_matrix, np.float64)
        if len(points) < c.min_inliers:
            reason = f"few_points:{len(points)}<{c.min_inliers}"
            raise RefusedError(f"{len(points)} points, expected at least {c.min_inliers}", [reason])
        best, inliers = np.eye(4), np.zeros(len(points), bool)
        if inputs.guess is not None:
            best = np.array(inputs.guess, np.float64)
            inliers = self._inliers(best, points, pixels, K)
        generator, samples, size = np.random.default_rng(c.seed), 0, _FIRST_BATCH
        while samples < self._required_samples(inliers):
            for candidates, near in self._hypotheses(generator, size, points, pixels, K):
                if samples >= self._required_samples(inliers):
                    break
                samples += 1
                for candidate, candidate_inliers in zip(candidates, near, strict=True):
                    if candidate_inliers.sum() > inliers.sum():
                        best, inliers = candidate, candidate_inliers
            size = min(2 * size, _LARGEST_BATCH)
        if inliers.sum() < c.min_inliers:
            raise RefusedError(
                f"{inliers.sum()} of {len(points)} points agree on a pose, expected at least {c.min_inliers}",
                [f"few_inliers:{inliers.sum()}<{c.min_inliers}"],
            )
        return Outputs(camera=best, inliers=inliers)

    def _required_samples(self, inliers: BoolArray) -> int:
        """Return the number of samples that contains one without outliers with the configured confidence."""
        p_without_outliers = float(inliers.mean()) ** 3
        if p_without_outliers <= 1e-9:
            return self.config.max_iterations
        if p_without_outliers >= 1.0 - 1e-12:
            return 1
        return min(
            self.config.max_iterations,
            int(np.ceil(np.log(1.0 - self.config.confidence) / np.log(1.0 - p_without_outliers))),
        )

    def _hypotheses(
        self, generator: np.random.Generator, size: int, points: FloatArray, pixels: FloatArray, K: FloatArray
    ) -> Iterator[tuple[FloatArray, BoolArray]]:
        """Yield for each of some samples the poses ``(k, 4, 4)`` and their inliers ``(k, n)``."""
        counts, poses = [], []
        for _ in range(size):
            sample = generator.choice(len(points), 3, replace=False)
            _, rotations, translations = cv2.solveP3P(
                points[sample], pixels[sample], K, None, flags=cv2.SOLVEPNP_AP3P
            )
            counts.append(len(rotations))
            for rvec, t in zip(rotations, translations, strict=True):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = cv2.Rodrigues(rvec)[0], t[:, 0]
                poses.append(T)
        stacked = np.array(poses).reshape(-1, 4, 4)
        split_rows = np.cumsum(counts)[:-1]
        inliers = self._inliers(stacked, points, pixels, K)
        yield from zip(np.split(stacked, split_rows), np.split(inliers, split_rows), strict=True)

    def _inliers(
        self, T_camera_points: FloatArray, points: FloatArray, pixels: FloatArray, K: FloatArray
    ) -> BoolArray:
        """Return which points are in front of the camera and project near their pixels, shape (..., n)."""
        points_camera = (
            points @ np.swapaxes(T_camera_points[..., :3, :3], -1, -2) + T_camera_points[..., None, :3, 3]
        )
        depth = points_camera[..., 2]
        projected = (points_camera / np.where(depth > 1e-6, depth, np.inf)[..., None]) @ K.T
        offsets = projected[..., :2] - pixels
        is_near: BoolArray = (offsets**2).sum(axis=-1) < self.config.threshold_px**2
        return is_near & (depth > 1e-6)
