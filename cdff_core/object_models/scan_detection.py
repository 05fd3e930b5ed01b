# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of a prepared model in the points of one body of a scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.model_pose_refinement.interface import (
    ModelPoseRefinementInputs,
    ModelPoseRefinementOutputs,
)
from cdff_core.dfns.model_pose_search.interface import ModelPoseSearchInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.nearest_grid import NearestGrid
from cdff_core.object_models.pose_equations import nearest_distances
from cdff_core.object_models.scan_parts import range_noise

#: Largest extent of a body relative to that of the model, and bounds of the noise relative to the model.
_MAX_SIZE, _MIN_SIGMA, _MAX_SIGMA = 1.6, 2e-4, 0.05
#: Ratio of the extents of scan and model above which a wrong unit is the likely reason.
_WRONG_UNIT = 50.0
#: Difference of the cost that can remain after a search, relative to the cost.
_UNCONVERGED = 0.02
#: Poses closer than this, in rad and diameters of the model, are the same.
_SAME_RAD, _SAME = 0.2, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """An accepted pose T_sensor_model (4, 4) of a model; the first of a body has the lowest cost.

    Attributes
    ----------
    name : str
    T : ndarray, shape (4, 4)
    covariance : ndarray, shape (6, 6), or None
        [x y z rx ry rz] in the sensor's frame; None if unknown.
    score : float
        Fraction of the rays that agree with the model.
    is_alternative : bool
        The scan does not separate it from the first one.
    """

    name: str
    T: FloatArray
    covariance: FloatArray | None
    score: float
    is_alternative: bool


@dataclass(frozen=True, slots=True)
class DetectionLimits:
    """Limits of a detection.

    Attributes
    ----------
    sigma_m : float
        Standard deviation of a range; 0: estimated from the scan.
    min_points : int
    min_score : float
    ambiguity : float
        Difference of -2 log likelihood up to which another pose is an alternative.
    """

    sigma_m: float
    min_points: int
    min_score: float
    ambiguity: float


class ScanDetector:
    """Search, ranking and decision for one body of a scan.

    Parameters
    ----------
    search, refine : Dfn
        ModelPoseSearch and ModelPoseRefinement.
    limits : DetectionLimits
    """

    def __init__(
        self, search: Dfn[Any, Any, Any], refine: Dfn[Any, Any, Any], limits: DetectionLimits
    ) -> None:
        self._search, self._refine, self._limits = search, refine, limits

    def detect(
        self, name: str, model: ModelPreparationOutputs, scan_m: FloatArray, metrics: dict[str, float]
    ) -> list[Hypothesis]:
        """Return the accepted poses of a model in points (n, 3) of one body, best first.

        Parameters
        ----------
        metrics : dict
            Gets ``score``, ``sigma_m`` and ``cost`` of the best pose.

        Raises
        ------
        RefusedError
            ``few_points``, ``too_large``, ``too_small``, ``wrong_unit`` or ``low_score``.
        """
        limits = self._limits
        if len(scan_m) < limits.min_points:
            raise RefusedError(f"{len(scan_m)} points", [f"few_points:{len(scan_m)}<{limits.min_points}"])
        _check_size(model, scan_m)
        sigma_m = limits.sigma_m or bounded_noise(range_noise(scan_m), model.diameter_m)
        surface = surface_ports(model)
        pose_search = self._search.process(
            ModelPoseSearchInputs(
                scan=scan_m,
                view_directions=model.view_directions,
                view_centroids=model.view_centroids,
                sigma_m=sigma_m,
                **surface,
            )
        )
        refined_poses = self._refine.process(
            ModelPoseRefinementInputs(
                scan=scan_m,
                poses=pose_search.poses,
                drawn_vertices=model.drawn_vertices,
                drawn_triangles=model.drawn_triangles,
                centre_m=model.centre_m,
                sigma_m=sigma_m,
                sigma_is_upper_bound=not limits.sigma_m,
                **surface,
            )
        )
        scores = refined_poses.rays[:, 0] / np.maximum(refined_poses.rays.sum(axis=1), 1.0)
        metrics |= {
            "score": float(scores[0]),
            "sigma_m": refined_poses.sigma_m,
            "cost": float(refined_poses.costs[0]),
        }
        if scores[0] < limits.min_score:
            raise RefusedError(
                f"{name}: score {scores[0]:.2f}", [f"low_score:{scores[0]:.2f}<{limits.min_score:g}"]
            )
        return [
            Hypothesis(name, refined_poses.poses[i], refined_poses.covariances[i], float(scores[i]), i > 0)
            for i in self._alternatives(model, refined_poses)
        ]

    def _alternatives(self, model: ModelPreparationOutputs, refined: ModelPoseRefinementOutputs) -> list[int]:
        """Return the rows of the best pose and of others that explain the scan nearly as well."""
        rows = [0]
        limit = max(self._limits.ambiguity, _UNCONVERGED * refined.costs[0])
        for i in range(1, len(refined.poses)):
            if refined.costs[i] - refined.costs[0] > limit:
                continue
            if not any(are_equivalent(model, refined.poses[i], refined.poses[k]) for k in rows):
                rows.append(i)
        return rows


