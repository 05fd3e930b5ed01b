# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of AbsoluteLocalisation: map a segment, match it, fuse it with those before, answer or refuse."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.raster_matching._interface import RasterMatchingInputs
from cdff_core.dfpcs.absolute_localisation._hypotheses import Hypothesis, fused, probability
from cdff_core.dfpcs.absolute_localisation._interface import AbsoluteLocalisationInterface
from cdff_core.dfpcs.absolute_localisation._jumps import Jumps

Float = NDArray[np.float64]

#: Order of a pose's covariance that leaves x, y, z and yaw.
_LEVEL = np.array([0, 1, 2, 5])
_REACH_SIGMAS = 3.0
#: Poses that begin so far before the newest are of another run.
_CLOCK_BACK_NS = 10_000_000_000
#: Candidates closer than so many orbital cells are one place.
_APART_CELLS = 3.0


class AbsoluteLocalisationConfig(DfpcConfig):
    """When is matched, how the robot drifts, and the gates an answer must pass."""

    fusion: dict[str, Any] = Field({}, description="Of DemFusion")
    match: dict[str, Any] = Field({}, description="Of RasterMatching")
    segment_m: float = Field(30.0, gt=0.0, le=10_000.0, description="Way after which is matched, metres")
    map_m: float = Field(
        80.0, gt=0.0, le=10_000.0, description="Edge of the square that the segment's map may fill, metres"
    )
    max_search_m: float = Field(60.0, gt=0.0, le=100_000.0, description="Farthest that is searched, metres")
    max_search_deg: float = Field(20.0, gt=0.0, le=180.0, description="Farthest turn that is searched, degrees")
    prior_m: float = Field(10.0, gt=0.0, description="Standard deviation of the first place without poses, metres")
    prior_deg: float = Field(
        3.0, gt=0.0, le=180.0, description="Standard deviation of the first yaw without poses, degrees"
    )
    datum_m: float = Field(100.0, ge=0.0, description="Standard deviation of the orbital model's height datum, metres")
    drift_m: float = Field(
        0.05, ge=0.0, description="Drift of the robot's own x and y over a metre of way, metres (1 sigma)"
    )
    drift_height_m: float = Field(
        0.004, ge=0.0, description="Drift of its height over a metre of way, metres (1 sigma)"
    )
    drift_deg: float = Field(0.12, ge=0.0, description="Drift of its yaw over a metre of way, degrees (1 sigma)")
    tilt_deg: float = Field(1.0, gt=0.0, description="Roll and pitch where poses do not say, degrees (1 sigma)")
    min_probability: float = Field(0.999, gt=0.5, lt=1.0, description="Of the likeliest hypothesis, ambiguous below")
    min_explained: float = Field(
        0.45, gt=0.0, lt=1.0, description="Share of the relief that is explained, FAILED below"
    )
    good_explained: float = Field(0.6, gt=0.0, lt=1.0, description="The same, DEGRADED below")
    min_correlation: float = Field(0.52, gt=0.0, lt=1.0, description="Correlation of the gradients, FAILED below")
    confirmed_share: float = Field(
        0.7, gt=0.0, le=1.0, description="Of these two gates where an earlier segment agrees"
    )
    max_sigma_cells: float = Field(
        0.4, gt=0.0, description="Standard deviation of the place in orbital cells, FAILED above"
    )
    jump_m: float = Field(
        0.2, gt=0.0, description="Of the frame of poses: what odometry does not explain, beyond slip, metres"
    )
    jump_deg: float = Field(
        2.5, gt=0.0, le=180.0, description="The same of its yaw, degrees: above what skidding wheels are off in a step"
    )


