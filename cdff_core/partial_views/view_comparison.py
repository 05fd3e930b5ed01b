# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of a model at a pose with a range image, and refinement of the pose by it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_common.geometry.small_vectors import inverse_translation, transformed
from cdff_core.partial_views.model_surface import ModelSurface
from cdff_core.partial_views.range_image import RangeImage

#: Weights of visible points that agree with the scene, that are in front of it (in free space), that are
#: behind it, and that have no measurement.
_WEIGHTS = np.array([1.0, -1.0, -0.25, -0.1])
#: Factor by which the perturbations of a refinement decrease per round.
_CONTRACTION = 0.65
#: Minimum fraction of the points of a model that must be visible for a valid score.
_MIN_VISIBLE = 0.1


@dataclass(frozen=True, slots=True)
class Perturbations:
    """Random changes of a pose: standard deviations, rounds, and trials per round."""

    sigma_m: float
    sigma_rad: float
    rounds: int
    trials: int

    def scaled(self, factor: float, angle_factor: float = 1.0) -> Perturbations:
        """Return the perturbations with translations, for example in metres, and angles times a factor."""
        return replace(self, sigma_m=factor * self.sigma_m, sigma_rad=angle_factor * self.sigma_rad)


@dataclass(frozen=True, slots=True, eq=False)
class ViewComparison:
    """Comparison of a surface with a range image; poses are in the frame of the view.

    Attributes
    ----------
    tolerance_m : float
        Largest depth difference between a point and the scene that agree.
    """

    image: RangeImage
    surface: ModelSurface
    tolerance_m: float

    def counts(self, poses: FloatArray) -> IntArray:
        """Return the numbers (k, 4) of visible points by class at poses ``(k, 4, 4)``.

        The classes are: agrees with the scene, in front of it, behind it, no measurement.
        """
        image, surface = self.image, self.surface
        return _counts(
            image.depth_m,
            image.low,
            image.pixel,
            np.ascontiguousarray(poses),
            surface.points_m,
            surface.directions,
            surface.visible,
            self.tolerance_m,
        )

    def scores(self, poses: FloatArray) -> FloatArray:
        """Return scores (k,) of poses ``(k, 4, 4)``.

        The score is 1 if all visible points agree with the scene, and -1 if too few points are visible.
        """
        counts = self.counts(poses)
        visible = counts.sum(axis=1)
        scores = counts @ _WEIGHTS / np.maximum(visible, 1)
        return np.where(visible >= _MIN_VISIBLE * len(self.surface.points_m), scores, -1.0)

    def refine(
        self, T_view_model: FloatArray, perturbations: Perturbations, seed: int
    ) -> tuple[FloatArray, float]:
        """Return the best pose (4, 4) near ``T_view_model`` and its score.

        Each round tries random perturbations, smaller from round to round, since the score is a count and has
        no derivative.
        """
        score = -1.0
        for rotations, translations_m in _draws(perturbations, seed):
            poses = np.repeat(T_view_model[None], perturbations.trials, axis=0)
            poses[1:, :3, :3] = rotations @ T_view_model[:3, :3]
            poses[1:, :3, 3] += translations_m
            scores = self.scores(poses)
            best = int(np.argmax(scores))
            T_view_model, score = poses[best], float(scores[best])
        return T_view_model, score


@lru_cache(maxsize=16)
def _draws(perturbations: Perturbations, seed: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return random rotations (trials - 1, 3, 3) and translations (trials - 1, 3) for each round.

    They are the same for all poses and drawn only once.
    """
    rng = np.random.default_rng(seed)
    draws = []
    for i in range(perturbations.rounds):
        sigma_m, sigma_rad = (
            _CONTRACTION**i * sigma for sigma in (perturbations.sigma_m, perturbations.sigma_rad)
        )
        R = se3.exp_so3(rng.normal(0.0, sigma_rad, (perturbations.trials, 3)))[1:]
        draws.append((R, rng.normal(0.0, sigma_m, (perturbations.trials - 1, 3))))
    return draws


@njit(cache=True)
def _counts(
    depth: FloatArray,
    low: FloatArray,
    pixel: float,
    poses: FloatArray,
    points: FloatArray,
    directions: FloatArray,
    visible: BoolArray,
    tolerance: float,
) -> IntArray:  # pragma: no cover - compiled
    """Return for each pose the numbers (n, 4) of visible model points that agree, hide, are hidden or lie
    outside.
    """
    out = np.zeros((len(poses), 4), np.int64)
    rows, columns = depth.shape
    for k in range(len(poses)):
        T_view_model = poses[k]
        # Direction from the origin of the model to the sensor, in the frame of the model.
        dx, dy, dz = inverse_translation(T_view_model)
        view, largest = 0, -np.inf
        for i in range(len(directions)):
            dot = directions[i, 0] * dx + directions[i, 1] * dy + directions[i, 2] * dz
            if dot > largest:
                view, largest = i, dot
        for i in range(len(points)):
            if not visible[view, i]:
                continue
            x, y, z = transformed(T_view_model, points[i, 0], points[i, 1], points[i, 2])
            if z <= 0.0:
                out[k, 3] += 1
                continue
            column, row = math.floor((x / z - low[0]) / pixel), math.floor((y / z - low[1]) / pixel)
            if row < 0 or column < 0 or row >= rows or column >= columns or depth[row, column] == np.inf:
                out[k, 3] += 1
                continue
            difference = depth[row, column] - z
            if difference > tolerance:
                out[k, 1] += 1
            elif difference < -tolerance:
                out[k, 2] += 1
            else:
                out[k, 0] += 1
    return out
