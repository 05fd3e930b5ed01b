# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of IcpLocalisation: prepare, register coarse to fine, assess, begin again, confirm, answer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfns.point_cloud_filtering._interface import PointCloudFilteringInputs
from cdff_core.dfns.point_cloud_transformation._interface import PointCloudTransformationInputs
from cdff_core.dfns.registration_3d._interface import Registration3DInputs
from cdff_core.dfns.registration_assessment._interface import (
    RegistrationAssessmentInputs,
)
from cdff_core.dfpcs.icp_localisation._acceptance import Alignment, displaced, displacement_m, judged
from cdff_core.dfpcs.icp_localisation._interface import IcpLocalisationInterface
from cdff_core.dfpcs.icp_localisation._pyramid import Level, Pyramid

if TYPE_CHECKING:
    FloatArray = NDArray[np.float64]

_LEAST_POINTS = 100
_GATE_SPACINGS = 2.5
_WEAKEST = 3


class IcpLocalisationConfig(DfpcConfig):
    """Parameters of the DFN slots, and the gates an answer must pass."""

    filter: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on the clouds as they come")
    outliers: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on the fine level")
    thin_fine: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, fine level")
    thin_medium: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, medium level")
    thin_coarse: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, coarse level")
    normals: dict[str, Any] = Field({}, description="Of NormalsEstimation")
    register_coarse: dict[str, Any] = Field({}, description="Of Registration3D, coarse level")
    register_fine: dict[str, Any] = Field({}, description="Of Registration3D, medium and fine level")
    assess: dict[str, Any] = Field({}, description="Of RegistrationAssessment")
    transform: dict[str, Any] = Field({}, description="Of PointCloudTransformation")
    judged_on: Literal["medium", "fine"] = Field("fine", description="Level that the assessment looks at")
    normals_to_fine: bool = Field(True, description="Whether register_fine is given normals (Ndt needs none)")
    begin_from_last: bool = Field(True, description="Without a newer guess begin from the last alignment")
    min_overlap: float = Field(0.4, gt=0, le=1, description="Larger of both overlaps below which the answer is FAILED")
    good_overlap: float = Field(0.6, gt=0, le=1, description="Larger of both overlaps below which it is DEGRADED")
    min_inlier_ratio: float = Field(0.5, gt=0, le=1, description="Share of pairs the kernel keeps, FAILED below")
    max_rms_gates: float = Field(0.25, gt=0, le=1, description="Residuals in gates of the overlap, FAILED above")
    min_agreement: float = Field(0.5, ge=0, le=1, description="Agreement of a direction below which it is FAILED")
    good_agreement: float = Field(0.7, ge=0, le=1, description="Agreement of a direction below which it is DEGRADED")
    max_jump_gates: float = Field(1.0, gt=0, description="Displacement between levels in gates, FAILED above")
    restart_radii: float = Field(0.2, gt=0, le=2, description="How far restarts lie off, in radii of the overlap")
    restarts: int = Field(6, ge=0, le=6, description="Restarts along the weakest directions after a refusal")
    confirmations: int = Field(2, ge=0, le=6, description="Restarts that must not find another place as good")
    ambiguity: float = Field(1.15, ge=1, description="Another place is as good within this factor on the residuals")


