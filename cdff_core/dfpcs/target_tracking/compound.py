# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of TargetTracking: predict, correct or coast, start a new track, publish pose and track."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import ObjectTrack
from cdff_core.dfpcs.target_tracking.configuration import TargetTrackingConfig
from cdff_core.dfpcs.target_tracking.interface import TargetTrackingInterface
from cdff_core.object_models.state_filter import StateFilter, with_rejection
from cdff_core.object_models.state_output import state_outputs
from cdff_core.object_models.tracked_state import TrackedState


class TargetTracking(TargetTrackingInterface):
    """Error-state Kalman filter of one body."""

    Config = TargetTrackingConfig
    config: TargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self._filter = StateFilter(
            self.dfn("predict"),
            self.dfn("correct"),
            self.config,
            np.array(self.config.centre_of_mass_m),
            self.config.centre_of_mass_sigma_m,
        )
        self._track_id = 0
        self._last: ObjectTrack | None = None
        self.restart()
        self.store.offer("last_track", lambda: self._last)

    def restart(self) -> None:
        """Clear the track; the next measurement starts a new one."""
        self._state: TrackedState | None = None
        self._rival: TrackedState | None = None
        self._used, self._rival_count, self._last_used_ns = 0, 0, 0

    def on_measurement(self, sample: Sample) -> Iterable[Output]:
        """Use a measured pose; publish the state at its time."""
        measured_pose: UncertainTransform = sample.value.transform
        reason = self._fault(sample, measured_pose)
        if reason:
            return self._outputs(sample, None, Quality.failed(reason))
        if self._state is None:
            self._start(sample, measured_pose)
            return self._published(sample, ["new_track"])
        predicted_state = self._filter.predicted(self._state, sample.stamp_ns)
        corrected_state, reason = self._correct_state(predicted_state, measured_pose)
        if corrected_state is not None:
            self._state, self._rival, self._rival_count = corrected_state, None, 0
            self._used += 1
            self._last_used_ns = sample.stamp_ns
            return self._published(sample, [])
        self._state = with_rejection(predicted_state)
        if self._agrees_with_rival(sample, measured_pose):
            self._state, self._used = self._rival, self._rival_count
            self._rival, self._rival_count, self._last_used_ns = None, 0, sample.stamp_ns
            self._track_id += 1
            return self._published(sample, ["new_track", reason])
        return self._published(sample, ["coasting", reason])

    def _fault(self, sample: Sample, measured: UncertainTransform) -> str:
        """Return the reason against the use of a measurement; empty if there is none."""
        if measured.covariance is None:
            return "no_covariance"
        if sample.quality.status is Status.FAILED:
            return "failed_measurement"
        if self._state is None:
            return ""
        age_s = 1e-9 * (self._state.stamp_ns - sample.stamp_ns)
        return f"late:{age_s:.3g}s" if age_s > 0.0 else "repeated_stamp" if age_s == 0.0 else ""

    def _start(self, sample: Sample, measured: UncertainTransform) -> None:
        self._state = self._new(sample, measured)
        self._track_id += 1
        self._used, self._last_used_ns = 1, sample.stamp_ns

    def _new(self, sample: Sample, measured: UncertainTransform) -> TrackedState:
        assert measured.covariance is not None  # _fault
        return self._filter.start(sample.stamp_ns, measured.matrix, measured.covariance)

    def _correct_state(
        self, predicted: TrackedState, measured: UncertainTransform
    ) -> tuple[TrackedState | None, str]:
        """Return the corrected state; None and the reason if the measurement is beyond the gate."""
        assert measured.covariance is not None  # _fault
        try:
            return self._filter.corrected(predicted, measured.matrix, measured.covariance), ""
        except RefusedError as error:
            return None, error.reasons[0]

    def _agrees_with_rival(self, sample: Sample, measured_pose: UncertainTransform) -> bool:
        """Return True if enough rejected measurements in succession agree with each other."""
        updated_rival = None
        if self._rival is not None:
            predicted_state = self._filter.predicted(self._rival, sample.stamp_ns)
            updated_rival, _ = self._correct_state(predicted_state, measured_pose)
        self._rival_count = self._rival_count + 1 if updated_rival is not None else 1
        self._rival = updated_rival if updated_rival is not None else self._new(sample, measured_pose)
        return self._rival_count >= self.config.restart_after

    def _published(self, sample: Sample, reasons: list[str]) -> Iterable[Output]:
        gap_s = 1e-9 * (sample.stamp_ns - self._last_used_ns)
        lost = [f"lost:{gap_s:.3g}s"] if gap_s > self.config.lost_after_s else []
        quality = Quality.from_reasons(
            reasons, CovarianceKind.FORMAL, {"used": float(self._used), "gap_s": gap_s}, failed=lost
        )
        return self._outputs(sample, self._state, quality)

    def _outputs(self, sample: Sample, state: TrackedState | None, quality: Quality) -> list[Output]:
        """Return the outputs of a state, and store the newest one."""
        outputs = state_outputs(
            state,
            stamp_ns=sample.stamp_ns,
            frame=sample.value.parent_frame,
            child=sample.value.child_frame,
            track_id=self._track_id,
            is_confirmed=self._used >= self.config.confirm_after,
            quality=quality,
            inputs=(sample.id,),
            producer=self.name,
        )
        self._last = outputs[1].value or self._last
        return outputs
