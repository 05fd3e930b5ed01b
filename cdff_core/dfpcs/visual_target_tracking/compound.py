# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualTargetTracking: predict, measure the edges, accept or coast, publish."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import ObjectTrack, TransformWithCovariance
from cdff_core.dfpcs.visual_target_tracking.configuration import VisualTargetTrackingConfig
from cdff_core.dfpcs.visual_target_tracking.image_fit import ImageFit, ImageFitter
from cdff_core.dfpcs.visual_target_tracking.interface import VisualTargetTrackingInterface
from cdff_core.imaging.frames import check_undistorted
from cdff_core.imaging.grey import grey_image
from cdff_core.object_models.prepared import PreparedModels, body_frame
from cdff_core.object_models.state_filter import StateFilter, adapted, with_rejection
from cdff_core.object_models.state_output import state_outputs
from cdff_core.object_models.tracked_state import TrackedState


class VisualTargetTracking(VisualTargetTrackingInterface):
    """Comparison of the edges of each image with those of the mesh at the predicted state."""

    Config = VisualTargetTrackingConfig
    config: VisualTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg = self.config
        self._models = PreparedModels(self.dfn("prepare"), cfg.unit)
        self._fitter = ImageFitter(
            self.dfn("edges"), self.dfn("refine"), cfg.rounds, cfg.max_range_px, cfg.min_points
        )
        self._dfns = self.dfn("predict"), self.dfn("correct")
        self._gate = chi_squared_quantile(cfg.gate_probability, 6)
        self._name, self._model_id = "", ""
        self._track_id = 0
        self._last: ObjectTrack | None = None
        self.restart()
        self.store.offer("last_track", lambda: self._last)

    def restart(self) -> None:
        """Clear the track; the next guess starts a new one."""
        self._state: TrackedState | None = None
        self._guess: TransformWithCovariance | None = None
        self._used, self._last_used_ns = 0, 0

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare the mesh; a mesh that differs from the previous one ends the track."""
        previous = self._models.by_name.get(self._name)
        name = self._models.add(sample.value)
        model = self._models.by_name[name]
        if name != self._name or model is not previous:
            guess = self._guess
            self.restart()
            self._guess = guess
        self._name, self._model_id = name, sample.id
        cfg = self.config
        centre_m = model.centre_m if cfg.centre_of_mass_m is None else np.array(cfg.centre_of_mass_m)
        sigma_m = cfg.centre_of_mass_sigma * model.diameter_m
        self._filter = StateFilter(*self._dfns, cfg, centre_m, sigma_m)
        return ()

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Store the guess; it starts a track at the next image."""
        self._guess = sample.value
        return ()

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Track the body in an image."""
        if self._name not in self._models.by_name:
            return self._outputs(sample, None, Quality.failed("no_model"))
        if self._state is not None and sample.stamp_ns <= self._state.stamp_ns:
            age_s = 1e-9 * (self._state.stamp_ns - sample.stamp_ns)
            reason = f"late:{age_s:.3g}s" if age_s > 0.0 else "repeated_stamp"
            return self._outputs(sample, None, Quality.failed(reason))
        reasons = self._start_from_guess(sample)
        if self._state is None:
            return self._outputs(sample, None, Quality.failed("no_guess"))
        predicted = self._filter.predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(sample, predicted)
        if fit is not None and not fault:
            self._state, self._last_used_ns = adapted(predicted, fit.state), sample.stamp_ns
            self._used += 1
            good = self.config.good_agreement
            if fit.agreement < good:
                reasons.append(f"low_agreement:{fit.agreement:.2f}<{good:g}")
            return self._published(sample, reasons, fit)
        is_contradiction = fit is not None and fit.distance > self._gate
        self._state = with_rejection(predicted) if is_contradiction else predicted
        return self._published(sample, [*reasons, "coasting", fault], fit)

    def _start_from_guess(self, sample: Sample) -> list[str]:
        """Start a track with the guess, if there is one; return the reasons."""
        guess, self._guess = self._guess, None
        if guess is None:
            return []
        cfg, pose = self.config, guess.transform
        diameter_m = self._models.by_name[self._name].diameter_m
        sigmas = np.repeat([cfg.guess_sigma * diameter_m, cfg.guess_sigma_rad], 3)
        covariance = np.diag(sigmas**2) if pose.covariance is None else pose.covariance
        # The stamp is just before that of the image, which then corrects the guess.
        self._state = self._filter.start(sample.stamp_ns - 1000, pose.matrix, covariance)
        self._track_id += 1
        self._used, self._last_used_ns = 0, sample.stamp_ns
        return ["new_track"]

    def _fit(self, sample: Sample, predicted: TrackedState) -> tuple[ImageFit | None, str]:
        """Return the corrected state, if there is one, and the reason against it."""
        cfg = self.config
        model = self._models.by_name[self._name]
        try:
            check_undistorted(sample.value)
            image = grey_image(sample.value).astype(np.float32)
            fit = self._fitter.fit(model, predicted, image, sample.value.camera_matrix)
        except RefusedError as error:
            return None, error.reasons[0]
        if fit.agreement < cfg.min_agreement:
            return fit, f"low_agreement:{fit.agreement:.2f}<{cfg.min_agreement:g}"
        if fit.distance > self._gate:
            return fit, f"innovation:{fit.distance:.3g}>{self._gate:.3g}"
        return fit, ""

    def _published(self, sample: Sample, reasons: list[str], fit: ImageFit | None) -> Iterable[Output]:
        gap_s = 1e-9 * (sample.stamp_ns - self._last_used_ns)
        lost = [f"lost:{gap_s:.3g}s"] if gap_s > self.config.lost_after_s else []
        metrics = {"used": float(self._used), "gap_s": gap_s}
        if fit is not None:
            metrics |= {
                "points": float(fit.points),
                "agreement": fit.agreement,
                "innovation": fit.distance,
                "sigma_px": fit.sigma_px,
                "range_px": fit.range_px,
            }
        quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics, failed=lost)
        return self._outputs(sample, None if lost else self._state, quality)

    def _outputs(self, sample: Sample, state: TrackedState | None, quality: Quality) -> list[Output]:
        outputs = state_outputs(
            state,
            stamp_ns=sample.stamp_ns,
            frame=sample.value.frame,
            child=body_frame(self._name or "model"),
            track_id=self._track_id,
            is_confirmed=self._used >= self.config.confirm_after,
            quality=quality,
            inputs=tuple(i for i in (self._model_id, sample.id) if i),
            producer=self.name,
        )
        self._last = outputs[1].value or self._last
        return outputs