class IcpLocalisation(IcpLocalisationInterface):
    """Localise the model in each scene."""

    Config: ClassVar[type[DfpcConfig]] = IcpLocalisationConfig

    config: IcpLocalisationConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        self._filter, self._outliers = self.dfn("filter"), self.dfn("outliers")
        self._thin = [self.dfn(f"thin_{level}") for level in ("coarse", "medium", "fine")]
        self._normals, self._assess, self._transform = self.dfn("normals"), self.dfn("assess"), self.dfn("transform")
        coarse, fine = self.dfn("register_coarse"), self.dfn("register_fine")
        self._register = [coarse, fine, fine]
        self._model: Pyramid | None = None
        self._model_frame, self._model_fault = "", ""
        self._waiting: Sample | None = None
        self._scene_frame, self._scene_stamp_ns = "", 0
        self.forget()
        self.store.offer("model", self._model_cloud)
        self.store.offer("last_alignment", lambda: self._last)
        self.store.offer("aligned_model", self._aligned_model)

    def forget(self) -> None:
        """Begin the next scene from the identity."""
        self._guess: Sample | None = None
        self._last: TransformWithCovariance | None = None

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Keep the guess for the scenes to come."""
        self._guess = sample
        return ()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and keep the model; meet the scene that waited for one."""
        self._last, self._model, self._model_fault = None, None, ""
        self._model_frame = sample.value.frame
        try:
            self._model = self._prepare(sample)
        except InputError as error:
            self._model_fault = f"bad_model:{error}"
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.on_scene(waiting)

    def on_scene(self, sample: Sample) -> Iterable[Output]:
        """Localise the model in the scene; without a model the scene waits."""
        if self._model_fault:
            yield self._output(sample, None, Quality(Status.FAILED, (self._model_fault,)))
            return
        if self._model is None:
            self._waiting = sample
            return
        try:
            scene = self._prepare(sample)
            found, quality = self._localise(scene, self._model)
        except (InputError, RefusedError) as error:
            reasons = getattr(error, "reasons", ()) or (f"bad_input:{error}",)
            yield self._output(sample, None, Quality(Status.FAILED, tuple(reasons)))
            return
        yield self._output(sample, found, quality)

    @property
    def _covariance_kind(self) -> CovarianceKind:
        """Calibrated is what is shipped: other DFN parameters lead to other errors."""
        c = self.config
        changed = c.thin_fine or c.normals or c.register_coarse or c.register_fine or c.assess
        return CovarianceKind.FORMAL if changed else CovarianceKind.CALIBRATED

    def _localise(self, scene: Pyramid, model: Pyramid) -> tuple[Alignment, Quality]:
        """Coarse to fine from the guess, again from elsewhere where that is refused, and confirm."""
        found = self._coarse_to_fine(scene, model, self._beginning())
        quality = judged(found, self.config, self._covariance_kind)
        if quality.status is Status.FAILED:
            found, quality = self._begin_again(scene, model, found, quality)
        if quality.status is not Status.FAILED and not self._is_confirmed(scene, model, found):
            quality = Quality(Status.FAILED, ("ambiguous", *quality.reasons), metrics=quality.metrics)
        return found, quality

    def _coarse_to_fine(self, scene: Pyramid, model: Pyramid, T: FloatArray, levels: int = 3) -> Alignment:
        iterations, jump = 0, 0.0
        for index in range(levels):
            s, m = scene.levels[index], model.levels[index]
            normals = s.normals if index == 0 or self.config.normals_to_fine else None
            step = self._register[index].process(Registration3DInputs(m.points_m, s.points_m, normals, T))
            if index > 0:
                coarser = scene.levels[index - 1], model.levels[index - 1]
                gate_m = _GATE_SPACINGS * max(level.spacing_m for level in coarser)
                moved_m = displacement_m(T, step.transform, T[:3, :3] @ m.centre_m + T[:3, 3], m.radius_m)
                jump = max(jump, moved_m / gate_m)
            T = step.transform
            iterations += int(step.iterations)
        judged_on = min(levels - 1, 1) if self.config.judged_on == "medium" else levels - 1
        s, m = scene.levels[judged_on], model.levels[judged_on]
        found = self._assess.process(RegistrationAssessmentInputs(m.points_m, m.normals, s.points_m, s.normals, T))
        return Alignment(T, found, float(step.residual_scale_m), iterations, bool(step.converged), jump)

    def _begin_again(
        self, scene: Pyramid, model: Pyramid, first: Alignment, quality: Quality
    ) -> tuple[Alignment, Quality]:
        """Begin at places along the weakest directions, on the coarse level; refine the best of them."""
        best: Alignment | None = None
        for T in self._places_beside(first, self.config.restarts, self.config.restart_radii):
            try:
                found = self._coarse_to_fine(scene, model, T, levels=1)
            except RefusedError:
                continue
            if best is None or _merit(found) > _merit(best):
                best = found
        if best is None:
            return first, quality
        refined = self._coarse_to_fine(scene, model, best.T_scene_model)
        judgement = judged(refined, self.config, self._covariance_kind)
        return (first, quality) if judgement.status is Status.FAILED else (refined, judgement)

    def _is_confirmed(self, scene: Pyramid, model: Pyramid, found: Alignment) -> bool:
        """Whether no start beside the result ends at another place that is as good on the medium level."""
        if not self.config.confirmations:
            return True
        a = found.assessment
        medium: Alignment | None = None
        for T in self._places_beside(found, self.config.confirmations, self.config.restart_radii):
            try:
                other = self._coarse_to_fine(scene, model, T, levels=1)
                gate_m = _GATE_SPACINGS * max(cloud.levels[1].spacing_m for cloud in (scene, model))
                T_found = found.T_scene_model
                if displacement_m(T_found, other.T_scene_model, a.centre_m, float(a.radius_m)) <= gate_m:
                    continue
                other = self._coarse_to_fine(scene, model, T, levels=2)
                medium = medium or self._coarse_to_fine(scene, model, T_found, levels=2)
            except RefusedError:
                continue
            is_elsewhere = displacement_m(T_found, other.T_scene_model, a.centre_m, float(a.radius_m)) > gate_m
            as_good = other.residual_scale_m <= self.config.ambiguity * medium.residual_scale_m
            if (
                is_elsewhere
                and as_good
                and judged(other, self.config, self._covariance_kind).status is not Status.FAILED
            ):
                return False
        return True

    def _places_beside(self, found: Alignment, count: int, radii: float) -> Iterator[FloatArray]:
        """Transforms to begin from: to and fro along the weakest directions, the weakest first."""
        a = found.assessment
        weakest = np.argsort(a.agreement * a.information)[:_WEAKEST]
        steps = [(index, sign) for index in weakest for sign in (1.0, -1.0)]
        radius_m = float(a.radius_m)
        for index, sign in steps[:count]:
            distance_m = sign * radii * radius_m
            yield displaced(found.T_scene_model, a.directions[index], distance_m, a.centre_m, radius_m)

    def _prepare(self, sample: Sample) -> Pyramid:
        """Filter, thin to three levels, drop outliers, estimate normals."""
        kept = self._filter.process(PointCloudFilteringInputs(sample.value.points_m)).filtered_points
        if len(kept) < _LEAST_POINTS:
            raise InputError(f"{sample.port}: {len(kept)} points are left, expected at least {_LEAST_POINTS}")
        thinned = self._thin[-1].process(PointCloudDownsamplingInputs(kept)).points
        fine = self._outliers.process(PointCloudFilteringInputs(thinned)).filtered_points
        clouds = [thin.process(PointCloudDownsamplingInputs(fine)).points for thin in self._thin[:-1]]
        levels = tuple(
            Level(points, lambda p: self._normals.process(NormalsEstimationInputs(p)).normals)
            for points in (*clouds, fine)
        )
        return Pyramid(levels, sample.value.frame, sample.stamp_ns, sample.id)

    def _beginning(self) -> FloatArray:
        """The guess if it is newer than the last alignment, else that one, else the identity."""
        last = self._last if self.config.begin_from_last else None
        if self._guess is not None and (last is None or self._guess.stamp_ns >= last.stamp_ns):
            return self._guess.value.transform.matrix
        return np.eye(4) if last is None else last.transform.matrix

    def _output(self, scene: Sample, found: Alignment | None, quality: Quality) -> Output:
        frame, child = scene.value.frame, self._model_frame
        value = None
        if found is not None and quality.status is not Status.FAILED:
            T = UncertainTransform(found.T_scene_model, found.assessment.covariance)
            value = TransformWithCovariance.from_transform(
                T, parent=frame, child=child, stamp_ns=scene.stamp_ns, producer=self.name
            )
            self._last, self._scene_frame, self._scene_stamp_ns = value, frame, scene.stamp_ns
        used = [
            self._model.sample_id if self._model else "",
            scene.id,
            self._guess.id if self._guess is not None else "",
        ]
        return Output("pose", value, scene.stamp_ns, scene.stamp_ns, frame, child, quality, tuple(i for i in used if i))

    def _model_cloud(self) -> Pointcloud | None:
        if self._model is None:
            return None
        points = self._model.fine.points_m
        return Pointcloud.from_points(points, frame=self._model.frame, stamp_ns=self._model.stamp_ns)

    def _aligned_model(self) -> Pointcloud | None:
        if self._model is None or self._last is None:
            return None
        inputs = PointCloudTransformationInputs(self._model.fine.points_m, self._last.transform.matrix)
        points = self._transform.process(inputs).transformed_points
        return Pointcloud.from_points(points, frame=self._scene_frame, stamp_ns=self._scene_stamp_ns)


def _merit(found: Alignment) -> float:
    """What restarts are compared by: overlap times the least agreement."""
    a = found.assessment
    return max(float(a.overlap_source), float(a.overlap_target)) * float(a.agreement.min())
