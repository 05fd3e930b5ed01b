# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Localisation of a model in a single view: search, test for other poses, registration, assessment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.kdtree import kd_tree
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_core.cloud_matching.acceptance import main_components
from cdff_core.cloud_matching.matcher import Registration, refine_and_assess
from cdff_core.dfns.registration_3d.interface import Registration3DOutputs
from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentInputs
from cdff_core.partial_views.configuration import ViewSearchConfig
from cdff_core.partial_views.range_image import RangeImage, range_image
from cdff_core.partial_views.search import ViewCandidate, ViewModel, ViewSearch

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn

#: Radius of the part of the scene that is registered, and voxel size in it, in diameters of the model.
_REGION, _VOXEL = 0.6, 0.02
#: Number of neighbours that determine a normal.
_NORMAL_NEIGHBOURS = 20
#: If the scores of candidates are too similar, they are compared again with the tolerance times these
#: factors.
_FINER = (0.5, 0.25, 0.125)
#: A pose is an alternative to another one if they differ by more than the limits of ``is_same`` times this
#: factor.
_ELSEWHERE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class _Choice:
    """The best candidate, the factor on the tolerance of its score, its margin, and its equivalent poses."""

    best: ViewCandidate
    factor: float
    margin: float
    equivalent: int


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Points (n, 3), metres, and unit normals (n, 3), as ``refine_and_assess`` requires them."""

    points_m: FloatArray
    normals: FloatArray


class ViewLocaliser:
    """Localiser of models in single views; it uses the registration DFNs of a compound."""

    def __init__(
        self,
        refine: Dfn[Any, Any, Any],
        assess: Dfn[Any, Any, Any],
        cfg: ViewSearchConfig,
        good_agreement: float,
        seed: int = 0,
    ) -> None:
        self._refine, self._assess, self._cfg = refine, assess, cfg
        self._good_agreement, self._seed = good_agreement, seed

    def localise(self, model: ViewModel, scene_m: FloatArray) -> tuple[Registration | None, Quality]:
        """Return the registration of the model in a scene, None if it fails, and its quality.

        Parameters
        ----------
        model : ViewModel
        scene_m : FloatArray, shape (n, 3)
            Finite points in the frame of the sensor, metres.

        Raises
        ------
        RefusedError
            ``too_far`` if the scene does not resolve the model, ``no_overlap`` if the registered clouds do
            not overlap.
        """
        image = range_image(scene_m)
        if image is None:
            return None, Quality.failed("not_found", "several_views")
        search = ViewSearch(model, scene_m, image, self._cfg, self._seed)
        candidates = _separate(search, model, search.candidates(), self._cfg)
        best_score = candidates[0].score if candidates else 0.0
        if best_score < self._cfg.min_score:
            reason = f"low_view_score:{best_score:.2f}<{self._cfg.min_score:g}"
            return None, Quality.failed("not_found", reason, metrics={"view_score": best_score})
        choice = _choose(search, model, candidates, self._cfg)
        best = choice.best
        metrics = {
            "view_score": best.score,
            "view_margin": choice.margin,
            "equivalent_poses": 1.0 + choice.equivalent,
        }
        if choice.margin < self._cfg.min_margin:
            reason = f"low_view_margin:{choice.margin:.2f}<{self._cfg.min_margin:g}"
            return None, Quality.failed("not_found", reason, metrics=metrics)
        registration = self._register(search, image, model, choice, metrics)
        degraded = ["symmetric_model"] if choice.equivalent else []
        degraded += [] if registration.step.iterations else ["not_refined"]
        weak = registration.assessment.agreement < self._good_agreement
        # The outline of the model constrains these directions too, but is not part of the covariance.
        degraded += [f"weak:{name}" for name in main_components(registration.assessment.directions[weak])]
        all_metrics = {
            **metrics,
            "overlap_source": registration.assessment.overlap_source,
            "rms_m": registration.assessment.rms_m,
            "refinement_m": registration.refinement_m,
        }
        return registration, Quality.from_reasons(degraded, CovarianceKind.FORMAL, all_metrics)

    def _register(
        self,
        search: ViewSearch,
        image: RangeImage,
        model: ViewModel,
        choice: _Choice,
        metrics: Mapping[str, float],
    ) -> Registration:
        """Return the registration of the visible points; if the view contradicts it, the found pose without
        refinement.
        """
        best = choice.best
        surface = best.side.surface
        visible = surface.visible_from(-best.T[:3, :3].T @ best.T[:3, 3])
        R_scene_view, t = image.R_view_scene.T, -model.centre_m
        T_scene_view, T_centre_model = se3.transform(R_scene_view, np.zeros(3)), se3.transform(np.eye(3), t)
        source = _Surface(surface.points_m[visible] + model.centre_m, surface.normals[visible])
        is_near = np.linalg.norm(search.near_m - best.T[:3, 3], axis=1) < _REGION * model.diameter_m
        target_m = voxel_means(search.near_m[is_near] @ R_scene_view.T, _VOXEL * model.diameter_m)
        normals = plane_fits(kd_tree(target_m), min(_NORMAL_NEIGHBOURS, len(target_m)))[0]
        target = _Surface(target_m, normals)
        T = T_scene_view @ best.T @ T_centre_model
        registration = refine_and_assess(self._refine, self._assess, source, target, T, metrics)
        refined_pose = se3.inverse(T_scene_view) @ registration.T_target_source @ se3.inverse(T_centre_model)
        score = float(search.comparison(surface, choice.factor).scores(refined_pose[None])[0])
        if score >= best.score - 0.5 * self._cfg.min_margin and search.is_same(refined_pose, best.T):
            return registration
        return self._without_refinement(source, target, T, search.pose_covariance(), model, metrics)

    def _without_refinement(
        self,
        source: _Surface,
        target: _Surface,
        T_scene_model: FloatArray,
        covariance: FloatArray,
        model: ViewModel,
        metrics: Mapping[str, float],
    ) -> Registration:
        """Return the assessed pose (4, 4) of the search.

        ``covariance`` (6, 6) is that of the search, about the centre of the model; it is added to that of the
        assessment, which assumes a registered pose.
        """
        assessment = self._assess.process(
            RegistrationAssessmentInputs(
                source=source.points_m,
                source_normals=source.normals,
                target=target.points_m,
                target_normals=target.normals,
                transform=T_scene_model,
            )
        )
        to_centre, from_centre = (se3.transform(np.eye(3), c) for c in (model.centre_m, -model.centre_m))
        of_search = compose_covariance(T_scene_model @ to_centre, covariance, from_centre, np.zeros((6, 6)))
        return Registration(
            Registration3DOutputs(
                transform=T_scene_model, residual_scale_m=assessment.rms_m, iterations=0, converged=False
            ),
            replace(assessment, covariance=assessment.covariance + of_search),
            0.0,
            metrics,
        )


def _separate(
    search: ViewSearch, model: ViewModel, candidates: list[ViewCandidate], cfg: ViewSearchConfig
) -> list[ViewCandidate]:
    """Return the candidates without those of a closed model whose outline is not seen in the scene.

    Candidates with a score that cannot influence the choice are not tested.
    """
    if not model.sides[0].surface.is_closed:
        return candidates
    tested_score = cfg.min_score - cfg.min_margin
    return [c for c in candidates if c.score < tested_score or search.outline_steps(c) >= cfg.min_outline]


def _choose(
    search: ViewSearch, model: ViewModel, candidates: list[ViewCandidate], cfg: ViewSearchConfig
) -> _Choice:
    """Return the best candidate with its margin over the others.

    If the margin is too small, the candidates are compared with smaller tolerances, as far as the noise of
    the scene permits, until the margin suffices. If it never does, the choice is that with the whole
    tolerance.
    """
    whole = choice = _choice(search, model, candidates, 1.0)
    for factor in _FINER:
        if choice.margin >= cfg.min_margin or not search.resolves(factor):
            break
        remaining = [candidate for candidate in candidates if candidate.score >= cfg.min_score]
        candidates = search.refined(remaining, factor)
        if candidates[0].score < cfg.min_score:
            return whole
        choice = _choice(search, model, candidates, factor)
    return choice if choice.margin >= cfg.min_margin else whole


def _choice(search: ViewSearch, model: ViewModel, candidates: list[ViewCandidate], factor: float) -> _Choice:
    """Return the best of candidates that are scored with ``factor`` times the tolerance."""
    equivalent, alternatives = _alternatives(search, model, candidates)
    margin = candidates[0].score - max((other.score for other in alternatives), default=0.0)
    return _Choice(candidates[0], factor, margin, equivalent)


def _alternatives(
    search: ViewSearch, model: ViewModel, candidates: list[ViewCandidate]
) -> tuple[int, list[ViewCandidate]]:
    """Return the number of candidates equivalent to the best by symmetry, and the candidates elsewhere."""
    best, *others = candidates
    equivalent, alternatives = 0, []
    for other in others:
        if search.is_same(best.T, other.T, _ELSEWHERE):
            continue
        if model.is_symmetry(se3.inverse(best.T) @ other.T, _ELSEWHERE * search.tolerance_m):
            equivalent += 1
        else:
            alternatives.append(other)
    return equivalent, alternatives
