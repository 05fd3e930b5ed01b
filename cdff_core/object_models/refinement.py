# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refinement of poses by the likelihood of the scan, and the covariance of the best one.

The likelihood has steps where the outline crosses a ray, so that it has no useful derivative: CMA-ES searches
for its maximum, and importance sampling yields mean and covariance of the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.geometry.robust import median_sigma
from cdff_core.object_models.evolution import minimise
from cdff_core.object_models.hypotheses import SurfaceModel, distinct
from cdff_core.object_models.importance import mean_and_covariance
from cdff_core.object_models.likelihood import likelihood, range_residuals
from cdff_core.object_models.pose_change import PoseChange
from cdff_core.object_models.registration import normal_equations, register
from cdff_core.object_models.scan_view import ScanView

#: Population and generations of the evolutionary search, those for scans with few points, whose likelihood
#: has more local minima, and the number of points up to which a scan has few.
_SEARCH, _LONG_SEARCH, _FEW_POINTS = (12, 6), (16, 12), 150
#: Initial deviation of the search relative to the standard deviations of the registration.
_DEVIATION = 1.5
#: Rounds of the importance sampling and poses of a round.
_ROUNDS, _SAMPLES = 4, 48
#: Divisor of the costs, since neighbouring rays see the same part of the model and are not independent.
_TEMPERATURE = 2.0
#: Number of rays at which the covariance is the mean of that of the registration, which ignores the outline,
#: and that of the samples, for which the rays along the outline are independent. The contribution of the
#: outline to the information falls with the number of rays. Chosen by the NEES of simulated scans.
_OUTLINE_RAYS = 200
#: A hypothesis is not refined if its cost exceeds the smallest cost by more than this.
_HOPELESS = 60.0
#: Further difference for rotations by 180°, which are not yet aligned, relative to the smallest cost, of
#: which at most 1 for each ray counts, since the model of a real body does not explain all its measurements.
_ROTATED = 0.25
#: Searches of the best pose and of its rotations by 180°, decrease of the cost after which they are repeated,
#: absolute and relative, and cost of a ray above which the best pose itself is searched again.
_SEARCH_ROUNDS, _IMPROVEMENT, _RELATIVE_IMPROVEMENT, _POOR = 4, 2.0, 0.02, 1.25
#: Rays that must meet the model for an estimate of the noise.
_MIN_RESIDUALS = 10
_REGISTRATION_STEPS, _SIGMAS, _MIN_SCALE = 4, 3.0, 0.015
#: Floor of the standard deviations of the registration: in diameters, and rad.
_LEAST = 1e-4


class Refined(NamedTuple):
    """A refined pose.

    Attributes
    ----------
    T : ndarray, shape (4, 4)
        T_view_model.
    covariance : ndarray, shape (6, 6)
        [x y z rx ry rz] in the frame of the view, about the centre of the model.
    cost : float
        -2 log likelihood, up to a constant.
    rays : ndarray, shape (4,)
        Rays as in ``Likelihood``.
    """

    T: FloatArray
    covariance: FloatArray
    cost: float
    rays: FloatArray