class AbsoluteLocalisation(AbsoluteLocalisationInterface):
    """Match the map of each segment of the way with the orbital model."""

    Config: ClassVar[type[DfpcConfig]] = AbsoluteLocalisationConfig

    config: AbsoluteLocalisationConfig

    def setup(self) -> None:
        """Make the DFNs, offer the store's items, begin with nothing."""
        self._match = self.dfn("match")
        self._orbital: Sample | None = None
        self.forget()
        self.store.offer("orbital", lambda: self._orbital.value if self._orbital else None)
        self.store.offer("rover_map", lambda: self._map)
        self.store.offer("correction", lambda: self._correction)

    def forget(self) -> None:
        """Forget map and hypotheses, keep the orbital model."""
        self._hypotheses: tuple[Hypothesis, ...] = ()
        self._pose: Sample | None = None
        self._answered: Hypothesis | None = None
        self._correction: TransformWithCovariance | None = None
        self._jumps = Jumps(self.config.jump_m, np.radians(self.config.jump_deg))
        self._jump_ns = 0
        self._way_m = 0.0
        self._matched_way_m = 0.0
        self._begin_segment()

    def on_orbital(self, sample: Sample) -> Iterable[Output]:
        """Keep the orbital model; matches with another one do not count. A segment that waited for it is matched."""
        self._orbital = sample
        self._hypotheses, self._answered = (), None
        return self._matched()

    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Keep the pose and add to the way driven; where its frame jumped, what is known follows."""
        if sample.value is None:
            return ()
        if self._pose is not None and sample.stamp_ns < self._pose.stamp_ns - _CLOCK_BACK_NS:
            self.forget()  # nothing of the other run holds
        step = self._jumps.step(sample.stamp_ns, sample.value.transform.matrix)
        self._way_m += step.way_m
        self._pose = sample
        if step.jumped:
            self._moved(step.frame, sample.stamp_ns)
        return ()

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Keep what tells jumps of the poses' frame from the way driven."""
        if sample.value is not None:
            self._jumps.odometry(sample.stamp_ns, sample.value.transform.matrix)
        return ()

    def _moved(self, frame: Float | None, stamp_ns: int) -> None:
        """Hypotheses of the frame that was become those of the frame that is (``frame`` T_new_old); the segment ends.

        Where nobody knows how far it jumped, the next match begins from the pose's own covariance: it holds the fix.
        """
        answered = None if frame is None or self._answered is None else self._answered.after(frame)
        self._hypotheses = () if frame is None else tuple(h.after(frame) for h in self._hypotheses)
        self._answered, self._correction = answered, None
        if answered is not None:
            self._correct(answered, stamp_ns)
        self._jump_ns = stamp_ns
        self._begin_segment()

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Pool the patch; match the segment's map where it is long enough. One begun before a jump is in two frames."""
        if sample.value is None or sample.value.t0_ns < self._jump_ns:
            return ()
        try:
            self._map = self._fusion.process(DemFusionInputs(patch=sample.value)).map
            self._check_frames(sample.value.frame)
        except InputError as error:
            return [self._output(None, Quality(Status.FAILED, (f"bad_patch:{error}",)), sample)]
        self._inputs = (*self._inputs, sample.id)[-_MAX_INPUTS:] if sample.id else self._inputs
        self._t0_ns = min(self._t0_ns or sample.value.t0_ns, sample.value.t0_ns)
        self._span_m = max(self._span_m, _span(self._map)) if self._pose is None else self._way_m - self._begun_m
        self._patch = sample
        return self._matched()

    def _matched(self) -> Iterable[Output]:
        """What the segment's map is worth, where it is long enough and there is a model; then the next begins."""
        if self._orbital is None or self._map is None or self._patch is None or self._span_m < self.config.segment_m:
            return ()
        output = self._located(self._patch, self._orbital.value, self._map)
        self._begin_segment()
        return [output]

    def get_correction(self) -> TransformWithCovariance:
        """T_orbital_map; raises ProductNotFoundError before the first answer."""
        if self._correction is None:
            raise ProductNotFoundError(
                f"{self.name}: nothing has been matched yet, or not since the frame of poses jumped; drive "
                f"{self.config.segment_m:g} m"
            )
        return self._correction

    def get_map(self) -> ElevationMap:
        """The segment's map; raises ProductNotFoundError where no patch has come since the last match."""
        if self._map is None:
            raise ProductNotFoundError(f"{self.name}: no patch has come since the last match")
        return self._map

    def _located(self, sample: Sample, orbital: ElevationMap, segment: ElevationMap) -> Output:
        """Predict, match, fuse, judge."""
        try:
            prior = self._predicted(_middle(segment))
            found = self._match.process(
                RasterMatchingInputs(orbital, segment, guess=prior[0].transform, reach=self._reach(prior))
            )
        except (InputError, RefusedError) as error:
            reasons = getattr(error, "reasons", ()) or (f"bad_input:{error}",)
            return self._output(None, Quality(Status.FAILED, tuple(reasons), metrics=dict(self._match.metrics)), sample)
        cell_m = orbital.geometry.resolution_m
        self._hypotheses = fused(prior, found, _APART_CELLS * cell_m)
        self._matched_way_m = self._way_m - 0.5 * self._span_m
        best = self._hypotheses[0]
        quality = self._judged(self._hypotheses, cell_m)
        if best.matches and not best.explained:  # what was matched before is doubted: the next begins from poses
            self._hypotheses = ()
        return self._output(None if quality.status is Status.FAILED else best, quality, sample)

    def _predicted(self, point: Float) -> tuple[Hypothesis, ...]:
        """The hypotheses at the middle of the segment; at first the one that the robot is where it believes."""
        c = self.config
        if self._hypotheses:
            way_m = max(self._way_m - 0.5 * self._span_m - self._matched_way_m, 0.0)
            return tuple(h.at(point, self._drift(way_m)) for h in self._hypotheses)
        covariance = np.diag([c.prior_m**2, c.prior_m**2, 0.0, np.radians(c.prior_deg) ** 2])
        at = point
        if self._pose is not None and self._pose.value.transform.covariance is not None:
            covariance = self._pose.value.transform.covariance[np.ix_(_LEVEL, _LEVEL)].copy()
            at = self._pose.value.transform.matrix[:3, 3]
        covariance[2, 2] += c.datum_m**2
        return (Hypothesis(np.eye(4), covariance, at).at(point, np.zeros(4)),)

    def _reach(self, prior: tuple[Hypothesis, ...]) -> Float:
        """How far from the likeliest is searched: its uncertainty, and where the others are."""
        c, best = self.config, prior[0]
        farthest_m = max(float(np.hypot(*(h.place - best.place)[:2])) for h in prior)
        reach_m = _REACH_SIGMAS * best.sigma_m + farthest_m + _APART_CELLS * self._cell_m
        turn_rad = _REACH_SIGMAS * float(np.sqrt(best.covariance[3, 3]))
        return np.array([min(reach_m, c.max_search_m), min(turn_rad, np.radians(c.max_search_deg))])

    def _drift(self, way_m: float) -> Float:
        """Variances of x, y, z and yaw that a way adds: a random walk."""
        c = self.config
        return way_m * np.array([c.drift_m**2, c.drift_m**2, c.drift_height_m**2, np.radians(c.drift_deg) ** 2])

    def _judged(self, hypotheses: tuple[Hypothesis, ...], cell_m: float) -> Quality:
        """Whether the likeliest hypothesis may be answered."""
        c, best = self.config, hypotheses[0]
        p = probability(hypotheses)
        share = c.confirmed_share if best.matches > 1 else 1.0
        failed, weak = [], []
        if not best.explained:
            failed.append("no_candidate_agrees")
        if p < c.min_probability:
            failed.append(f"ambiguous:{p:.3f}")
        if best.explained < share * c.min_explained:
            failed.append(f"unexplained:{best.explained:.2f}")
        elif best.explained < share * c.good_explained:
            weak.append(f"weakly_explained:{best.explained:.2f}")
        if best.correlation < share * c.min_correlation:
            failed.append(f"low_correlation:{best.correlation:.2f}")
        if best.sigma_m > c.max_sigma_cells * cell_m:
            failed.append(f"uncertain:{best.sigma_m:.2f}m")
        status = Status.FAILED if failed else Status.DEGRADED if weak else Status.OK
        metrics = {
            **self._match.metrics, "probability": p, "matches": best.matches, "sigma_m": best.sigma_m,
            "way_m": self._way_m,
        }  # fmt: skip
        formal = bool(self.config.match)  # calibrated is what is shipped
        kind = CovarianceKind.FORMAL if formal else CovarianceKind.CALIBRATED
        return Quality(status, tuple(failed or weak), metrics=metrics, covariance_kind=kind)

    def _output(self, best: Hypothesis | None, quality: Quality, sample: Sample) -> Output:
        """T_orbital_base at the last pose, or T_orbital_map without poses."""
        frame = self._orbital.value.frame if self._orbital is not None else sample.value.frame
        pose = self._pose.value if self._pose is not None else None
        child = pose.child_frame if pose is not None else f"{self.context.robot}/map"
        stamp_ns = pose.stamp_ns if pose is not None else sample.value.t1_ns
        value = None
        if best is not None:
            T_map_base = np.eye(4) if pose is None else pose.transform.matrix
            now = best.at(T_map_base[:3, 3], self._drift(0.0 if pose is None else 0.5 * self._span_m))
            T = UncertainTransform(best.transform @ T_map_base, self._six(now.covariance))
            value = TransformWithCovariance.from_transform(
                T, parent=frame, child=child, stamp_ns=stamp_ns, producer=self.name
            )
            self._answered = best
            self._correct(best, stamp_ns)
        ids = (*self._inputs, *((self._orbital.id,) if self._orbital is not None and self._orbital.id else ()))
        t0_ns = min(self._t0_ns or stamp_ns, stamp_ns)
        return Output("pose", value, t0_ns, stamp_ns, frame, child, quality, ids)

    def _correct(self, best: Hypothesis, stamp_ns: int) -> None:
        """T_orbital_map, as it was answered, in the map's frame of now."""
        assert self._orbital is not None  # it was matched with
        T = UncertainTransform(best.transform, self._six(best.at(np.zeros(3), np.zeros(4)).covariance))
        self._correction = TransformWithCovariance.from_transform(
            T, parent=self._orbital.value.frame, child=f"{self.context.robot}/map", stamp_ns=stamp_ns,
            producer=self.name,
        )  # fmt: skip

    def _six(self, covariance: Float) -> Float:
        """6 x 6 of x, y, z, yaw: roll and pitch are those of the robot's own pose."""
        made = np.diag([0.0, 0.0, 0.0, *[np.radians(self.config.tilt_deg) ** 2] * 2, 0.0])
        known = None if self._pose is None else self._pose.value.transform.covariance
        if known is not None:
            made[3:5, 3:5] = known[3:5, 3:5]
        made[np.ix_(_LEVEL, _LEVEL)] = covariance
        return made

    @property
    def _cell_m(self) -> float:
        return 1.0 if self._orbital is None else float(self._orbital.value.geometry.resolution_m)

    def _check_frames(self, frame: str) -> None:
        if self._pose is not None and self._pose.value.parent_frame != frame:
            raise InputError(f"patch in {frame}, poses in {self._pose.value.parent_frame}: expected one frame")

    def _begin_segment(self) -> None:
        self._fusion = self.dfn("fusion")
        self._fusion.configure({"size_m": self.config.map_m, **self.config.fusion})
        self._map: ElevationMap | None = None
        self._patch: Sample | None = None
        self._inputs: tuple[str, ...] = ()
        self._t0_ns: int | None = None
        self._span_m = 0.0
        self._begun_m = self._way_m


#: Most patches named as inputs.
_MAX_INPUTS = 256


def _middle(segment: ElevationMap) -> Float:
    """Mean of the observed cells ``(3,)``."""
    z = segment.layer("mean")
    row, col = np.nonzero(np.isfinite(z))
    g = segment.geometry
    if not len(row):
        return np.zeros(3)
    return np.array(
        [g.x_centres_m()[col].mean(), g.y_centres_m()[row].mean(), float(z[row, col].mean(dtype=np.float64))]
    )


def _span(segment: ElevationMap) -> float:
    """Longest extent of what was observed, metres: the way where no poses say it."""
    row, col = np.nonzero(np.isfinite(segment.layer("mean")))
    if not len(row):
        return 0.0
    return float(max(np.ptp(row), np.ptp(col)) + 1) * segment.geometry.resolution_m
