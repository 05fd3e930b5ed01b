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
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.direction_names import direction_names
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import ObjectTrack, TransformWithCovariance
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfpcs.lidar_target_tracking.configuration import LidarTargetTrackingConfig
from cdff_core.dfpcs.lidar_target_tracking.interface import LidarTargetTrackingInterface
from cdff_core.dfpcs.lidar_target_tracking.scan_fit import ScanFit, ScanFitter
from cdff_core.object_models.compilation import compile_kernels
from cdff_core.object_models.prepared import PreparedModels, body_frame
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    bounded_noise,
    no_body_reasons,
    valid_points,
)
from cdff_core.object_models.scan_parts import bodies, range_noise
from cdff_core.object_models.state_filter import StateFilter, adapted, with_rejection
from cdff_core.object_models.state_output import state_outputs
from cdff_core.object_models.tracked_state import TrackedState

#: Difference of -2 log likelihood up to which a detection has alternatives, and the bodies that are examined.
_AMBIGUITY, _MAX_BODIES = 12.0, 4
#: Standard deviation of the predicted attitude, rad, from which a scan that does not fit is searched at once.
_UNCERTAIN_RAD = math.radians(10.0)
#: Gates up to which a scan that agrees with the model shows that the prediction was too certain.
_NEAR_GATES = 10.0
#: Weight of a new estimate of the noise.
_NOISE_GAIN = 0.2


