# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of AbsoluteLocalisation: map, predict, match, fuse with earlier segments, publish."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from cdff_common.errors import InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_core.dfns.raster_matching.interface import RasterMatchingInputs
from cdff_core.dfpcs.absolute_localisation.configuration import AbsoluteLocalisationConfig
from cdff_core.dfpcs.absolute_localisation.frame_jumps import FrameJumpDetector
from cdff_core.dfpcs.absolute_localisation.hypotheses import Hypothesis, fuse
from cdff_core.dfpcs.absolute_localisation.interface import AbsoluteLocalisationInterface
from cdff_core.dfpcs.absolute_localisation.quality import assess
from cdff_core.dfpcs.absolute_localisation.segment import Segment, centre, shift_cells

#: Rows of x, y, z and yaw in the covariance of a pose.
_XYZ_YAW = np.array([0, 1, 2, 5])
#: Range of the search in standard deviations of the prior.
_SEARCH_SIGMAS = 3.0
#: Standard deviation of roll and pitch of poses without covariance.
_TILT_DEG = 1.0
#: A pose older than the newest one by more than this belongs to another run.
_CLOCK_BACK_NS = 10_000_000_000
#: Defaults of the standard deviation of the first position and of the largest searched translation, in cells
#: of the orbital model, and their lower bound in metres.
_PRIOR_CELLS, _PRIOR_M = 10.0, 10.0
_MAX_SEARCH_CELLS, _MAX_SEARCH_M = 60.0, 60.0
#: Candidates closer than this, in cells of the orbital model, count as one position.
_SEPARATION_CELLS = 3.0


