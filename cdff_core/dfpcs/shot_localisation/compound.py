# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of ShotLocalisation: prepare, try the guess, describe, match, prune, solve, refine, assess, answer."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.cloud_matching.acceptance import judged, refused
from cdff_core.cloud_matching.configuration import MatchingConfig, Radii
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, Found, displacement_m
from cdff_core.cloud_matching.search import Search
from cdff_core.dfpcs.shot_localisation._interface import ShotLocalisationInterface


class ShotLocalisationConfig(MatchingConfig):
    """As shared, with the scales and gates of a model that is looked for in a larger scene."""

    thin_model: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for descriptors: size of the model")
    thin_scene: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for descriptors: size of the scene")
    support_voxels: Radii = Field(
        (12.0, 20.0, 8.0), min_length=1, max_length=8, description="Radii of the descriptors, in voxels, tried in turn"
    )
    noise_voxels: float = Field(1.5, gt=0.0, le=20.0, description="Noise of right pairs, in voxels")
    min_overlap: float = Field(0.4, gt=0, le=1, description="Share of the model that is seen, FAILED below")
    good_overlap: float = Field(0.6, gt=0, le=1, description="Share of the model that is seen, DEGRADED below")
    ambiguity: float = Field(1.5, ge=1, description="Another place is as good within this factor on the residuals")


class ShotLocalisation(ShotLocalisationInterface):
    """Find the model in each scene."""

    Config: ClassVar[type[DfpcConfig]] = ShotLocalisationConfig

    config: ShotLocalisationConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        c = self.config
        self._matcher = CloudMatcher(self, c.keypoint_voxels, c.noise_voxels)
        self._thin_model, self._thin_scene = self.dfn("thin_model"), self.dfn("thin_scene")
        self._last: TransformWithCovariance | None = None
        self._model: Sample | None = None
        self._prepared: Cloud | None = None
        self._model_fault = ""
        self._waiting: Sample | None = None
        self.forget()
        self.store.offer("model", self._model_cloud)
        self.store.offer("last_pose", lambda: self._last)

    def forget(self) -> None:
        """Forget the guess."""
        self._guess: Sample | None = None

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Keep the guess for the next scene."""
        self._guess = sample
        return ()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and keep the model; meet the scene that waited for one."""
        self._model, self._prepared, self._model_fault = sample, None, ""
        try:
            self._prepared = self._matcher.prepared(sample, self._thin_model)
        except InputError as error:
            self._model_fault = f"bad_model:{error}"
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else self.on_scene(waiting)

    def on_scene(self, sample: Sample) -> Iterable[Output]:
        """Find the model in the scene; without a model the scene waits."""
        if self._model is None:
            self._waiting = sample
            return
        guess, self._guess = self._guess, None
        found, quality = self._answer(sample, guess)
        yield self._output(sample, self._model, guess, found, quality)

    def _answer(self, sample: Sample, guess: Sample | None) -> tuple[Found | None, Quality]:
        """From the guess where that is acceptable, else from the descriptors."""
        if self._prepared is None:
            return None, Quality(Status.FAILED, (self._model_fault,))
        try:
            scene = self._matcher.prepared(sample, self._thin_scene)
            near = None if guess is None else self._from_guess(self._prepared, scene, guess)
            return near or self._searched(self._prepared, scene)
        except InputError as error:
            return None, Quality(Status.FAILED, (f"bad_input:{error}",))

    def _from_guess(self, model: Cloud, scene: Cloud, guess: Sample) -> tuple[Found, Quality] | None:
        """Refine from the guess and assess; None where the result is not acceptable."""
        try:
            found = self._matcher.refined(model, scene, guess.value.transform.matrix, {})
        except (RefusedError, DegenerateGeometryError):
            return None
        quality = self._judged(found)
        return None if quality.status is Status.FAILED else (found, quality)

    def _searched(self, model: Cloud, scene: Cloud) -> tuple[Found | None, Quality]:
        """The better of the first acceptable place and one elsewhere; as good as one another, they are ambiguous."""
        search = Search(self._matcher, model, scene, self.config, self._judged)
        first = next(search.acceptable(), None)
        if first is None:
            return None, refused("not_found", search.refusals)
        second = next((other for other in search.elsewhere(first[0]) if self._is_elsewhere(first[0], other[0])), None)
        if second is None:
            return first
        better, worse = sorted((first, second), key=lambda place: float(place[0].assessment.rms_m))
        if float(worse[0].assessment.rms_m) <= self.config.ambiguity * float(better[0].assessment.rms_m):
            return None, Quality(Status.FAILED, ("ambiguous", *better[1].reasons), metrics=better[1].metrics)
        return better

    def _judged(self, found: Found) -> Quality:
        """By how much of the model is seen: a scene is larger than what is to be found in it."""
        return judged(found, float(found.assessment.overlap_source), self.config)

    def _is_elsewhere(self, found: Found, other: Found) -> bool:
        a = found.assessment
        T = found.T_target_source, other.T_target_source
        return displacement_m(T[1], T[0], a.centre_m, float(a.radius_m)) > float(a.radius_m)

    def _output(
        self, scene: Sample, model: Sample, guess: Sample | None, found: Found | None, quality: Quality
    ) -> Output:
        frame, child = scene.value.frame, model.value.frame
        value = None
        if found is not None and quality.status is not Status.FAILED:
            T = UncertainTransform(found.T_target_source, found.assessment.covariance)
            value = self._last = TransformWithCovariance.from_transform(
                T, parent=frame, child=child, stamp_ns=scene.stamp_ns, producer=self.name
            )
        used = tuple(s.id for s in (model, scene, guess) if s is not None and s.id)
        return Output("pose", value, scene.stamp_ns, scene.stamp_ns, frame, child, quality, used)

    def _model_cloud(self) -> Pointcloud | None:
        if self._model is None or self._prepared is None:
            return None
        points = self._prepared.points_m
        return Pointcloud.from_points(points, frame=self._model.value.frame, stamp_ns=self._model.stamp_ns)
