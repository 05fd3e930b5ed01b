# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EssentialDecomposition: the one of four decompositions that puts the points in front, refined."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.cameras_transform_estimation._interface import (
    CamerasTransformEstimationInputs,
    CamerasTransformEstimationInterface,
    CamerasTransformEstimationOutputs,
)
from cdff_core.imaging.relative_pose import angles, checked_cameras, decomposed, depths, fit_in_front, rays
from cdff_core.imaging.two_view import checked_pairs, tangents


class EssentialDecompositionConfig(DfnConfig):
    """Parameters of EssentialDecomposition."""

    threshold_px: Annotated[float, Field(gt=0, le=50)] = 1.0
    gate_sigmas: Annotated[float, Field(ge=1, le=10)] = 3.0
    min_inliers: Annotated[int, Field(ge=6)] = 12
    min_parallax_sigmas: Annotated[float, Field(ge=0, le=100)] = 3.0


class EssentialDecomposition(CamerasTransformEstimationInterface):
    """Rotation and direction of translation [1]_, refined by Sampson's distance over all inliers.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §9.6
    """

    Config = EssentialDecompositionConfig
    config: EssentialDecompositionConfig

    def process(self, inputs: CamerasTransformEstimationInputs) -> CamerasTransformEstimationOutputs:
        """Estimate; raises RefusedError or DegenerateGeometryError where the pairs do not say it."""
        c = self.config
        source, sink = checked_pairs(inputs.source, inputs.sink, 0)
        if len(source) < c.min_inliers:
            raise RefusedError(f"{len(source)} pairs", [f"few_matches:{len(source)}<{c.min_inliers}"])
        E = np.asarray(inputs.essential_matrix, np.float64)
        if E.shape != (3, 3) or not np.isfinite(E).all():
            raise InputError(f"essential matrix {E.tolist()}: expected 3x3, finite")
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        a, b = rays(source, K[0]), rays(sink, K[1])
        R, t, _ = decomposed(E, a, b)
        fit, R, t = fit_in_front(R, t, K, source, sink, c.gate_sigmas, c.threshold_px)
        self._refuse_rotation(a[fit.inliers], b[fit.inliers], fit.sigma_px / float(np.sqrt(K[1][0, 0] * K[1][1, 1])))
        first, second = depths(R, t, a, b)
        inliers = fit.inliers & (first > 0.0) & (second > 0.0)
        if inliers.sum() < c.min_inliers:
            n = int(inliers.sum())
            raise RefusedError(f"{n} of {len(source)} pairs agree", [f"few_inliers:{n}<{c.min_inliers}"])
        parallax = float(np.median(angles(a[inliers] @ R.T, b[inliers])))
        J = np.zeros((6, 5))
        J[:3, 3:], J[3:, :3] = tangents(t), np.eye(3)
        T_sink_source = se3.transform(R, t)
        covariance = cov.inverse_covariance(T_sink_source, J @ fit.parameters @ J.T)
        return CamerasTransformEstimationOutputs(
            se3.inverse(T_sink_source), covariance, inliers, np.array(np.degrees(parallax))
        )

    def _refuse_rotation(self, a: NDArray[np.float64], b: NDArray[np.float64], sigma_rad: float) -> None:
        """Raise DegenerateGeometryError where the best rotation alone leaves no more than noise (Kabsch 1976)."""
        if len(a) < 3:
            return
        unit = [rays_ / np.linalg.norm(rays_, axis=1, keepdims=True) for rays_ in (a, b)]
        U, _, Vt = np.linalg.svd(unit[1].T @ unit[0])
        turn = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        left = float(np.median(angles(unit[0] @ turn.T, unit[1])))
        if left < self.config.min_parallax_sigmas * sigma_rad:
            text = f"a rotation alone leaves {np.degrees(left):.4f} degrees, the noise is {np.degrees(sigma_rad):.4f}"
            raise DegenerateGeometryError(text, ["translation"])
