# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation patches from lidar and stereo, with the uncertainty of the poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import (
    ConfigurationError,
    ExtrapolationError,
    FrameNotFoundError,
    InputError,
    ProductNotFoundError,
)
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import CellStatistics, aggregate_to, delivered_resolution
from cdff_common.types import ElevationMap, Pointcloud
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.dem_rasterisation._interface import DemRasterisationInputs
from cdff_core.dfns.disparity_image._interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud._interface import DisparityToPointCloudInputs
from cdff_core.dfns.point_cloud_deskewing._interface import PointCloudDeskewingInputs
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfpcs.digital_elevation_mapping._interface import DigitalElevationMappingInterface
from cdff_core.dfpcs.digital_elevation_mapping.patch import Measurements, Patch
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import PoseHistory

Points = NDArray[np.float64]
Stamps = NDArray[np.int64]


class DigitalElevationMappingConfig(DfpcConfig):
    """Cells, gates and periods."""

    resolution_m: float = Field(0.05, gt=0.0, le=1000.0, description="Edge of a cell, metres")
    patch_period_s: float = Field(2.0, gt=0.0, description="Mission time after which a patch is published, seconds")
    patch_distance_m: float = Field(2.0, gt=0.0, description="Distance after which a patch is published, metres")
    max_patch_points: int = Field(2_000_000, ge=1, description="Points after which a patch is published")
    min_range_m: float = Field(0.5, ge=0.0, description="Nearest point used, metres from the sensor")
    max_range_m: float = Field(100.0, gt=0.0, description="Farthest point used, metres from the sensor")
    min_height_m: float | None = Field(None, description="Lowest point used, metres above the sensor; absent: any")
    max_height_m: float | None = Field(None, description="Highest point used, metres above the sensor; absent: any")
    range_sigma_m: float = Field(0.02, ge=0.0, description="Noise of a lidar's or cloud's range, metres, one sigma")
    stereo_distance_m: float = Field(0.3, ge=0.0, description="Motion after which the next pair is used, metres")
    stereo_period_s: float = Field(2.0, ge=0.0, description="Time after which the next pair is used anyway, seconds")
    stereo_min_period_s: float = Field(0.5, ge=0.0, description="Time before which no other pair is used, seconds")
    max_waiting: int = Field(40, ge=1, le=10_000, description="Captures that may wait for poses")
    pose_history_s: float = Field(30.0, gt=0.0, description="How long poses are kept, seconds")
    max_cloud_points: int = Field(100_000, ge=1, description="Points of a published cloud")
    deskewing: dict[str, Any] = Field(default_factory=dict)
    rasterisation: dict[str, Any] = Field(default_factory=dict)
    fusion: dict[str, Any] = Field(default_factory=dict)
    thinning: dict[str, Any] = Field(default_factory=dict)
    disparity: dict[str, Any] = Field(default_factory=dict)
    triangulation: dict[str, Any] = Field(default_factory=dict)


