# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of IcpLocalisation: prepare, register coarse to fine, assess, restart, confirm, publish."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import Pointcloud
from cdff_core.cloud_matching.matcher import displacement_m
from cdff_core.cloud_matching.model_localisation import ModelLocalisation
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.point_cloud_transformation.interface import PointCloudTransformationInputs
from cdff_core.dfns.registration_3d.interface import Registration3DInputs, Registration3DOutputs
from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentInputs
from cdff_core.dfpcs.icp_localisation.acceptance import Alignment, alignment_quality, displace
from cdff_core.dfpcs.icp_localisation.cloud_pyramid import Level, Pyramid
from cdff_core.dfpcs.icp_localisation.configuration import IcpLocalisationConfig
from cdff_core.dfpcs.icp_localisation.interface import IcpLocalisationInterface

Float = NDArray[np.float64]

#: Least number of points of a cloud after filtering.
_MIN_POINTS = 100
#: Gate for two poses that count as equal, in point spacings.
_GATE_SPACINGS = 2.5
#: Slots on whose parameters the calibration of the covariance depends.
_CALIBRATED_SLOTS = ("thin_medium", "thin_fine", "normals", "register_coarse", "register_fine", "assess")
#: Ratio of the number of points of the fine level to that of the level with which it is compared.
_COARSER = 3
#: Number of least constrained directions along which restarts are displaced.
_RESTART_DIRECTIONS = 3
#: Displacement of restarts, in radii of the overlap.
_RESTART_RADII = 0.2
#: Ratio of residuals up to which two poses count as equally good.
_AMBIGUITY = 1.15


