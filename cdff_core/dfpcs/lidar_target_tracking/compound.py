# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarTargetTracking: detect, predict, register, accept or coast, publish."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry.direction_names import direction_names
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfpcs.lidar_target_tracking.configuration import LidarTargetTrackingConfig
from cdff_core.dfpcs.lidar_target_tracking.interface import LidarTargetTrackingInterface
from cdff_core.object_models.body_tracking import BodyTracking, order_fault
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    bounded_noise,
    no_body_reasons,
    valid_points,
)
from cdff_core.object_models.scan_fit import ScanFit, ScanFitter
from cdff_core.object_models.scan_parts import bodies, range_noise
from cdff_core.object_models.state_filter import adapt_noise
from cdff_core.object_models.tracked_state import TrackedState

#: Difference of -2 log likelihood up to which a detection has alternatives, and number of bodies that are
#: examined.
_AMBIGUITY, _MAX_BODIES = 12.0, 4
#: Standard deviation of the predicted attitude, rad, above which the body is searched at once if a scan does
#: not fit.
_UNCERTAIN_RAD = math.radians(10.0)
#: A scan that agrees with the model beyond the gate, but within this number of gates, shows that the stated
#: covariance of the prediction is too small.
_NEAR_GATES = 10.0
#: Weight of a new estimate of the noise.
_NOISE_GAIN = 0.2


