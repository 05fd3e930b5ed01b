# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Closed form for weighed pairs, its covariance, and what both implementations refuse.

References
----------
.. [1] S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 13(4), 1991,
   doi:10.1109/34.88573
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.transform_estimation_3d._interface import (
    TransformEstimation3DInputs,
    TransformEstimation3DInterface,
    TransformEstimation3DOutputs,
)

Float = NDArray[np.float64]


class RigidConfig(DfnConfig):
    """What is refused."""

    min_pairs: Annotated[int, Field(ge=3)] = 3
    min_spread: Annotated[float, Field(ge=0, lt=1)] = 1e-3
    max_rms_m: Annotated[float, Field(gt=0)] = 1e6


class RigidEstimation(TransformEstimation3DInterface):
    """What estimators share: checks before and after, covariance from the pairs that agree."""

    Config = RigidConfig
    config: RigidConfig

    def process(self, inputs: TransformEstimation3DInputs) -> TransformEstimation3DOutputs:
        """Estimate; raises InputError, RefusedError or DegenerateGeometryError."""
        source, sink, sigmas = _checked(inputs)
        self._refuse_few(len(source), "few_pairs")
        self._refuse_line(source)
        inliers = self._agreeing(source, sink, sigmas)
        self._refuse_few(int(inliers.sum()), "few_inliers")
        self._refuse_line(source[inliers])
        T = fitted(source[inliers], sink[inliers], sigmas[inliers] ** -2.0)
        residuals = np.linalg.norm(se3.transform_points(T, source) - sink, axis=1)
        rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
        if rms > self.config.max_rms_m:
            raise RefusedError(f"pairs are {rms:.4g} m apart", [f"rms:{rms:.4g}>{self.config.max_rms_m:g}"])
        freedom = max(3 * int(inliers.sum()) - 6, 1)
        variance = float(np.sum((residuals[inliers] / sigmas[inliers]) ** 2)) / freedom
        covariance = variance * np.linalg.inv(_information(T, source[inliers], sigmas[inliers]))
        return TransformEstimation3DOutputs(T, covariance, inliers, residuals, np.array(variance))

    @abstractmethod
    def _agreeing(self, source: Float, sink: Float, sigmas: Float) -> NDArray[np.bool_]:
        """Which pairs are right."""

    def _refuse_few(self, count: int, reason: str) -> None:
        if count < self.config.min_pairs:
            text = f"{count} pairs, expected at least {self.config.min_pairs}"
            raise RefusedError(text, [f"{reason}:{count}<{self.config.min_pairs}"])

    def _refuse_line(self, points: Float) -> None:
        extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extents[1] <= self.config.min_spread * extents[0]:
            raise DegenerateGeometryError("the points lie on a line and leave the turn about it free", ["rotation"])


def fitted(source: Float, sink: Float, weights: Float) -> Float:
    """``T_sink_source`` of least weighed squares ([1]_); a reflection is never the answer."""
    w = weights / weights.sum()
    a, b = w @ source, w @ sink
    U, _, Vt = np.linalg.svd((sink - b).T @ ((source - a) * w[:, None]))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return se3.transform(se3.normalise_rotation(R), b - R @ a)


def _information(T: Float, source: Float, sigmas: Float) -> Float:
    J = np.zeros((len(source), 3, 6))
    J[:, :, :3] = np.eye(3)
    J[:, :, 3:] = -se3.skew(source @ T[:3, :3].T)
    J /= sigmas[:, None, None]
    return np.einsum("nki,nkj->ij", J, J)


def _checked(inputs: TransformEstimation3DInputs) -> tuple[Float, Float, Float]:
    source, sink = (np.ascontiguousarray(x, np.float64) for x in (inputs.source, inputs.sink))
    given = np.ones(len(source)) if inputs.sigmas is None else np.ascontiguousarray(inputs.sigmas, np.float64)
    fits = source.ndim == 2 and source.shape[1] == 3 and source.shape == sink.shape and given.shape == source.shape[:1]
    if not (fits and all(np.isfinite(x).all() for x in (source, sink, given)) and (given > 0.0).all()):
        raise InputError(
            f"source {source.shape}, sink {sink.shape}, sigmas {given.shape}: expected (n, 3) twice and (n,), finite, "
            "sigmas above 0"
        )
    return source, sink, given
