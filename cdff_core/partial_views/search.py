# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for a model in a single view of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import KdTree, kd_tree, nearest, neighbours, spacing
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_core.partial_views.configuration import ViewSearchConfig
from cdff_core.partial_views.model_surface import ModelSurface, model_surface
from cdff_core.partial_views.outline import outline_steps
from cdff_core.partial_views.pair_voting import PairTable, pair_table, vote
from cdff_core.partial_views.range_image import RangeImage
from cdff_core.partial_views.view_comparison import Perturbations, ViewComparison

#: Number of points of the surface of a model.
_FINE_POINTS = 4000
#: Number of neighbours that determine a normal.
_NORMAL_NEIGHBOURS = 20
#: Radius of the surroundings of a reference point whose relief is computed, in diameters.
_RELIEF_RADIUS = 0.25
#: Number of points from which the relief is computed, and fraction of the points that form pairs with a
#: reference point.
_RELIEF_POINTS, _PARTNERS = 8000, 0.4
#: Perturbations of all hypotheses, and of the best distinct ones, in diameters and radians.
_FIRST_REFINEMENT = Perturbations(0.05, 0.12, 3, 40)
_LAST_REFINEMENT = Perturbations(0.03, 0.09, 6, 80)
#: Poses that differ by less than this, in diameters and radians, are the same hypothesis.
_SAME_M, _SAME_RAD = 0.1, 0.35
#: Number of points of the scene from which the noise is computed.
_NOISE_POINTS = 5000
#: Minimum fraction of the points of a model that a symmetry maps to its surface; a small part, such as the
#: handle of a cup, breaks the symmetry.
_SYMMETRIC = 0.995
#: Minimum tolerance in standard deviations of the noise of the scene.
_SIGMAS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ModelSide:
    """One orientation of the surface of a model: all points, points at ``step``, and the pairs of these."""

    surface: ModelSurface
    coarse: ModelSurface
    table: PairTable


@dataclass(frozen=True, eq=False)
class ViewModel:
    """A model prepared for the search.

    Attributes
    ----------
    centre_m : ndarray, shape (3,)
        Mean of the points in the frame of the model, metres; origin of the points of ``sides``.
    diameter_m : float
    sides : tuple of ModelSide
        One side of a closed surface, both sides of an open one.
    """

    centre_m: FloatArray
    diameter_m: float
    sides: tuple[ModelSide, ...]

    def is_symmetry(self, T: FloatArray, tolerance_m: float) -> bool:
        """Return whether a transform (4, 4) about ``centre_m`` maps the model to itself."""
        moved_points = se3.transform_points(T, self.sides[0].surface.points_m)
        distance_m, _ = nearest(self._tree, moved_points, tolerance_m)
        return bool(np.mean(np.isfinite(distance_m)) > _SYMMETRIC)

    @cached_property
    def spacing_m(self) -> float:
        """Median distance between neighbouring points of the surface, metres."""
        return spacing(self._tree)

    @cached_property
    def _tree(self) -> KdTree:
        return kd_tree(self.sides[0].surface.points_m)


@dataclass(frozen=True, slots=True, eq=False)
class ViewCandidate:
    """A pose ``T_view_centre`` (4, 4), metres, with its score."""

    T: FloatArray
    score: float
    side: ModelSide