class DigitalElevationMapping(DigitalElevationMappingInterface):
    """Captures wait for the poses around them, become points of the site, and end in a patch.

    A patch holds each measurement once and shares none with another patch, so that patches pool to what all
    measurements at once would give. ``variance`` of a cell is the variance of the heights measured in it, plus the mean
    of the variances that the poses' covariance and the noise along the ray put on each; of many heights the noise is in
    their spread too, so that the sum errs to the safe side. A cell no point fell into is NaN.
    """

    Config: ClassVar[type[DfpcConfig]] = DigitalElevationMappingConfig

    def setup(self) -> None:
        """Make the DFNs and offer the local map."""
        if {"resolution_m", "frame"} & set(self.config.rasterisation):
            raise ConfigurationError(f"{self.name}: rasterisation: resolution_m is the DFPC's, frame that of the poses")
        if self.config.min_range_m >= self.config.max_range_m:
            raise ConfigurationError(f"{self.name}: min_range_m={self.config.min_range_m}: expected below max_range_m")
        self._deskewing = self.dfn("deskewing")
        self._rasterisation = self.dfn("rasterisation")
        self._rasterise_in("map")
        self._fusion = self.dfn("fusion")
        self._thinning = self.dfn("thinning")
        self._disparity = self.dfn("disparity")
        self._triangulation = self.dfn("triangulation")
        self._poses = PoseHistory(self.config.pose_history_s)
        self._waiting: deque[Sample] = deque()
        self._patch = Patch()
        self._patch_asked_for = False
        self._last_pair: tuple[int, Points] | None = None
        self._last_report_ns: int | None = None
        self._newest_ns = 0
        self._map: ElevationMap | None = None
        self._newest_patch: ElevationMap | None = None
        self.store.offer("map", lambda: self._map)
        self.store.offer("patch", lambda: self._newest_patch)

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Hold the cloud until a pose covers it."""
        return self._capture(sample)

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Hold the sweep until poses enclose it."""
        return self._capture(sample)

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Hold the pair until poses enclose it."""
        return self._capture(sample)

    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Extend the track and use what it now covers; poses in another frame end the patch."""
        if sample.value is None or sample.quality.status is Status.FAILED:
            self._patch.drops["failed_poses"] += 1
            return []
        outputs: list[Output] = []
        if self._poses.map_frame and sample.value.parent_frame != self._poses.map_frame and self._patch.captures:
            outputs += self._publish()
        if self._poses.insert(sample):
            self._last_pair = None
        return [*outputs, *self._use_covered()]

    def finish(self) -> Iterable[Output]:
        """Use what can be used of the captures that still wait, and publish the last patch."""
        outputs = list(self._use_covered())
        only_ns = self._poses.only_pose_ns
        while self._waiting:
            sample = self._waiting.popleft()
            if not self._poses.stamps_ns and sample.port == "cloud":
                self._try(sample, in_map_frame=True)
            elif only_ns is not None:
                self._patch.notes.add("not_deskewed:one_pose")
                self._try(sample, at_ns=only_ns)
            else:
                self._patch.drops["not_covered_by_poses"] += 1
        if self._patch.captures:
            outputs += self._publish()
        elif self._patch.drops or self._patch.points_in:
            outputs += self._failed()
        return outputs

    def get_map(self, resolution_m: float) -> ElevationMap:
        """The local map, pooled to coarser cells where asked.

        Raises
        ------
        ProductNotFoundError
            If nothing has been mapped yet.
        """
        if self._map is None:
            raise ProductNotFoundError(f"{self.name}: nothing has been mapped yet")
        if resolution_m <= 0.0:
            return self._map
        fine = CellStatistics.from_layers(
            self._map.geometry, {name: self._map.layer(name) for name in self._map.layer_names}, self._map.t1_ns
        )
        coarse = aggregate_to(fine, delivered_resolution([fine.geometry.resolution_m], resolution_m))
        layers = coarse.to_layers(self._map.t1_ns)
        return ElevationMap.from_layers(coarse.geometry, layers, t0_ns=self._map.t0_ns, t1_ns=self._map.t1_ns)

    def publish_patch(self) -> None:
        """End the patch with the next sample."""
        self._patch_asked_for = True

    def _capture(self, sample: Sample) -> Iterable[Output]:
        if sample.value is None:
            return []
        self._newest_ns = max(self._newest_ns, sample.stamp_ns)
        self._waiting.append(sample)
        if len(self._waiting) > self.config.max_waiting:
            self._waiting.popleft()
            self._patch.drops["queue_full"] += 1
        outputs = list(self._use_covered())
        if not outputs and self._patch.drops["queue_full"] and not self._patch.captures:
            outputs += self._starving()
        return outputs

    def _use_covered(self) -> Iterable[Output]:
        """Use the captures at the head of the queue that the poses enclose; publish each patch that is due."""
        outputs: list[Output] = []
        while self._waiting:
            sample = self._waiting[0]
            in_map_frame = sample.port == "cloud" and sample.value.frame == self._poses.map_frame != ""
            if not in_map_frame and not self._poses.reaches(sample.stamp_ns):
                break
            begun_before = not in_map_frame and self._poses.begins_after(_begin_ns(sample))
            if begun_before and self._poses.only_pose_ns is not None:
                break  # should no second pose come, finish() takes the one for all of the capture
            self._waiting.popleft()
            if begun_before:
                self._patch.drops["before_first_pose"] += 1
                continue
            self._try(sample, in_map_frame=in_map_frame)
            if self._due():
                outputs += self._publish()
        return outputs

    def _try(self, sample: Sample, *, in_map_frame: bool = False, at_ns: int | None = None) -> None:
        """Add a capture to the patch, or count why not."""
        try:
            measured = self._as_it_is(sample) if in_map_frame else self._measure(sample, at_ns)
        except ExtrapolationError:
            self._patch.drops["gap_in_poses"] += 1
        except FrameNotFoundError:
            self._patch.drops["no_extrinsics"] += 1
        except InputError:
            self._patch.drops["malformed"] += 1
        else:
            if measured is not None and len(measured.points_m):
                self._patch.captures.append(measured)

    def _as_it_is(self, sample: Sample) -> Measurements:
        """A cloud that is already in the frame of the map: no sensor, so no gate and no uncertainty of a pose."""
        points = sample.value.points_m
        points = points[np.isfinite(points).all(axis=1)]
        self._patch.points_in += len(sample.value.points_m)
        stamps = np.full(len(points), sample.stamp_ns, dtype=np.int64)
        return Measurements(points, stamps, np.zeros(len(points)), np.zeros(len(points)), sample, [])

    def _measure(self, sample: Sample, at_ns: int | None) -> Measurements | None:
        """Points of a capture in the frame of the map, within the gates; None for a pair that is not needed."""
        T_body_sensor = self._extrinsics(sample)
        t1_ns = sample.stamp_ns if at_ns is None else at_ns
        T_map_body = self._poses.at(t1_ns)
        if sample.port == "stereo" and not self._pair_is_due(t1_ns, T_map_body):
            return None
        points, stamps, sigma_m = self._points_of(sample)
        self._patch.points_in += len(points)
        range_m = np.linalg.norm(points, axis=1)
        near_enough = (range_m >= self.config.min_range_m) & (range_m <= self.config.max_range_m)  # false for NaN
        points, stamps, sigma_m, range_m = (a[near_enough] for a in (points, stamps, sigma_m, range_m))
        if len(points) == 0:
            return None
        pose_stamps = stamps if at_ns is None else np.full(len(points), at_ns, dtype=np.int64)
        trajectory, poses = self._poses.around(int(pose_stamps.min()), int(pose_stamps.max()))
        moved = self._deskewing.process(
            PointCloudDeskewingInputs(points=T_body_sensor.apply(points), stamps_ns=pose_stamps, trajectory=trajectory)
        )
        above_m = moved.points[:, 2] - (T_map_body @ T_body_sensor).matrix[2, 3]
        noise_m2 = (sigma_m * above_m / range_m) ** 2  # the vertical part of the noise along the ray
        keep = np.ones(len(above_m), dtype=np.bool_)
        if self.config.min_height_m is not None:
            keep &= above_m >= self.config.min_height_m
        if self.config.max_height_m is not None:
            keep &= above_m <= self.config.max_height_m
        if self._patch.origin_m is None:
            self._patch.origin_m = T_map_body.matrix[:3, 3].copy()
        return Measurements(
            moved.points[keep], stamps[keep], moved.height_variance[keep], noise_m2[keep], sample, poses
        )

    def _extrinsics(self, sample: Sample) -> UncertainTransform:
        """``T_body_sensor`` of the profile's frames, else as the sample states it; raises FrameNotFoundError."""
        value, body = sample.value, self._poses.body_frame
        frame = value.frame or sample.frame
        if frame == body:
            return UncertainTransform.identity()
        try:
            return self.context.frames.lookup(body, frame, sample.stamp_ns)
        except FrameNotFoundError:
            stated: UncertainTransform | None = None
            if sample.port == "stereo":
                stated = value.left.T_robot_sensor
            elif sample.port == "cloud":
                stated = value.T_robot_sensor
            if stated is None:
                raise
            return stated

    def _points_of(self, sample: Sample) -> tuple[Points, Stamps, Points]:
        """Points ``(n, 3)`` in the sensor's frame, their stamps ``(n,)`` and noise along the ray ``(n,)``, metres."""
        value = sample.value
        if sample.port == "scan":
            behind_ns = (value.t1_ns - value.t0_ns) - value.time_offset_us.astype(np.int64) * 1000
            sigma_m = np.full(len(value.points_m), self.config.range_sigma_m)
            return value.points_m.astype(np.float64), sample.stamp_ns - behind_ns, sigma_m
        if sample.port == "stereo":
            disparity = self._disparity.process(DisparityImageInputs(left=value.left, right=value.right)).disparity
            baseline_m = np.array(value.baseline, dtype=np.float64)
            seen = self._triangulation.process(DisparityToPointCloudInputs(disparity=disparity, baseline_m=baseline_m))
            points = seen.points
            sigma_m = seen.depth_sigma_m * np.linalg.norm(points, axis=1) / points[:, 2]
        else:
            points = value.points_m
            sigma_m = np.full(len(points), self.config.range_sigma_m)
        return points, np.full(len(points), sample.stamp_ns, dtype=np.int64), sigma_m

    def _pair_is_due(self, stamp_ns: int, T_map_body: UncertainTransform) -> bool:
        position = T_map_body.matrix[:3, 3]
        if self._last_pair is not None:
            then_ns, there = self._last_pair
            waited_s, moved_m = (stamp_ns - then_ns) / 1e9, float(np.linalg.norm(position - there))
            idle = moved_m < self.config.stereo_distance_m and waited_s < self.config.stereo_period_s
            if idle or waited_s < self.config.stereo_min_period_s:
                return False
        self._last_pair = (stamp_ns, position)
        return True

    def _due(self) -> bool:
        patch, c = self._patch, self.config
        if not patch.captures:
            return False
        moved_m = 0.0
        if patch.origin_m is not None and self._poses.reaches(patch.t1_ns):
            moved_m = float(np.linalg.norm(self._poses.at(patch.t1_ns).matrix[:3, 3] - patch.origin_m))
        return (
            self._patch_asked_for
            or patch.t1_ns - patch.t0_ns >= c.patch_period_s * 1e9
            or moved_m >= c.patch_distance_m
            or patch.points >= c.max_patch_points
        )

    def _publish(self) -> list[Output]:
        """Rasterise the patch, thin its cloud, pool it into the local map, and start the next."""
        patch, self._patch, self._patch_asked_for = self._patch, Patch(), False
        points, stamps, own_variance = patch.joined()
        t0_ns, t1_ns = patch.t0_ns, patch.t1_ns
        frame = self._poses.map_frame or patch.captures[0].sample.value.frame or "map"
        self._rasterise_in(frame)
        try:
            made: ElevationMap = self._rasterisation.process(
                DemRasterisationInputs(points=points, height_variance=own_variance, stamps_ns=stamps)
            ).map
        except InputError as error:
            return self._failed(patch, str(error))
        position = None
        if self._poses.reaches(t1_ns) and not self._poses.begins_after(t1_ns):
            position = self._poses.at(t1_ns).matrix[:2, 3].copy()
        self._map = self._fusion.process(DemFusionInputs(patch=made, centre=position)).map
        self._newest_patch, self._last_report_ns = made, t1_ns
        quality = patch.quality(int(np.count_nonzero(np.isfinite(made.layer("mean")))))
        thin = self._thinned(points, frame, t1_ns)
        return [
            Output("map", made, t0_ns, t1_ns, frame, quality=quality, inputs=patch.inputs),
            Output("cloud", thin, t0_ns, t1_ns, frame, quality=quality, inputs=patch.inputs),
        ]

    def _rasterise_in(self, frame: str) -> None:
        """Let the patches lie in ``frame``, which is known with the first pose."""
        fixed = {"resolution_m": self.config.resolution_m, "frame": frame}
        self._rasterisation.configure({**self.config.rasterisation, **fixed})

    def _thinned(self, points: Points, frame: str, stamp_ns: int) -> Pointcloud:
        thin = self._thinning.process(PointCloudDownsamplingInputs(points=points)).points
        step = -(-len(thin) // self.config.max_cloud_points)
        return Pointcloud.from_points(thin[::step], frame=frame, stamp_ns=stamp_ns)

    def _starving(self) -> list[Output]:
        """Say once a period that captures come but no poses."""
        last_ns = self._last_report_ns
        if last_ns is not None and self._newest_ns - last_ns < self.config.patch_period_s * 1e9:
            return []
        return self._failed()

    def _failed(self, patch: Patch | None = None, why: str = "") -> list[Output]:
        patch = patch or self._patch
        reasons = [f"dropped_{reason}:{count}" for reason, count in sorted(patch.drops.items())]
        reasons.append(why or ("no_points_within_gates" if patch.points_in else "no_measurements"))
        self._patch, self._last_report_ns = Patch(), self._newest_ns
        quality = Quality(status=Status.FAILED, reasons=tuple(reasons))
        now_ns, frame = self._newest_ns, self._poses.map_frame or "site"
        return [Output(port, None, now_ns, now_ns, frame, quality=quality) for port in ("map", "cloud")]


def _begin_ns(sample: Sample) -> int:
    """Begin of capture, nanoseconds."""
    return sample.stamp_ns - (sample.value.t1_ns - sample.value.t0_ns) if sample.port == "scan" else sample.stamp_ns