class PoseRefiner:
    """Refiner of hypotheses for one scan and one model.

    Parameters
    ----------
    view : ScanView
    surface : SurfaceModel
    vertices_m, triangles : ndarray
        Mesh that is rendered.
    centre_m : ndarray, shape (3,)
        Centre of the model.
    sigma_m : float
        Standard deviation of a range, with that of the model.
    seed : int
    """

    def __init__(
        self,
        view: ScanView,
        surface: SurfaceModel,
        vertices_m: FloatArray,
        triangles: IntArray,
        centre_m: FloatArray,
        sigma_m: float,
        seed: int,
    ) -> None:
        self._view, self._surface, self._centre_m, self._sigma_m = view, surface, centre_m, sigma_m
        self._mesh = (vertices_m, triangles)
        self._rng = np.random.default_rng(seed)

    def ranked(self, poses: FloatArray, count: int) -> list[Refined]:
        """Return the best hypotheses of poses T_view_model (k, 4, 4) after a search, best first.

        At most ``count`` are refined, fewer if the others are much worse, and the best ones rotated by 180°.
        """
        costs = likelihood(self._view, *self._mesh, poses, self._sigma_m).cost
        rows = distinct(poses, np.argsort(costs, kind="stable"), count)
        refined_poses = [self._search(poses[row]) for row in rows if costs[row] < costs[rows[0]] + _HOPELESS]
        for _ in range(_SEARCH_ROUNDS):
            best = min(refined_poses, key=lambda refined: refined.cost)
            is_poor = best.cost > _POOR * len(self._view.points_m)
            starts = [*self._rotated_by_180_deg(best), *([best.T] if is_poor else [])]
            refined_poses += [self._search(T) for T in starts]
            least_decrease = max(_IMPROVEMENT, _RELATIVE_IMPROVEMENT * best.cost)
            if min(refined.cost for refined in refined_poses) > best.cost - least_decrease:
                break
        return sorted(refined_poses, key=lambda refined: refined.cost)

    def _rotated_by_180_deg(self, best: Refined) -> list[FloatArray]:
        """Return a pose (4, 4) rotated by 180° about each principal axis of the model.

        Only poses whose cost is not much larger are returned. The search does not always find them, and the
        scan of a plate or of a box does not exclude them.
        """
        mean_m = self._surface.points_m.mean(axis=0)
        offsets = self._surface.points_m - mean_m
        _, axes = np.linalg.eigh(offsets.T @ offsets)
        R = se3.exp_so3(np.pi * axes.T)
        poses = np.concatenate([best.T @ se3.transform(R, p - R @ p) for p in (mean_m, self._centre_m)])
        costs = likelihood(self._view, *self._mesh, poses, self._sigma_m).cost
        # The better centre for each axis.
        rows = np.argmin(costs.reshape(2, 3), axis=0) * 3 + np.arange(3)
        difference = _ROTATED * min(best.cost, len(self._view.points_m)) + _HOPELESS
        return list(poses[rows[costs[rows] < best.cost + difference]])

    def estimate_noise(self, poses: FloatArray, least_m: float) -> float:
        """Reduce the noise to that of the range residuals at the best of poses T_view_model (k, 4, 4);
        return the noise.

        Parameters
        ----------
        least_m : float
            Lower bound.
        """
        costs = likelihood(self._view, *self._mesh, poses, self._sigma_m).cost
        T, _ = self.registered(poses[int(np.argmin(costs))])
        residuals = range_residuals(self._view, *self._mesh, T)
        if len(residuals) >= _MIN_RESIDUALS:
            self._sigma_m = min(self._sigma_m, max(median_sigma(residuals), least_m))
        return self._sigma_m

    def registered(self, T_view_model: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the registered pose near a pose (4, 4) and its covariance (6, 6) as in ``Refined``."""
        s, diameter_m = self._surface, self._surface.diameter_m
        scale_m = max(_SIGMAS * self._sigma_m, _MIN_SCALE * diameter_m)
        points_m = self._view.points_m
        poses, _ = register(
            T_view_model[None], points_m, s.points_m, s.normals, s.grid, np.full(_REGISTRATION_STEPS, scale_m)
        )
        A, b = np.empty((6, 6)), np.empty(6)
        normal_equations(poses[0], points_m, s.points_m, s.normals, s.grid, 1.3 * scale_m, True, A, b)
        return poses[0], registration_covariance(poses[0], A, self._centre_m, self._sigma_m, diameter_m)

    def with_covariance(self, refined: Refined) -> Refined:
        """Return the mean of the poses that explain the scan, near a refined pose, with their covariance."""
        change = PoseChange(refined.T, self._centre_m, refined.covariance)
        mean, spread = mean_and_covariance(
            lambda vectors: 0.5 / _TEMPERATURE * self._costs(change, vectors),
            np.zeros(6),
            0.5 * np.eye(6),
            rounds=_ROUNDS,
            samples=_SAMPLES,
            rng=self._rng,
        )
        T = change.poses(mean[None])
        final = likelihood(self._view, *self._mesh, T, self._sigma_m)
        share = len(self._view.points_m) / (len(self._view.points_m) + _OUTLINE_RAYS)
        covariance = share * refined.covariance + (1.0 - share) * change.covariance(spread)
        return Refined(T[0], covariance, float(final.cost[0]), final.rays[0])

    def _search(self, T_view_model: FloatArray) -> Refined:
        """Return the best pose of an evolutionary search around a pose or the registered pose."""
        T_registered, covariance = self.registered(T_view_model)
        starts = np.stack([T_view_model, T_registered])
        start = starts[int(np.argmin(likelihood(self._view, *self._mesh, starts, self._sigma_m).cost))]
        change = PoseChange(start, self._centre_m, covariance)
        is_long = len(self._view.points_m) <= _FEW_POINTS
        population, generations = _LONG_SEARCH if is_long else _SEARCH
        mean, vectors, costs = minimise(
            lambda vectors: self._costs(change, vectors),
            np.zeros(6),
            _DEVIATION,
            population=population,
            generations=generations,
            rng=self._rng,
        )
        poses = change.poses(np.stack([mean, vectors[int(np.argmin(costs))], np.zeros(6)]))
        result = likelihood(self._view, *self._mesh, poses, self._sigma_m)
        best = int(np.argmin(result.cost))
        return Refined(poses[best], covariance, float(result.cost[best]), result.rays[best])

    def _costs(self, change: PoseChange, vectors: FloatArray) -> FloatArray:
        return likelihood(self._view, *self._mesh, change.poses(vectors), self._sigma_m).cost


def registration_covariance(
    T_sensor_model: FloatArray, A: FloatArray, centre_m: FloatArray, sigma_m: float, diameter_m: float
) -> FloatArray:
    """Return the covariance (6, 6), [x y z rx ry rz], of a registration in the sensor's axes about a point.

    Parameters
    ----------
    T_sensor_model : ndarray, shape (4, 4)
    A : ndarray, shape (6, 6)
        Normal equations of ``registration.normal_equations``.
    """
    R, about_centre = T_sensor_model[:3, :3], np.eye(6)
    about_centre[3:, :3] = se3.skew(centre_m)
    to_sensor = np.zeros((6, 6))
    to_sensor[:3, 3:] = to_sensor[3:, :3] = R
    information = about_centre.T @ A @ about_centre / sigma_m**2
    min_information = np.concatenate([np.full(3, _LEAST), np.full(3, _LEAST * diameter_m)])
    weakest = 1.0 / (0.2 * np.concatenate([np.ones(3), np.full(3, diameter_m)])) ** 2
    covariance = np.linalg.inv(information + np.diag(weakest)) + np.diag(min_information**2)
    return symmetrised(to_sensor @ covariance @ to_sensor.T)
