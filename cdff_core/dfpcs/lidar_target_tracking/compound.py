# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarTargetTracking: detect, predict, register, accept or coast, publish."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
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
from cdff_core.object_models.scan_fit import ScanFit, ScanFitter, capture_limit
from cdff_core.object_models.scan_parts import bodies, range_noise
from cdff_core.object_models.sensor_rotation import SensorRotation
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
#: Number of scans that are kept for detections that arrive later.
_MAX_SCANS = 32


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    """Points (n, 3) of a scan, metres, and their times (n,) relative to its stamp, seconds."""

    stamp_ns: int
    points_m: FloatArray
    times_s: FloatArray


class LidarTargetTracking(BodyTracking, LidarTargetTrackingInterface):
    """Registration of each scan with the mesh of the body and its predicted state."""

    Config = LidarTargetTrackingConfig
    config: LidarTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg, seed = self.config, self.context.seed
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, _AMBIGUITY)
        self._refine = self.dfn("refine", seed=seed)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self._refine, limits)
        self._fitter = ScanFitter(self.dfn("deskew"), self.dfn("registration"))
        self._rotation = SensorRotation(self.context.frames, cfg.attitude_age_s, cfg.sensor_rate_sigma_radps)
        compile_kernels()
        self.setup_track()

    def restart(self) -> None:
        """Clear the track; the body is detected in the next scan."""
        super().restart()
        self._sigma_m = self.config.sigma_m
        self._received: tuple[int, list[Hypothesis]] | None = None
        self._scans: deque[_Scan] = deque(maxlen=_MAX_SCANS)
        self._used_state: TrackedState | None = None

    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store the attitude; velocities are then relative to the inertial axes."""
        self._rotation.give(sample)
        return ()

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
        self._scan_frame = self._sensor_frame(sample)
        points_m = self._rotation.at_stamp(points_m, times_s, sample.stamp_ns, self._scan_frame)
        scan = _Scan(sample.stamp_ns, points_m, times_s)
        if not self.config.search_scans:
            self._keep(scan)
        reasons = self._start_from_guess(model, sample.stamp_ns)
        if self._state is None:
            return self._detect_body(sample, model, scan, [])
        predicted_state = self._predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted_state, scan)
        if fit is not None and fault and self._is_underestimated(fit):
            predicted_state = replace(
                predicted_state, covariance=4.0 * fit.distance / self._gate * predicted_state.covariance
            )
            reasons.append(fault)
            fit, fault = self._fit(model, predicted_state, scan)
        if fit is not None and not fault:
            return self._used_fit(sample, model, predicted_state, fit, reasons, scan)
        self._not_used(predicted_state, is_contradiction=fit is not None and fit.distance > self._gate)
        is_uncertain = bool(_uncertain_position(model, predicted_state)) or (
            float(np.diag(predicted_state.covariance)[3:6].max()) > _UNCERTAIN_RAD**2
        )
        if self._unused >= self.config.detect_after or (is_uncertain and len(points_m)):
            return self._detect_body(sample, model, scan, [fault])
        return self._published(sample, ["coasting", fault], self._metrics(fit))

    def _predicted(self, state: TrackedState, stamp_ns: int) -> TrackedState:
        """Return the state at a later time, in the axes of the sensor at that time."""
        predicted_state = self._filter.predicted(state, stamp_ns)
        return self._rotation.applied(predicted_state, state.stamp_ns, self._scan_frame)

    def _used_fit(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        predicted_state: TrackedState,
        fit: ScanFit,
        reasons: list[str],
        scan: _Scan | None,
    ) -> Iterable[Output]:
        """Use a corrected state and publish it; compare it with its alternatives in a scan, if given."""
        self._use(model, predicted_state, fit)
        if scan is not None and len(self._alternatives):
            self._compare_alternatives(model, fit.state, scan)
            reasons = [*reasons, *self._ambiguity_reasons()]
        return self._published(
            sample, reasons + [f"degenerate:{name}" for name in _weak_names(fit)], self._metrics(fit)
        )

    def _use(self, model: ModelPreparationOutputs, predicted_state: TrackedState, fit: ScanFit) -> None:
        """Continue the track with the state corrected by a scan."""
        self._state = self._used_state = adapt_noise(predicted_state, fit.state)
        self._unused, self._last_used_ns = 0, fit.state.stamp_ns
        self._used += 1
        while self._scans and self._scans[0].stamp_ns <= fit.state.stamp_ns:
            self._scans.popleft()
        if not self.config.sigma_m:
            noise_m = bounded_noise(fit.sigma_m, model.diameter_m)
            self._sigma_m += _NOISE_GAIN * (noise_m - self._sigma_m)

    def _compare_alternatives(self, model: ModelPreparationOutputs, state: TrackedState, scan: _Scan) -> None:
        """Exclude alternatives to the track that the scan contradicts, or continue the track with one of
        them if it explains the scans since the detection better.
        """
        centre_m = se3.transform_points(state.T, model.centre_m[None])[0]
        near = np.linalg.norm(scan.points_m - centre_m, axis=1) < model.diameter_m
        if near.sum() < self.config.min_points:
            return
        self._alternatives = self._alternatives.compared(
            self._refine, model, state.T, scan.points_m[near], self._sigma_m, _AMBIGUITY
        )
        row = self._alternatives.best(_AMBIGUITY)
        if row is None:
            return
        alternatives = self._alternatives
        T_body_alternative = alternatives.T_body_alternative[row]
        self._start(model, state.stamp_ns, UncertainTransform(state.T @ T_body_alternative))
        assert self._state is not None
        rate = T_body_alternative[:3, :3].T @ state.rate
        self._state = self._used_state = replace(self._state, velocity=state.velocity, rate=rate)
        self._used = 1
        self._alternatives = alternatives.replaced(row)

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
        scan: _Scan,
    ) -> tuple[ScanFit | None, str]:
        """Return the fit, None without one, and the reason why its state is not used; the reason is empty if
        it is used.
        """
        cfg, points_m = self.config, scan.points_m
        if len(points_m) < cfg.min_points:
            return None, f"few_points:{len(points_m)}<{cfg.min_points}"
        if not self._sigma_m:
            self._sigma_m = bounded_noise(range_noise(points_m), model.diameter_m)
        try:
            fit = self._fitter.fit(model, predicted_state, points_m, scan.times_s, self._sigma_m)
        except RefusedError as error:
            return None, error.reasons[0]
        if fit.points < cfg.min_points:
            return fit, f"few_points:{fit.points}<{cfg.min_points}"
        uncertain = _uncertain_position(model, predicted_state)
        if uncertain and fit.agreement < cfg.min_score:
            return None, uncertain
        if fit.agreement < cfg.min_agreement:
            return fit, f"low_agreement:{fit.agreement:.2f}<{cfg.min_agreement:g}"
        if fit.distance > self._gate:
            return fit, f"innovation:{fit.distance:.3g}>{self._gate:.3g}"
        return fit, ""

    def _detect_body(
        self, sample: Sample, model: ModelPreparationOutputs, scan: _Scan, reasons: list[str]
    ) -> Iterable[Output]:
        """Detect the body: correct the track, or start one."""
        try:
            if self.config.search_scans:
                hypotheses = self._detect(model, scan.points_m)
                # The pose is that of the middle of the scan. The scan then corrects it: it counts once.
                stamp_ns = scan.stamp_ns + round(1e9 * float(np.median(scan.times_s)))
                names = [*self._use_detection(model, hypotheses, stamp_ns), *reasons]
                self._last_used_ns = sample.stamp_ns
            else:
                names = [*self._use_received(model, scan), *reasons]
        except RefusedError as error:
            if self._state is None:
                return self._outputs(sample, None, Quality.failed("not_found", *error.reasons))
            return self._published(sample, ["coasting", *reasons, *error.reasons], self._metrics(None))
        assert self._state is not None
        predicted_state = self._predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted_state, scan)
        if fit is None or fault:
            self._state = predicted_state
            return self._published(sample, [*names, fault], self._metrics(fit))
        return self._used_fit(sample, model, predicted_state, fit, names, None)

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

    def _keep(self, scan: _Scan) -> None:
        """Keep a scan for detections that arrive later, for ``lost_after_s``."""
        self._scans.append(scan)
        while scan.stamp_ns - self._scans[0].stamp_ns > 1e9 * self.config.lost_after_s:
            self._scans.popleft()

    def _use_received(self, model: ModelPreparationOutputs, scan: _Scan) -> list[str]:
        """Correct the track with the newest detections, or start one, and repeat the scans from their time to
        this one; return the reasons. RefusedError without recent detections.
        """
        stamp_ns, hypotheses = self._take_received(scan.stamp_ns)
        self._state = self._used_state and self._predicted(self._used_state, stamp_ns)
        reasons = self._use_detection(model, hypotheses, stamp_ns)
        self._last_used_ns = stamp_ns
        for earlier in [s for s in self._scans if stamp_ns <= s.stamp_ns < scan.stamp_ns]:
            assert self._state is not None
            predicted_state = self._predicted(self._state, earlier.stamp_ns)
            fit, fault = self._fit(model, predicted_state, earlier)
            if fit is not None and not fault:
                self._use(model, predicted_state, fit)
        return reasons

    def _take_received(self, stamp_ns: int) -> tuple[int, list[Hypothesis]]:
        """Return time and hypotheses of the newest detections; RefusedError without recent ones."""
        received, self._received = self._received, None
        if received is None:
            raise RefusedError("no detections", ["no_detections"])
        age_s = 1e-9 * (stamp_ns - received[0])
        if not 0.0 <= age_s <= self.config.lost_after_s:
            limit_s = self.config.lost_after_s
            raise RefusedError("old detections", [f"detections_old:{age_s:.3g}s>{limit_s:g}s"])
        if self._used_state is not None and received[0] < self._used_state.stamp_ns:
            raise RefusedError("detections before the last used scan", ["no_new_detections"])
        return received

    def _published(
        self, sample: Sample, reasons: list[str], metrics: Mapping[str, float]
    ) -> Iterable[Output]:
        """Return the outputs of the state; DEGRADED if the attitude of the sensor is missing at its time."""
        missing = self._rotation.reason(sample.stamp_ns, self._scan_frame)
        return super()._published(sample, [*reasons, missing] if missing else reasons, metrics)

    def _metrics(self, fit: ScanFit | None) -> dict[str, float]:
        """Return the metrics of the quality."""
        metrics = {"sigma_m": self._sigma_m, "inertial_rates": float(self._rotation.is_inertial)}
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


def _uncertain_position(model: ModelPreparationOutputs, state: TrackedState) -> str:
    """Return the reason if a registration would not converge from most positions that are possible."""
    sigma_m, limit_m = math.sqrt(float(np.diag(state.covariance)[:3].max())), capture_limit(model)
    return f"uncertain_position:{sigma_m:.3g}m>{limit_m:.3g}m" if sigma_m > limit_m else ""