class LidarTargetTracking(LidarTargetTrackingInterface):
    """Registration of each scan with the mesh of the body and its predicted state."""

    Config = LidarTargetTrackingConfig
    config: LidarTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg, seed = self.config, self.context.seed
        self._models = PreparedModels(self.dfn("prepare"), cfg.unit)
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, _AMBIGUITY)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self.dfn("refine", seed=seed), limits)
        self._fitter = ScanFitter(self.dfn("deskew"), self.dfn("registration"))
        self._dfns = self.dfn("predict"), self.dfn("correct")
        compile_kernels()
        self._gate = chi_squared_quantile(cfg.gate_probability, 6)
        self._name, self._model_id = "", ""
        self._track_id = 0
        self._last: ObjectTrack | None = None
        self.restart()
        self.store.offer("last_track", lambda: self._last)

    def restart(self) -> None:
        """Clear the track; the body is detected in the next scan."""
        self._state: TrackedState | None = None
        self._guess: TransformWithCovariance | None = None
        self._sigma_m = self.config.sigma_m
        self._used, self._unused, self._last_used_ns = 0, 0, 0

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare the mesh; another one than before ends the track."""
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
        """Store the guess; it starts a track at the next scan."""
        self._guess = sample.value
        return ()

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Track the body in a scan whose points have one time."""
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
        model = self._models.by_name.get(self._name)
        if model is None:
            return self._outputs(sample, None, Quality.failed("no_model"))
        if self._state is not None and sample.stamp_ns <= self._state.stamp_ns:
            return self._outputs(sample, None, Quality.failed(self._order_fault(self._state, sample)))
        reasons = self._start_from_guess(sample)
        if self._state is None:
            return self._detected(sample, model, points_m, times_s, [])
        predicted = self._filter.predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted, points_m, times_s)
        if fit is not None and fault and self._is_underestimated(fit):
            predicted = replace(predicted, covariance=4.0 * fit.distance / self._gate * predicted.covariance)
            reasons.append(fault)
            fit, fault = self._fit(model, predicted, points_m, times_s)
        if fit is not None and not fault:
            return self._used_fit(sample, model, predicted, fit, reasons)
        is_contradiction = fit is not None and fit.distance > self._gate
        self._state = with_rejection(predicted) if is_contradiction else predicted
        self._unused += 1
        is_uncertain = float(np.diag(predicted.covariance)[3:6].max()) > _UNCERTAIN_RAD**2
        if self._unused >= self.config.detect_after or (is_uncertain and len(points_m)):
            return self._detected(sample, model, points_m, times_s, [fault])
        return self._published(sample, ["coasting", fault], fit)

    def _used_fit(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        fit: ScanFit,
        reasons: list[str],
    ) -> Iterable[Output]:
        """Use a corrected state and publish it."""
        self._state, self._unused, self._last_used_ns = adapted(predicted, fit.state), 0, sample.stamp_ns
        self._used += 1
        if not self.config.sigma_m:
            noise_m = bounded_noise(fit.sigma_m, model.diameter_m)
            self._sigma_m += _NOISE_GAIN * (noise_m - self._sigma_m)
        return self._published(sample, reasons + [f"degenerate:{name}" for name in _weak_names(fit)], fit)

    def _is_underestimated(self, fit: ScanFit) -> bool:
        """Return True if the scan agrees with the model, and nearly with a too certain prediction."""
        is_near = self._gate < fit.distance < _NEAR_GATES * self._gate
        return fit.agreement >= self.config.min_score and is_near

    def _order_fault(self, state: TrackedState, sample: Sample) -> str:
        age_s = 1e-9 * (state.stamp_ns - sample.stamp_ns)
        return f"late:{age_s:.3g}s" if age_s > 0.0 else "repeated_stamp"

    def _start_from_guess(self, sample: Sample) -> list[str]:
        """Start a track with the guess, if there is one; return the reasons."""
        guess, self._guess = self._guess, None
        if guess is None:
            return []
        # The stamp is just before that of the scan, which then corrects the guess.
        self._start(sample.stamp_ns - 1000, guess.transform)
        self._last_used_ns = sample.stamp_ns
        return ["new_track"]

    def _start(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Start a track with a pose; without covariance, with that of a guess."""
        cfg = self.config
        sigmas = np.repeat([cfg.guess_sigma_m, cfg.guess_sigma_rad], 3)
        covariance = np.diag(sigmas**2) if pose.covariance is None else pose.covariance
        self._state = self._filter.start(stamp_ns, pose.matrix, covariance)
        self._track_id += 1
        self._used, self._unused = 0, 0

    def _fit(
        self,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        points_m: FloatArray,
        times_s: FloatArray,
    ) -> tuple[ScanFit | None, str]:
        """Return the corrected state, if there is one, and the reason against it."""
        cfg = self.config
        if len(points_m) < cfg.min_points:
            return None, f"few_points:{len(points_m)}<{cfg.min_points}"
        if not self._sigma_m:
            self._sigma_m = bounded_noise(range_noise(points_m), model.diameter_m)
        try:
            fit = self._fitter.fit(model, predicted, points_m, times_s, self._sigma_m)
        except RefusedError as error:
            return None, error.reasons[0]
        if fit.points < cfg.min_points:
            return fit, f"few_points:{fit.points}<{cfg.min_points}"
        if fit.agreement < cfg.min_agreement:
            return fit, f"low_agreement:{fit.agreement:.2f}<{cfg.min_agreement:g}"
        if fit.distance > self._gate:
            return fit, f"innovation:{fit.distance:.3g}>{self._gate:.3g}"
        return fit, ""

    def _detected(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        points_m: FloatArray,
        times_s: FloatArray,
        reasons: list[str],
    ) -> Iterable[Output]:
        """Detect the body in a scan: correct the track, or start one."""
        try:
            found = self._detect(model, points_m)
        except RefusedError as error:
            if self._state is None:
                return self._outputs(sample, None, Quality.failed("not_found", *error.reasons))
            return self._published(sample, ["coasting", *reasons, *error.reasons])
        # The pose is that of the middle of the scan. The scan then corrects it: it counts once.
        stamp_ns = sample.stamp_ns + round(1e9 * float(np.median(times_s)))
        names = ["new_track", *reasons]
        names += [f"ambiguous:{len(found) - 1}"] if len(found) > 1 else []
        names += [f"symmetric_model:{len(model.symmetries)}"] if len(model.symmetries) > 1 else []
        agreeing = self._agreeing([T for hypothesis in found for T in hypothesis.T @ model.symmetries])
        if agreeing is not None:
            self._state, names = agreeing, ["detected", *reasons]
        else:
            self._start(stamp_ns, UncertainTransform(found[0].T))
        assert self._state is not None
        predicted = self._filter.predicted(self._state, sample.stamp_ns)
        fit, fault = self._fit(model, predicted, points_m, times_s)
        if fit is None or fault:
            self._state, self._last_used_ns = predicted, sample.stamp_ns
            return self._published(sample, [*names, fault], fit)
        return self._used_fit(sample, model, predicted, fit, names)

    def _agreeing(self, poses: list[FloatArray]) -> TrackedState | None:
        """Return the state corrected by the first detected pose (4, 4) that agrees with it, if any."""
        if self._state is None:
            return None
        sigmas = np.repeat([self.config.guess_sigma_m, self.config.guess_sigma_rad], 3)
        for T in poses:
            try:
                return self._filter.corrected(self._state, T, np.diag(sigmas**2))
            except RefusedError:
                continue
        return None

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

    def _published(self, sample: Sample, reasons: list[str], fit: ScanFit | None = None) -> Iterable[Output]:
        gap_s = 1e-9 * (sample.stamp_ns - self._last_used_ns)
        lost = [f"lost:{gap_s:.3g}s"] if gap_s > self.config.lost_after_s else []
        metrics = {"used": float(self._used), "gap_s": gap_s, "sigma_m": self._sigma_m}
        if fit is not None:
            metrics |= {
                "points": float(fit.points),
                "agreement": fit.agreement,
                "innovation": fit.distance,
                "unconstrained": float(len(fit.weak_directions)),
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


def _weak_names(fit: ScanFit) -> list[str]:
    return direction_names(fit.weak_directions) if len(fit.weak_directions) else []