def surface_ports(model: ModelPreparationOutputs) -> dict[str, Any]:
    """Return the surface of a prepared model as the ports of the DFNs that register points with it."""
    return {
        "points": model.points,
        "normals": model.normals,
        "grid_index": model.grid_index,
        "grid_low": model.grid_low,
        "grid_cell_m": model.grid_cell_m,
        "diameter_m": model.diameter_m,
    }


def on_surface(
    model: ModelPreparationOutputs, T_sensor_model: FloatArray, points_m: FloatArray, limit_m: float
) -> BoolArray:
    """Return the mask (n,) of points (n, 3) up to ``limit_m`` from the surface of a model."""
    grid = NearestGrid(model.grid_index, model.grid_low, model.grid_cell_m)
    distances_m = nearest_distances(T_sensor_model, np.ascontiguousarray(points_m), model.points, grid)
    return np.asarray(distances_m < limit_m)


def bounded_noise(sigma_m: float, diameter_m: float) -> float:
    """Return a standard deviation of the ranges within the bounds for a model of a diameter."""
    return min(max(sigma_m, _MIN_SIGMA * diameter_m), _MAX_SIGMA * diameter_m)


def valid_points(points_m: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Return the finite points (n, 3) that are not at the sensor, metres, and the mask of their rows."""
    points = np.asarray(points_m, np.float64)
    is_valid = np.isfinite(points).all(axis=1) & (np.abs(points).max(axis=1, initial=0.0) > 0.0)
    return points[is_valid], is_valid


def no_body_reasons(points_m: FloatArray, diameter_m: float) -> list[str]:
    """Return the reasons if a scan (n, 3) has no body: its points are isolated relative to the model."""
    extent_m = float(np.linalg.norm(np.ptp(points_m, axis=0))) if len(points_m) else 0.0
    return ["no_body", "wrong_unit"] if extent_m > _WRONG_UNIT * diameter_m else ["no_body"]


def _check_size(model: ModelPreparationOutputs, scan_m: FloatArray) -> None:
    low, high = np.quantile(scan_m, [0.02, 0.98], axis=0)
    ratio = float(np.linalg.norm(high - low)) / model.diameter_m
    if ratio > _MAX_SIZE:
        hint = ["wrong_unit"] if ratio > _WRONG_UNIT else []
        raise RefusedError("the body is larger than the model", [f"too_large:{ratio:.3g}", *hint])
    if ratio < 1.0 / _WRONG_UNIT:
        raise RefusedError("the body is smaller than the model", [f"too_small:{ratio:.3g}", "wrong_unit"])


def are_equivalent(model: ModelPreparationOutputs, first: FloatArray, second: FloatArray) -> bool:
    """Return whether two poses are the same, or equivalent because of the symmetry of the model."""
    differences = se3.inverse(first) @ second @ model.symmetries
    centre = np.append(model.centre_m, 1.0)
    moved_m = np.linalg.norm((differences @ centre)[:, :3] - model.centre_m, axis=1)
    is_same = (se3.rotation_angle(differences[:, :3, :3]) < _SAME_RAD) & (moved_m < _SAME * model.diameter_m)
    return bool(is_same.any())
