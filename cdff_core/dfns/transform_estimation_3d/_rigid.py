# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Closed form for weighted pairs, its covariance, and the gates of both implementations."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.robust import rigid_fit
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.transform_estimation_3d.interface import Inputs, Interface, Outputs

#: Ratio of the second largest to the largest extent of the points below which they are collinear.
_MIN_SPREAD = 1e-3


class RigidConfig(DfnConfig):
    """Parameters of all implementations."""

    min_pairs: int = Field(3, ge=3, description="Minimum number of pairs")
    max_rms_m: float = Field(1e6, gt=0, description="Largest root mean square distance of agreeing pairs")


RigidConfigT = TypeVar("RigidConfigT", bound=RigidConfig)


class RigidEstimation(Interface[RigidConfigT]):
    """Common part of the estimators: checks of inputs and results, covariance from the agreeing pairs."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the transform; raises RefusedError or DegenerateGeometryError."""
        source, sink = (np.ascontiguousarray(x, np.float64) for x in (inputs.source, inputs.sink))
        sigmas = np.ones(len(source)) if inputs.sigmas is None else np.asarray(inputs.sigmas, np.float64)
        self._refuse_few(len(source), "few_pairs")
        self._refuse_line(source)
        inliers = self._agreeing(source, sink, sigmas)
        self._refuse_few(int(inliers.sum()), "few_inliers")
        self._refuse_line(source[inliers])
        T = rigid_fit(source[inliers], sink[inliers], sigmas[inliers] ** -2.0)
        residuals = np.linalg.norm(se3.transform_points(T, source) - sink, axis=1)
        rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
        if rms > self.config.max_rms_m:
            raise RefusedError(f"pairs are {rms:.4g} m apart", [f"rms:{rms:.4g}>{self.config.max_rms_m:g}"])
        freedom = max(3 * int(inliers.sum()) - 6, 1)
        variance = float(np.sum((residuals[inliers] / sigmas[inliers]) ** 2)) / freedom
        covariance = np.asarray(
            variance * np.linalg.inv(_information(T, source[inliers], sigmas[inliers])), np.float64
        )
        return Outputs(
            transform=T,
            covariance=covariance,
            inliers=inliers,
            residuals=residuals,
            unit_variance=variance,
        )

    @abstractmethod
    def _agreeing(self, source: FloatArray, sink: FloatArray, sigmas: FloatArray) -> BoolArray:
        """Return the mask of the inliers."""

    def _refuse_few(self, count: int, reason: str) -> None:
        if count < self.config.min_pairs:
            text = f"{count} pairs, expected at least {self.config.min_pairs}"
            raise RefusedError(text, [f"{reason}:{count}<{self.config.min_pairs}"])

    def _refuse_line(self, points: FloatArray) -> None:
        extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extents[1] <= _MIN_SPREAD * extents[0]:
            raise DegenerateGeometryError(
                "the points lie on a line: the rotation about it is unobservable", ["rotation"]
            )


def _information(T: FloatArray, source: FloatArray, sigmas: FloatArray) -> FloatArray:
    J = np.zeros((len(source), 3, 6))
    J[:, :, :3] = np.eye(3)
    J[:, :, 3:] = -se3.skew(source @ T[:3, :3].T)
    J /= sigmas[:, None, None]
    return np.asarray(np.einsum("nki,nkj->ij", J, J))