def prepare_model(points_m: FloatArray, cfg: ViewSearchConfig) -> ViewModel:
    """Return a model of points ``(n, 3)``, metres, prepared for the search."""
    centre_m = points_m.mean(axis=0)
    points_m = points_m - centre_m
    diameter_m = 2.0 * float(np.sqrt(np.max(np.sum(points_m**2, axis=1))))
    fine_m = voxel_for(points_m, _FINE_POINTS) or diameter_m / 100.0
    points = voxel_means(points_m, fine_m)
    count = max(_NORMAL_NEIGHBOURS, 4 * len(points_m) // len(points))
    dense = points_m if len(points_m) < 10 * _FINE_POINTS else points
    count = count if dense is points_m else _NORMAL_NEIGHBOURS
    normals = plane_fits(kd_tree(dense), min(count, len(dense)))[0]
    normals = normals[nearest(kd_tree(dense), points)[1]]
    surface = model_surface(points, normals, fine_m)
    step_m = cfg.step * diameter_m
    rows = np.unique(nearest(kd_tree(points), voxel_means(points, step_m))[1])
    surfaces = (surface,) if surface.is_closed else (surface, surface.reversed())
    sides = []
    for side in surfaces:
        coarse = side.subset(rows)
        sides.append(ModelSide(side, coarse, pair_table(coarse.points_m, coarse.normals, step_m)))
    return ViewModel(centre_m, diameter_m, tuple(sides))


class ViewSearch:
    """Search for candidate poses of a model in a view.

    Attributes
    ----------
    near_m : ndarray, shape (n, 3)
        Points of the scene that are near enough to resolve the model, in the frame of the view, metres.
    tolerance_m : float
        Largest depth difference between model and scene that agree.

    Raises
    ------
    RefusedError
        ``too_far`` if too few points of the scene are near enough to resolve the model.
    """

    def __init__(
        self,
        model: ViewModel,
        scene_m: FloatArray,
        image: RangeImage,
        cfg: ViewSearchConfig,
        seed: int = 0,
    ) -> None:
        self._model, self._image, self._cfg, self._seed = model, image, cfg, seed
        view = scene_m @ image.R_view_scene.T
        is_resolved = view[:, 2] * image.spacing * cfg.min_pixels < model.diameter_m
        self.near_m = view[is_resolved]
        if len(self.near_m) < _FINE_POINTS // 10:
            raise RefusedError("the model covers too few measurements", ["too_far"])
        self._step_m = cfg.step * model.diameter_m
        self._points, self._normals = _scene_surface(self.near_m, self._step_m)
        self._noise_m = _SIGMAS * _noise(self.near_m)
        self.tolerance_m = max(cfg.tolerance * model.diameter_m, self._noise_m)

    def candidates(self) -> list[ViewCandidate]:
        """Return distinct candidates, best first."""
        references, start, index = self._references()
        candidates: list[ViewCandidate] = []
        for side in self._model.sides:
            poses = vote(side.table, self._points, self._normals, references, start, index, self._cfg.peaks)
            candidates += self._refine_poses(side, poses)
        return sorted(candidates, key=lambda candidate: -candidate.score)

    def resolves(self, factor: float) -> bool:
        """Return whether the noise of the scene is below ``factor`` times the tolerance."""
        return factor * self.tolerance_m >= self._noise_m

    def refined(self, candidates: list[ViewCandidate], factor: float) -> list[ViewCandidate]:
        """Return the candidates refined and scored with ``factor`` times the tolerance, best first.

        Poses that agree equally well with the view within the tolerance are distinguished by a smaller one.
        """
        perturbations = _LAST_REFINEMENT.scaled(factor * self._model.diameter_m, factor)
        refined_candidates = []
        for candidate in candidates:
            coarse = self.comparison(candidate.side.coarse, factor)
            T, _ = coarse.refine(candidate.T, perturbations, self._seed)
            score = self.comparison(candidate.side.surface, factor).scores(T[None])[0]
            refined_candidates.append(replace(candidate, T=T, score=float(score)))
        return sorted(refined_candidates, key=lambda candidate: -candidate.score)

    def comparison(self, surface: ModelSurface, factor: float = 1.0) -> ViewComparison:
        """Return the comparison of a surface with the view."""
        return ViewComparison(self._image, surface, factor * self.tolerance_m)

    def is_same(self, first: FloatArray, second: FloatArray, factor: float = 1.0) -> bool:
        """Return whether two poses are one hypothesis."""
        return _is_same(first, second, self._model.diameter_m, factor)

    def outline_steps(self, candidate: ViewCandidate) -> float:
        """Return the fraction of the outline of the model at which the depth of the scene has a step."""
        spacing_m = self._model.spacing_m
        surface = candidate.side.surface
        return outline_steps(self._image, surface, candidate.T, spacing_m, self.tolerance_m)

    def pose_covariance(self) -> FloatArray:
        """Return the covariance (6, 6), [x y z rx ry rz] in the frame of the view, of a pose without
        registration.

        Depths that differ by less than ``tolerance_m`` agree, so that the surface of the model is known with
        the standard deviation of a uniform distribution of this half width.
        """
        sigma_m = self.tolerance_m / np.sqrt(3.0)
        sigma_rad = sigma_m / (0.5 * self._model.diameter_m)
        return np.asarray(np.diag(np.square([sigma_m] * 3 + [sigma_rad] * 3)))

    def _references(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the rows of reference points, and ``start`` and ``index`` of their neighbours."""
        rng, points = np.random.default_rng(self._seed), self._points
        diameter_m = self._model.diameter_m
        relief = _relief(points, _RELIEF_RADIUS * diameter_m, rng)
        rows = np.flatnonzero(relief > self._cfg.relief * diameter_m)
        references = np.sort(rng.permutation(rows)[: self._cfg.references])
        partners = np.sort(rng.permutation(len(points))[: int(_PARTNERS * len(points))])
        start, index = radius_neighbours(points[partners], points[references], 0.9 * diameter_m)
        return references, start, partners[index]

    def _refine_poses(self, side: ModelSide, poses: FloatArray) -> list[ViewCandidate]:
        """Return the best distinct poses after refinement."""
        diameter_m, cfg = self._model.diameter_m, self._cfg
        if not len(poses):
            return []
        coarse = self.comparison(side.coarse, cfg.coarse_factor)
        best = np.argsort(-coarse.scores(poses), kind="stable")[: cfg.hypotheses]
        first, last = (p.scaled(diameter_m) for p in (_FIRST_REFINEMENT, _LAST_REFINEMENT))
        poses_and_scores = sorted(
            (coarse.refine(poses[i], first, self._seed) for i in best), key=lambda pair: -pair[1]
        )
        distinct: list[FloatArray] = []
        for T, _ in poses_and_scores:
            if not any(self.is_same(T, other) for other in distinct):
                distinct.append(T)
            if len(distinct) == cfg.finalists:
                break
        exact = self.comparison(side.coarse)
        final_poses = np.stack([exact.refine(T, last, self._seed)[0] for T in distinct])
        scores = self.comparison(side.surface).scores(final_poses)
        return [ViewCandidate(T, float(score), side) for T, score in zip(final_poses, scores, strict=True)]


def _is_same(first: FloatArray, second: FloatArray, diameter_m: float, factor: float) -> bool:
    distance_m = float(np.linalg.norm(first[:3, 3] - second[:3, 3]))
    angle = float(se3.rotation_angle(first[:3, :3].T @ second[:3, :3]))
    return distance_m < factor * _SAME_M * diameter_m and angle < factor * _SAME_RAD


def _scene_surface(points_m: FloatArray, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3), one per voxel, and unit normals (n, 3) towards the sensor at the origin."""
    dense, points = voxel_means(points_m, 0.5 * step_m), voxel_means(points_m, step_m)
    tree = kd_tree(dense)
    normals = plane_fits(tree, min(_NORMAL_NEIGHBOURS, len(dense)))[0][nearest(tree, points)[1]]
    sign = np.where(np.einsum("ij,ij->i", normals, points) > 0.0, -1.0, 1.0)
    return points, normals * sign[:, None]


def _relief(points: FloatArray, radius_m: float, rng: np.random.Generator) -> FloatArray:
    """Return the relief (n,), metres: standard deviation of surrounding points across their plane."""
    sample = points[np.sort(rng.permutation(len(points))[:_RELIEF_POINTS])]
    start, index = radius_neighbours(sample, points, radius_m)
    count = np.diff(start)
    row = np.repeat(np.arange(len(points)), count)
    weight = 1.0 / np.maximum(count, 1)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(row, weights=values, minlength=len(points)) * weight

    offset = sample[index] - points[row]
    centre = np.stack([mean(offset[:, i]) for i in range(3)], axis=1)
    covariance = np.empty((len(points), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            product = mean(offset[:, i] * offset[:, j]) - centre[:, i] * centre[:, j]
            covariance[:, i, j] = covariance[:, j, i] = product
    smallest = np.linalg.eigvalsh(covariance)[:, 0]
    return np.where(count > 3, np.sqrt(np.maximum(smallest, 0.0)), 0.0)


def _noise(points_m: FloatArray) -> float:
    """Return the noise, metres: median standard deviation of points across the planes of their neighbours."""
    sample = points_m[:: max(1, len(points_m) // _NOISE_POINTS)]
    _, rows = neighbours(kd_tree(points_m), sample, min(_NORMAL_NEIGHBOURS, len(points_m)))
    offset = points_m[rows] - points_m[rows].mean(axis=1, keepdims=True)
    variances = np.linalg.eigvalsh(np.swapaxes(offset, 1, 2) @ offset / rows.shape[1])
    return float(np.sqrt(max(np.median(variances[:, 0]), 0.0)))
