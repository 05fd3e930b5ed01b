# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Steps that both implementations share: checks of the pairs, closed-form solution, covariance."""

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
_MIN_EXTENT_RATIO = 1e-3


class RigidConfig(DfnConfig):
    """Parameters of all implementations."""

    min_pairs: int = Field(3, ge=3, description="Minimum number of pairs")
    max_rms_m: float = Field(
        1e6, gt=0, description="Largest root mean square distance of the inliers after the transform"
    )


RigidConfigT = TypeVar("RigidConfigT", bound=RigidConfig)


class RigidEstimation(Interface[RigidConfigT]):
    """Base of the implementations, which differ in the selection of the inliers."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the transform; raises RefusedError or DegenerateGeometryError."""
        source, sink = (np.ascontiguousarray(x, np.float64) for x in (inputs.source, inputs.sink))
        sigmas = np.ones(len(source)) if inputs.sigmas is None else np.asarray(inputs.sigmas, np.float64)
        self._check_count(len(source), "few_pairs")
        self._check_not_collinear(source)
        inliers = self._select_inliers(source, sink, sigmas)
        self._check_count(int(inliers.sum()), "few_inliers")
        self._check_not_collinear(source[inliers])
        T = rigid_fit(source[inliers], sink[inliers], sigmas[inliers] ** -2.0)
        residuals = np.linalg.norm(se3.transform_points(T, source) - sink, axis=1)
        rms = float(np.sqrt(np.mean(residuals[inliers] ** 2)))
        if rms > self.config.max_rms_m:
            limit = self.config.max_rms_m
            text = f"root mean square distance of the pairs {rms:.4g} m, expected at most {limit:g} m"
            raise RefusedError(text, [f"rms:{rms:.4g}>{limit:g}"])
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
    def _select_inliers(self, source: FloatArray, sink: FloatArray, sigmas: FloatArray) -> BoolArray:
        """Return the mask of the inliers (n,)."""

    def _check_count(self, count: int, reason: str) -> None:
        """Raise RefusedError if there are too few pairs."""
        if count < self.config.min_pairs:
            text = f"{count} pairs, expected at least {self.config.min_pairs}"
            raise RefusedError(text, [f"{reason}:{count}<{self.config.min_pairs}"])

    def _check_not_collinear(self, points: FloatArray) -> None:
        """Raise DegenerateGeometryError if the points are collinear."""
        extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extents[1] <= _MIN_EXTENT_RATIO * extents[0]:
            raise DegenerateGeometryError(
                "the points lie on a line: the rotation about it is unobservable", ["rotation"]
            )


def _information(T_sink_source: FloatArray, source: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return the information on the transform (6, 6), [x y z rx ry rz], perturbation in the sink frame."""
    J = np.zeros((len(source), 3, 6))
    J[:, :, :3] = np.eye(3)
    J[:, :, 3:] = -se3.skew(source @ T_sink_source[:3, :3].T)
    J /= sigmas[:, None, None]
    return np.asarray(np.einsum("nki,nkj->ij", J, J))