class AbsoluteLocalisation(AbsoluteLocalisationInterface):
    """Match the map of each segment of the path with the orbital model."""

    Config = AbsoluteLocalisationConfig
    config: AbsoluteLocalisationConfig

    def setup(self) -> None:
        """Create the DFNs; offer the store items."""
        self._match = self.dfn("match")
        self._orbital: Sample | None = None
        self.forget()
        self.store.offer("orbital", lambda: self._orbital.value if self._orbital else None)
        self.store.offer("rover_map", lambda: self._segment.map)
        self.store.offer("correction", lambda: self._correction)

    def forget(self) -> None:
        """Clear map and hypotheses, keep the orbital model."""
        self._hypotheses: tuple[Hypothesis, ...] = ()
        self._pose: Sample | None = None
        self._published: Hypothesis | None = None
        self._correction: TransformWithCovariance | None = None
        self._jumps = FrameJumpDetector(self.config.jump_m, np.radians(self.config.jump_deg))
        self._jump_ns = 0
        self._path_length_m = self._matched_m = 0.0
        self._start_segment()

    def on_orbital(self, sample: Sample) -> Iterable[Output]:
        """Store the orbital model, clear matches with a different model, and match a segment that waited for
        a model.
        """
        self._orbital = sample
        self._hypotheses, self._published = (), None
        return self._match_segment()

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Buffer the odometry for the detection of jumps."""
        if sample.value is not None:
            self._jumps.add_odometry(sample.stamp_ns, sample.value.transform.matrix)
        return ()

    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Store the pose and add to the path length; after a jump of its frame start a new segment."""
        if sample.value is None:
            return ()
        if self._pose is not None and sample.stamp_ns < self._pose.stamp_ns - _CLOCK_BACK_NS:
            self.forget()
        step = self._jumps.step(sample.stamp_ns, sample.value.transform.matrix)
        self._path_length_m += step.distance_m
        self._pose = sample
        if step.jumped:
            self._change_frame(step.T_new_old, sample.stamp_ns)
        return ()

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Fuse the patch unless it began before a jump; match the segment if it is long enough."""
        if sample.value is None or sample.value.t0_ns < self._jump_ns:
            return ()
        try:
            self._check_frame(sample.value.frame)
            self._segment.add(sample, None if self._pose is None else self._path_length_m)
        except InputError as error:
            return [self._output(None, Quality.failed(f"bad_patch:{error}"), sample)]
        return self._match_segment()

    def finish(self) -> Iterable[Output]:
        """Match a map that was given without poses and is shorter than a segment."""
        segment, orbital = self._segment, self._orbital
        if self._pose is not None or orbital is None or segment.map is None or segment.patch is None:
            return ()
        output = self._locate(segment.patch, orbital.value, segment.map)
        self._start_segment()
        return [output]

    def get_correction(self) -> TransformWithCovariance:
        """Return ``T_orbital_map``; raises ProductNotFoundError before the first match and after a jump."""
        if self._correction is None:
            raise ProductNotFoundError(
                f"{self.name}: no segment was matched yet, or none since the frame of poses jumped; drive "
                f"{self.config.segment_m:g} m"
            )
        return self._correction

    def get_map(self) -> ElevationMap:
        """Return the map of the current segment; raises ProductNotFoundError without a patch."""
        if self._segment.map is None:
            raise ProductNotFoundError(f"{self.name}: no patch was received since the last match")
        return self._segment.map

    def _change_frame(self, T_new_old: FloatArray | None, stamp_ns: int) -> None:
        """Transform all hypotheses into the new frame and start a new segment.

        After a jump of unknown size they are cleared: the next prior is the pose's own covariance.
        """
        published, self._published, self._correction = self._published, None, None
        if T_new_old is None:
            self._hypotheses = ()
        else:
            self._hypotheses = tuple(h.in_frame(T_new_old) for h in self._hypotheses)
            if published is not None:
                self._published = published.in_frame(T_new_old)
                self._set_correction(self._published, stamp_ns)
        self._jump_ns = stamp_ns
        self._start_segment()

    def _start_segment(self) -> None:
        self._segment = Segment(self.dfn("fusion", size_m=self.config.map_m), self._path_length_m)

    def _match_segment(self) -> Iterable[Output]:
        """Match a segment that is long enough, then start the next."""
        segment, orbital = self._segment, self._orbital
        is_short = segment.length_m < self.config.segment_m
        if orbital is None or segment.map is None or segment.patch is None or is_short:
            return ()
        output = self._locate(segment.patch, orbital.value, segment.map)
        self._start_segment()
        return [output]

    def _locate(self, sample: Sample, orbital: ElevationMap, segment: ElevationMap) -> Output:
        """Predict the hypotheses, match the segment, fuse, assess; return the pose of the best hypothesis."""
        cell_m = max(float(m.geometry.resolution_m) for m in (orbital, segment))
        prior = self._predict(centre(segment), cell_m)
        try:
            candidates = self._match.process(
                RasterMatchingInputs(
                    reference=orbital,
                    template=segment,
                    guess=prior[0].transform,
                    reach=self._search_range(prior, cell_m),
                )
            )
        except (InputError, RefusedError) as error:
            return self._output(None, Quality.from_error(error, dict(self._match.metrics)), sample)
        self._hypotheses = fuse(prior, candidates, _SEPARATION_CELLS * cell_m)
        self._matched_m = self._path_length_m - 0.5 * self._segment.length_m
        metrics = {**self._match.metrics, "path_length_m": self._path_length_m}
        # Only the shipped parameters of the match are calibrated.
        kind = CovarianceKind.FORMAL if self.slot_parameters("match") else self.covariance_kind
        quality, best = assess(self._hypotheses, cell_m, metrics, kind), self._hypotheses[0]
        if best.matches and not best.explained:
            self._hypotheses = ()  # earlier matches are contradicted: the next prior is the robot's pose
        if quality.status is Status.FAILED:
            return self._output(None, quality, sample)
        columns, rows = shift_cells(best.transform, sample.value.geometry, orbital.geometry, centre(segment))
        metrics = {**quality.metrics, "shift_columns": columns, "shift_rows": rows}
        return self._output(best, replace(quality, metrics=metrics), sample)

    def _predict(self, point: FloatArray, cell_m: float) -> tuple[Hypothesis, ...]:
        """Return the hypotheses at a point of the segment, or one from the robot's own pose if there are
        none.
        """
        c = self.config
        if self._hypotheses:
            path_m = max(self._path_length_m - 0.5 * self._segment.length_m - self._matched_m, 0.0)
            return tuple(h.at(point, self._drift(path_m)) for h in self._hypotheses)
        prior_m = c.prior_m or max(_PRIOR_CELLS * cell_m, _PRIOR_M)
        covariance = np.diag([prior_m**2, prior_m**2, 0.0, np.radians(c.prior_deg) ** 2])
        covariance_point = point
        if self._pose is not None and self._pose.value.transform.covariance is not None:
            covariance = self._pose.value.transform.covariance[np.ix_(_XYZ_YAW, _XYZ_YAW)].copy()
            covariance_point = self._pose.value.transform.matrix[:3, 3]
        covariance[2, 2] += c.datum_m**2
        return (Hypothesis(np.eye(4), covariance, covariance_point).at(point, np.zeros(4)),)

    def _search_range(self, prior: tuple[Hypothesis, ...], cell_m: float) -> FloatArray:
        """Return the search range, in metres and radians, around the best hypothesis that covers all."""
        c, best = self.config, prior[0]
        spacing_m = max(float(np.hypot(*(h.position - best.position)[:2])) for h in prior)
        range_m = _SEARCH_SIGMAS * best.sigma_m + spacing_m + _SEPARATION_CELLS * cell_m
        max_search_m = c.max_search_m or max(_MAX_SEARCH_CELLS * cell_m, _MAX_SEARCH_M)
        range_rad = _SEARCH_SIGMAS * float(np.sqrt(best.covariance[3, 3]))
        return np.array([min(range_m, max_search_m), min(range_rad, np.radians(c.max_search_deg))])

    def _drift(self, path_m: float) -> FloatArray:
        """Return the variances (4,) of x, y, z and yaw of a random walk over a path."""
        c = self.config
        return path_m * np.square([c.drift_m, c.drift_m, c.drift_height_m, np.radians(c.drift_deg)])

    def _output(self, best: Hypothesis | None, quality: Quality, sample: Sample) -> Output:
        """Return ``T_orbital_base`` at the last pose, or ``T_orbital_map`` without poses."""
        pose = self._pose.value if self._pose is not None else None
        stamp_ns = pose.stamp_ns if pose is not None else sample.value.t1_ns
        T: UncertainTransform | None = None
        if best is not None:
            T_map_base = np.eye(4) if pose is None else pose.transform.matrix
            path_m = 0.0 if pose is None else 0.5 * self._segment.length_m
            at_base = best.at(T_map_base[:3, 3], self._drift(path_m))
            T = UncertainTransform(best.transform @ T_map_base, self._with_tilt(at_base.covariance))
            self._published = best
            self._set_correction(best, stamp_ns)
        return Output.of_pose(
            "pose",
            T,
            t0_ns=min(self._segment.t0_ns or stamp_ns, stamp_ns),
            stamp_ns=stamp_ns,
            frame=(self._orbital or sample).value.frame,
            child=pose.child_frame if pose is not None else f"{self.context.robot}/map",
            quality=quality,
            inputs=(*self._segment.inputs, self._orbital.id if self._orbital else ""),
            producer=self.name,
        )

    def _set_correction(self, best: Hypothesis, stamp_ns: int) -> None:
        """Set ``T_orbital_map`` for the current frame of the robot's poses."""
        assert self._orbital is not None  # hypotheses result from matches with the orbital model
        covariance = self._with_tilt(best.at(np.zeros(3), np.zeros(4)).covariance)
        self._correction = TransformWithCovariance.from_transform(
            UncertainTransform(best.transform, covariance),
            parent=self._orbital.value.frame,
            child=f"{self.context.robot}/map",
            stamp_ns=stamp_ns,
            producer=self.name,
        )

    def _with_tilt(self, xyz_yaw: FloatArray) -> FloatArray:
        """Return the covariance (6, 6) of a pose from the covariance of x, y, z and yaw, and the tilt of the
        robot's pose.
        """
        pose = None if self._pose is None else self._pose.value.transform.covariance
        covariance = np.zeros((6, 6))
        covariance[3:5, 3:5] = np.radians(_TILT_DEG) ** 2 * np.eye(2) if pose is None else pose[3:5, 3:5]
        covariance[np.ix_(_XYZ_YAW, _XYZ_YAW)] = xyz_yaw
        return covariance

    def _check_frame(self, frame: str) -> None:
        if self._pose is not None and self._pose.value.parent_frame != frame:
            raise InputError(
                f"patch in {frame}, poses in {self._pose.value.parent_frame}: expected one frame"
            )