class LidarTargetTracking(BodyTracking, LidarTargetTrackingInterface):
    """Registration of each scan with the mesh of the body and its predicted state."""

    Config = LidarTargetTrackingConfig
    config: LidarTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg, seed = self.config, self.context.seed
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, _AMBIGUITY)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self.dfn("refine", seed=seed), limits)
        self._fitter = ScanFitter(self.dfn("deskew"), self.dfn("registration"))
        compile_kernels()
        self.setup_track()

    def restart(self) -> None:
        """Clear the track; the body is detected in the next scan."""
        super().restart()
        self._sigma_m = self.config.sigma_m
        self._received: tuple[int, list[Hypothesis]] | None = None

    def on_detections(self, sample: Sample) -> Iterable[Output]:
        """Store the detections of the body; the next scan without a track uses them."""
        hypotheses = [
            Hypothesis(d.label, d.pose.transform.matrix, None, d.score, is_alternative=False)
            for d in sample.value.detections
            if d.label == self._name
        ]
        if hypotheses:
            self._received = sample.stamp_ns, hypotheses
        return ()

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Track the body in a scan whose points were all measured at the same time."""
        points_m, _ = valid_points(sample.value.points_m)
        return self._track(sample, points_m, np.zeros(len(points_m)))

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Track the body in a scan whose points have times."""
        points_m, is_valid = valid_points(sample.value.points_m)
        start_ns = sample.value.metadata.start_time.ns
        offsets_s = 1e-6 * np.asarray(sample.value.time_offset_us, np.float64)
        return self._track(sample, points_m, (1e-9 * (start_ns - sample.stamp_ns) + offsets_s)[is_valid])

    def _track(self, sample: Sample, points_m: FloatArray, times_s: FloatArray) -> Iterable[Output]:
        """Return the outputs of a scan: points (n, 3) at times (n,) relative to the stamp."""
        model = self._model
        if model is None:
            return self._outputs(sample, None, Quality.failed("no_model"))
        if self._state is not None and sample.stamp_ns <= self._state.stamp_ns:
            return self._outputs(sample, None, Quality.failed(order_fault(self._state, sample.stamp_ns)))
        reasons = self._start_from_guess(model, sample.stamp_ns)
        if self._state is None:
            return self._detect_body(sample, model, points_m, times_s, [])
        predicted_state = self._filter.predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted_state, points_m, times_s)
        if fit is not None and fault and self._is_underestimated(fit):
            predicted_state = replace(
                predicted_state, covariance=4.0 * fit.distance / self._gate * predicted_state.covariance
            )
            reasons.append(fault)
            fit, fault = self._fit(model, predicted_state, points_m, times_s)
        if fit is not None and not fault:
            return self._used_fit(sample, model, predicted_state, fit, reasons)
        self._not_used(predicted_state, is_contradiction=fit is not None and fit.distance > self._gate)
        is_uncertain = float(np.diag(predicted_state.covariance)[3:6].max()) > _UNCERTAIN_RAD**2
        if self._unused >= self.config.detect_after or (is_uncertain and len(points_m)):
            return self._detect_body(sample, model, points_m, times_s, [fault])
        return self._published(sample, ["coasting", fault], self._metrics(fit))

    def _used_fit(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        predicted_state: TrackedState,
        fit: ScanFit,
        reasons: list[str],
    ) -> Iterable[Output]:
        """Use a corrected state and publish it."""
        self._state, self._unused, self._last_used_ns = (
            adapt_noise(predicted_state, fit.state),
            0,
            sample.stamp_ns,
        )
        self._used += 1
        if not self.config.sigma_m:
            noise_m = bounded_noise(fit.sigma_m, model.diameter_m)
            self._sigma_m += _NOISE_GAIN * (noise_m - self._sigma_m)
        return self._published(
            sample, reasons + [f"degenerate:{name}" for name in _weak_names(fit)], self._metrics(fit)
        )

    def _is_underestimated(self, fit: ScanFit) -> bool:
        """Return whether the covariance of the prediction is too small: the scan agrees with the model, and
        is only a few gates away from the prediction.
        """
        is_near = self._gate < fit.distance < _NEAR_GATES * self._gate
        return fit.agreement >= self.config.min_score and is_near

    def _guess_sigmas(self, model: ModelPreparationOutputs) -> FloatArray:
        """Return the standard deviations (6,) of a guess or a detection, metres and rad."""
        return np.repeat([self.config.guess_sigma_m, self.config.guess_sigma_rad], 3)

    def _fit(
        self,
        model: ModelPreparationOutputs,
        predicted_state: TrackedState,
        points_m: FloatArray,
        times_s: FloatArray,
    ) -> tuple[ScanFit | None, str]:
        """Return the fit, None without one, and the reason why its state is not used; the reason is empty if
        it is used.
        """
        cfg = self.config
        if len(points_m) < cfg.min_points:
            return None, f"few_points:{len(points_m)}<{cfg.min_points}"
        if not self._sigma_m:
            self._sigma_m = bounded_noise(range_noise(points_m), model.diameter_m)
        try:
            fit = self._fitter.fit(model, predicted_state, points_m, times_s, self._sigma_m)
        except RefusedError as error:
            return None, error.reasons[0]
        if fit.points < cfg.min_points:
            return fit, f"few_points:{fit.points}<{cfg.min_points}"
        if fit.agreement < cfg.min_agreement:
            return fit, f"low_agreement:{fit.agreement:.2f}<{cfg.min_agreement:g}"
        if fit.distance > self._gate:
            return fit, f"innovation:{fit.distance:.3g}>{self._gate:.3g}"
        return fit, ""

    def _detect_body(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        points_m: FloatArray,
        times_s: FloatArray,
        reasons: list[str],
    ) -> Iterable[Output]:
        """Detect the body in a scan: correct the track, or start one."""
        try:
            if self.config.search_scans:
                hypotheses = self._detect(model, points_m)
                # The pose is that of the middle of the scan. The scan then corrects it: it counts once.
                stamp_ns = sample.stamp_ns + round(1e9 * float(np.median(times_s)))
            else:
                stamp_ns, hypotheses = self._take_received(sample.stamp_ns)
        except RefusedError as error:
            if self._state is None:
                return self._outputs(sample, None, Quality.failed("not_found", *error.reasons))
            return self._published(sample, ["coasting", *reasons, *error.reasons], self._metrics(None))
        names = [*self._use_detection(model, hypotheses, stamp_ns), *reasons]
        assert self._state is not None
        predicted_state = self._filter.predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted_state, points_m, times_s)
        if fit is None or fault:
            self._state, self._last_used_ns = predicted_state, sample.stamp_ns
            return self._published(sample, [*names, fault], self._metrics(fit))
        return self._used_fit(sample, model, predicted_state, fit, names)

    def _detect(self, model: ModelPreparationOutputs, points_m: FloatArray) -> list[Hypothesis]:
        """Return the hypotheses of the body of the scan that agrees best; RefusedError if none does."""
        refusals: list[str] = []
        accepted: list[list[Hypothesis]] = []
        cfg = self.config
        if len(points_m) < cfg.min_points:
            raise RefusedError("few points", [f"few_points:{len(points_m)}<{cfg.min_points}"])
        for rows in bodies(points_m, model.diameter_m)[:_MAX_BODIES]:
            try:
                accepted.append(self._detector.detect(self._name, model, points_m[rows], {}))
            except RefusedError as error:
                refusals += error.reasons
        if not accepted:
            raise RefusedError(
                "no body of the scan is the model", refusals or no_body_reasons(points_m, model.diameter_m)
            )
        return max(accepted, key=lambda hypotheses: hypotheses[0].score)

    def _take_received(self, stamp_ns: int) -> tuple[int, list[Hypothesis]]:
        """Return time and hypotheses of the newest detections; RefusedError without recent ones."""
        received, self._received = self._received, None
        if received is None:
            raise RefusedError("no detections", ["no_detections"])
        age_s = 1e-9 * (stamp_ns - received[0])
        if not 0.0 <= age_s <= self.config.lost_after_s:
            limit_s = self.config.lost_after_s
            raise RefusedError("old detections", [f"detections_old:{age_s:.3g}s>{limit_s:g}s"])
        if self._state is not None:
            if received[0] < self._state.stamp_ns:
                raise RefusedError("detections before the state", ["no_new_detections"])
            self._state = self._filter.predicted(self._state, received[0])
        return received

    def _metrics(self, fit: ScanFit | None) -> dict[str, float]:
        """Return the metrics of the quality."""
        metrics = {"sigma_m": self._sigma_m}
        if fit is not None:
            metrics |= {
                "points": float(fit.points),
                "agreement": fit.agreement,
                "innovation": fit.distance,
                "unconstrained": float(len(fit.weak_directions)),
            }
        return metrics


def _weak_names(fit: ScanFit) -> list[str]:
    return direction_names(fit.weak_directions) if len(fit.weak_directions) else []