class IcpLocalisation(ModelLocalisation[Pyramid], IcpLocalisationInterface):
    """Localise the model in each scene."""

    Config = IcpLocalisationConfig
    config: IcpLocalisationConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._filter, self._outliers = self.dfn("filter"), self.dfn("outliers")
        self._thin = [self.dfn(f"thin_{level}") for level in ("coarse", "medium", "fine")]
        self._normals, self._assess = self.dfn("normals"), self.dfn("assess")
        self._transform = self.dfn("transform")
        coarse, fine = self.dfn("register_coarse"), self.dfn("register_fine")
        self._register = [coarse, fine, fine]
        self.setup_model(self._prepare)
        self.store.offer("last_alignment", lambda: self._last)
        self.store.offer("aligned_model", self._aligned_model)

    def forget(self) -> None:
        """Clear guess and last alignment; the next scene starts from the identity."""
        self._guess = self._last = None

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the model; process the scene that waited for one."""
        self._last = None
        return super().on_model(sample)

    @property
    def _covariance_kind(self) -> CovarianceKind:
        """Kind of the covariance of the implementation; FORMAL if parameters of its DFNs were changed."""
        is_changed = any(self.slot_parameters(slot) for slot in _CALIBRATED_SLOTS)
        return CovarianceKind.FORMAL if is_changed else self.covariance_kind

    def _localise(self, model: Pyramid, sample: Sample) -> tuple[UncertainTransform, Quality]:
        """Register coarse to fine from the guess, restart after a failure, confirm the result."""
        scene = self._prepare(sample)
        alignment = self._coarse_to_fine(scene, model, self._initial_guess())
        quality = alignment_quality(alignment, self.config, self._covariance_kind)
        if quality.status is Status.FAILED:
            alignment, quality = self._restart(scene, model, alignment, quality)
        if quality.status is not Status.FAILED and not self._is_confirmed(scene, model, alignment):
            quality = Quality.failed("ambiguous", *quality.reasons, metrics=quality.metrics)
        return UncertainTransform(alignment.T_scene_model, alignment.assessment.covariance), quality

    def _coarse_to_fine(
        self, scene: Pyramid, model: Pyramid, T_scene_model: Float, levels: int = 3
    ) -> Alignment:
        """Register on the first ``levels`` levels from a start pose, and assess the result."""
        steps = self._register_levels(scene, model, T_scene_model, levels)
        T_scene_model = steps[-1].transform
        level = min(levels - 1, 1) if self.config.assessed_level == "medium" else levels - 1
        s, m = scene.levels[level], model.levels[level]
        is_complete = levels == len(scene.levels)
        assessment = self._assess.process(
            RegistrationAssessmentInputs(
                source=m.points_m,
                source_normals=m.normals,
                target=s.points_m,
                target_normals=s.normals,
                transform=T_scene_model,
                coarser_transform=self._coarser(scene, model, steps) if is_complete else None,
            )
        )
        return Alignment(
            T_scene_model=T_scene_model,
            assessment=assessment,
            residual_scale_m=steps[-1].residual_scale_m,
            iterations=sum(step.iterations for step in steps),
            converged=steps[-1].converged,
            jump=_largest_jump(scene, model, steps),
        )

    def _register_levels(
        self, scene: Pyramid, model: Pyramid, T_scene_model: Float, levels: int
    ) -> list[Registration3DOutputs]:
        """Return the registration on each of the first ``levels`` levels, each from the previous result."""
        steps: list[Registration3DOutputs] = []
        for index, (s, m) in enumerate(zip(scene.levels[:levels], model.levels[:levels], strict=True)):
            with_normals = index == 0 or self.config.normals_to_fine
            steps.append(self._register_level(index, s, m, T_scene_model, with_normals))
            T_scene_model = steps[-1].transform
        return steps

    def _register_level(
        self, index: int, scene: Level, model: Level, T_scene_model: Float, with_normals: bool
    ) -> Registration3DOutputs:
        """Register the model with the scene at one level, from a guess (4, 4)."""
        step: Registration3DOutputs = self._register[index].process(
            Registration3DInputs(
                source=model.points_m,
                target=scene.points_m,
                target_normals=scene.normals if with_normals else None,
                guess=T_scene_model,
            )
        )
        return step

    def _coarser(self, scene: Pyramid, model: Pyramid, steps: list[Registration3DOutputs]) -> Float:
        """Return the registration at a lower resolution, with which the final one is compared.

        This is the result on the medium level, or that on thinned fine levels if the clouds are so small that
        the medium level has nearly as many points as the fine one.
        """
        if scene.is_thinned and model.is_thinned:
            medium: Float = steps[-2].transform
            return medium
        s, m = (cloud.levels[-1].thinned(_COARSER) for cloud in (scene, model))
        return self._register_level(-1, s, m, steps[-1].transform, self.config.normals_to_fine).transform

    def _restart(
        self, scene: Pyramid, model: Pyramid, failed: Alignment, quality: Quality
    ) -> tuple[Alignment, Quality]:
        """Restart on the coarse level along the least constrained directions; refine the best alignment."""
        best: Alignment | None = None
        for T in self._displaced_starts(failed, self.config.restarts):
            try:
                coarse = self._coarse_to_fine(scene, model, T, levels=1)
            except RefusedError:
                continue
            if best is None or coarse.merit > best.merit:
                best = coarse
        if best is None:
            return failed, quality
        refined_alignment = self._coarse_to_fine(scene, model, best.T_scene_model)
        refined_quality = alignment_quality(refined_alignment, self.config, self._covariance_kind)
        return (
            (failed, quality)
            if refined_quality.status is Status.FAILED
            else (refined_alignment, refined_quality)
        )

    def _is_confirmed(self, scene: Pyramid, model: Pyramid, alignment: Alignment) -> bool:
        """Return whether no displaced start leads to another, equally good alignment (medium level)."""
        if not self.config.confirmations:
            return True
        a = alignment.assessment
        medium: Alignment | None = None
        for T in self._displaced_starts(alignment, self.config.confirmations):
            try:
                (coarse,) = self._register_levels(scene, model, T, levels=1)
                gate_m = _GATE_SPACINGS * max(cloud.levels[1].spacing_m for cloud in (scene, model))
                T_scene_model = alignment.T_scene_model
                if displacement_m(coarse.transform, T_scene_model, a.centre_m, a.radius_m) <= gate_m:
                    continue
                other = self._coarse_to_fine(scene, model, T, levels=2)
                medium = medium or self._coarse_to_fine(scene, model, T_scene_model, levels=2)
            except RefusedError:
                continue
            is_elsewhere = displacement_m(other.T_scene_model, T_scene_model, a.centre_m, a.radius_m) > gate_m
            as_good = other.residual_scale_m <= _AMBIGUITY * medium.residual_scale_m
            if (
                is_elsewhere
                and as_good
                and alignment_quality(other, self.config, self._covariance_kind).status is not Status.FAILED
            ):
                return False
        return True

    def _displaced_starts(self, alignment: Alignment, count: int) -> Iterator[Float]:
        """Yield starts displaced to both sides along the least constrained directions."""
        a = alignment.assessment
        weakest = np.argsort(a.agreement * a.information)[:_RESTART_DIRECTIONS]
        steps = [(index, sign) for index in weakest for sign in (1.0, -1.0)]
        radius_m = a.radius_m
        for index, sign in steps[:count]:
            distance_m = sign * _RESTART_RADII * radius_m
            yield displace(alignment.T_scene_model, a.directions[index], distance_m, a.centre_m, radius_m)

    def _prepare(self, sample: Sample) -> Pyramid:
        """Filter, thin to three levels, remove outliers, estimate normals."""
        filtered = self._filter.process(
            PointCloudFilteringInputs(points=sample.value.points_m)
        ).filtered_points
        if len(filtered) < _MIN_POINTS:
            raise InputError(f"{sample.port}: {len(filtered)} points remain, expected at least {_MIN_POINTS}")
        thinned = self._thin[-1].process(PointCloudDownsamplingInputs(points=filtered)).points
        fine = self._outliers.process(PointCloudFilteringInputs(points=thinned)).filtered_points
        clouds = [thin.process(PointCloudDownsamplingInputs(points=fine)).points for thin in self._thin[:-1]]
        return Pyramid(tuple(Level(points, self._normals_of) for points in (*clouds, fine)))

    def _normals_of(self, points_m: Float) -> Float:
        normals: Float = self._normals.process(NormalsEstimationInputs(points=points_m)).normals
        return normals

    def _initial_guess(self) -> Float:
        """Return the newer of guess and last alignment; the identity without either."""
        last = self._last
        if self._guess is not None and (last is None or self._guess.stamp_ns >= last.stamp_ns):
            guess: Float = self._guess.value.transform.matrix
            return guess
        return np.eye(4) if last is None else last.transform.matrix

    def _aligned_model(self) -> Pointcloud | None:
        """Return the model at the last pose; None before the first one."""
        last = self._last
        if last is None:
            return None
        inputs = PointCloudTransformationInputs(
            points=self._model.prepared().points_m, transform=last.transform.matrix
        )
        points = self._transform.process(inputs).transformed_points
        return Pointcloud.from_points(points, frame=last.parent_frame, stamp_ns=last.stamp_ns)


def _largest_jump(scene: Pyramid, model: Pyramid, steps: list[Registration3DOutputs]) -> float:
    """Return the largest displacement between successive levels, in overlap gates of the coarser one."""
    jump = 0.0
    for index, (before, after) in enumerate(pairwise(step.transform for step in steps)):
        gate_m = _GATE_SPACINGS * max(cloud.levels[index].spacing_m for cloud in (scene, model))
        m = model.levels[index + 1]
        centre_m = before[:3, :3] @ m.centre_m + before[:3, 3]
        jump = max(jump, displacement_m(after, before, centre_m, m.radius_m) / gate_m)
    return jump
