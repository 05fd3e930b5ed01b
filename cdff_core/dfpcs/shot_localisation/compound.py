# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of ShotLocalisation: try the guess, the descriptors, the single-view search; publish."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from contextlib import suppress

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.acceptance import registration_quality
from cdff_core.cloud_matching.matcher import Cloud, CloudMatcher, FewPointsError, Registration, displacement_m
from cdff_core.cloud_matching.model_localisation import ModelLocalisation
from cdff_core.cloud_matching.search import AlignmentSearch
from cdff_core.dfpcs.shot_localisation.configuration import ShotLocalisationConfig
from cdff_core.dfpcs.shot_localisation.interface import ShotLocalisationInterface
from cdff_core.partial_views.localisation import ViewLocaliser
from cdff_core.partial_views.search import ViewModel, prepare_model

#: Ratio of residuals up to which two poses count as equally good.
_AMBIGUITY = 1.5


class ShotLocalisation(ModelLocalisation[Cloud], ShotLocalisationInterface):
    """Localisation of the model in each scene, with or without a guess."""

    Config = ShotLocalisationConfig
    config: ShotLocalisationConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._matcher = CloudMatcher(self, self.config)
        self._thin = {"model": self.dfn("thin_model"), "scene": self.dfn("thin_scene")}
        self.setup_model(self._prepare)
        self._view_model: ViewModel | None = None
        self._views = ViewLocaliser(
            self.dfn("refine"),
            self.dfn("assess"),
            self.config.view_search,
            self.config.good_agreement,
            self.context.seed,
        )
        self.store.offer("last_pose", lambda: self._last)

    def forget(self) -> None:
        """Clear the guess."""
        self._guess = None

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the model; process the scene that waited for one."""
        self._view_model = None
        return super().on_model(sample)

    def on_scene(self, sample: Sample) -> Iterable[Output]:
        """Localise the model in the scene; a guess is used for one scene only."""
        outputs = super().on_scene(sample)
        if sample is not self._model.waiting:
            self._guess = None
        return outputs

    def _prepare(self, sample: Sample) -> Cloud:
        return self._matcher.prepare(sample.value.points_m, sample.port, self._thin[sample.port])

    def _localise(self, model: Cloud, sample: Sample) -> tuple[UncertainTransform | None, Quality]:
        """Return the pose from the guess, the descriptors or the single-view search.

        Each method is used only if the previous one yields no acceptable pose.
        """
        scene = self._prepare(sample)
        if self._guess is not None:
            with suppress(RefusedError):
                registration = self._matcher.refine(model, scene, self._guess.value.transform.matrix, {})
                quality = self._quality(registration)
                if quality.status is not Status.FAILED:
                    return registration.transform, quality
        try:
            candidate, quality = self._search(model, scene)
        except FewPointsError as error:  # a small model at the voxel size of a large scene
            candidate, quality = None, Quality.failed("not_found", *Quality.from_error(error).reasons)
        if "not_found" in quality.reasons and self.config.view_search.enabled:
            candidate, view_quality = self._search_views(sample)
            reasons = view_quality.reasons if candidate else (*quality.reasons, *view_quality.reasons[1:])
            quality = dataclasses.replace(view_quality, reasons=reasons)
        return (candidate.transform if candidate else None), quality

    def _search_views(self, scene: Sample) -> tuple[Registration | None, Quality]:
        """Return the registration by the single-view search; a refusal becomes FAILED ``not_found``."""
        if self._view_model is None:
            self._view_model = prepare_model(_finite_points(self._model.sample), self.config.view_search)
        try:
            return self._views.localise(self._view_model, _finite_points(scene))
        except RefusedError as error:
            return None, Quality.failed("not_found", *error.reasons)

    def _search(self, model: Cloud, scene: Cloud) -> tuple[Registration | None, Quality]:
        """Return the better of two registrations at different poses; FAILED if both are equally good."""
        search = AlignmentSearch(self._matcher, model, scene, self.config, self._quality)
        first = next(search.acceptable(), None)
        if first is None:
            return None, Quality.failed("not_found", *search.refusals)
        second = next(
            (other for other in search.excluding(first[0]) if _is_elsewhere(first[0], other[0])), None
        )
        if second is None:
            return first
        (better, quality), (worse, _) = sorted(
            (first, second), key=lambda candidate: candidate[0].assessment.rms_m
        )
        if worse.assessment.rms_m <= _AMBIGUITY * better.assessment.rms_m:
            return None, Quality.failed("ambiguous", *quality.reasons, metrics=quality.metrics)
        return better, quality

    def _quality(self, registration: Registration) -> Quality:
        """Return the quality by the gates; the overlap of the model counts, since the scene is larger."""
        return registration_quality(registration, registration.assessment.overlap_source, self.config)


def _finite_points(sample: Sample | None) -> FloatArray:
    """Return the finite points (n, 3) of a cloud, metres; none without a sample."""
    points = np.zeros((0, 3)) if sample is None else np.asarray(sample.value.points_m, np.float64)
    return points[np.isfinite(points).all(axis=1)]


def _is_elsewhere(registration: Registration, other: Registration) -> bool:
    """Return whether two poses differ by more than the radius of the overlap."""
    a = registration.assessment
    return (
        displacement_m(other.T_target_source, registration.T_target_source, a.centre_m, a.radius_m)
        > a.radius_m
    )
