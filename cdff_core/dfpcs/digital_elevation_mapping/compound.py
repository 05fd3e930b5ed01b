# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation patches from lidar and stereo, with the uncertainty of the poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import (
    ConfigurationError,
    ExtrapolationError,
    FrameNotFoundError,
    InputError,
    ProductNotFoundError,
)
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.raster import delivered_resolution
from cdff_common.types import ElevationMap, Pointcloud
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_core.dfns.dem_rasterisation._interface import DemRasterisationInputs
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfpcs.digital_elevation_mapping._interface import DigitalElevationMappingInterface
from cdff_core.dfpcs.digital_elevation_mapping.aligning import Aligning
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.measuring import Measuring
from cdff_core.dfpcs.digital_elevation_mapping.patch import Joined, Patch
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import PoseHistory
from cdff_core.elevation.map_cells import MapCells


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
        if {"resolution_m", "frame", "overhang_gap_m"} & set(self.config.rasterisation):
            raise ConfigurationError(
                f"{self.name}: rasterisation: resolution_m and overhang_gap_m are the DFPC's, frame that of the poses"
            )
        if self.config.max_range_m is not None and self.config.min_range_m >= self.config.max_range_m:
            raise ConfigurationError(f"{self.name}: min_range_m={self.config.min_range_m}: expected below max_range_m")
        self._rasterisation = self.dfn("rasterisation")
        self._aligning = Aligning(self.dfn("registration"))
        self._fusion = self.dfn("fusion")
        self._far_fusion = self.dfn("far_fusion")
        self._thinning = self.dfn("thinning")
        self._poses = PoseHistory(self.config.pose_history_s)
        self._measuring = Measuring(
            self.config,
            self.context.frames,
            self._poses,
            deskewing=self.dfn("deskewing"),
            disparity=self.dfn("disparity"),
            triangulation=self.dfn("triangulation"),
        )
        self._waiting: deque[Sample] = deque()
        self._patch = Patch()
        self._patch_asked_for = False
        self._last_report_ns: int | None = None
        self._newest_ns = 0
        self._map: ElevationMap | None = None
        self._far_map: ElevationMap | None = None
        self._newest_patch: ElevationMap | None = None
        self.store.offer("map", lambda: self._map)
        self.store.offer("far_map", lambda: self._far_map)
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
            self._measuring.forget_last_pair()
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
        local = self._map
        if self._far_map is not None and resolution_m >= self._far_map.geometry.resolution_m:
            local = self._far_map
        wanted_m = delivered_resolution([local.geometry.resolution_m], resolution_m)
        return MapCells.of_map(local, wanted_m).to_map(local.t0_ns, local.t1_ns)

    def get_whole_map(self) -> ElevationMap:
        """All that the fusion keeps, which for a moving window is the window; in larger cells where it is much.

        Raises
        ------
        ProductNotFoundError
            If nothing has been mapped yet.
        """
        if self._map is None:
            raise ProductNotFoundError(f"{self.name}: nothing has been mapped yet")
        whole: ElevationMap = self._fusion.process(DemFusionInputs(bounds=np.full(4, np.nan))).map
        return whole

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
            measured = self._measuring.as_it_is(sample) if in_map_frame else self._measuring.measure(sample, at_ns)
        except ExtrapolationError:
            self._patch.drops["gap_in_poses"] += 1
        except FrameNotFoundError:
            self._patch.drops["no_extrinsics"] += 1
        except InputError:
            self._patch.drops["malformed"] += 1
        else:
            if measured is not None and self.config.align and sample.port != "stereo":  # far pairs are biased
                measured = self._aligning.aligned(measured, self._map)
            if measured is not None:
                self._patch.add(measured)

    def _due(self) -> bool:
        patch, c = self._patch, self.config
        if not patch.captures:
            return False
        return (
            self._patch_asked_for
            or patch.t1_ns - patch.t0_ns >= c.patch_period_s * 1e9
            or patch.points >= c.max_patch_points
            or self._moved_m(patch.t0_ns, patch.t1_ns) >= c.patch_distance_m
        )

    def _moved_m(self, t0_ns: int, t1_ns: int) -> float:
        """Distance between the robot's positions at two times; 0 where a pose is missing."""
        if not self._poses.reaches(t1_ns) or self._poses.begins_after(t0_ns):
            return 0.0
        return float(np.linalg.norm((self._poses.at(t1_ns).matrix - self._poses.at(t0_ns).matrix)[:3, 3]))

    def _publish(self) -> list[Output]:
        """Rasterise the patch, thin its cloud, pool it into the local map, and start the next."""
        patch, self._patch, self._patch_asked_for = self._patch, Patch(), False
        measured = patch.joined()
        t0_ns, t1_ns = patch.t0_ns, patch.t1_ns
        frame = self._poses.map_frame or patch.captures[0].sample.value.frame or "map"
        try:
            made = self._rasterised(measured.only(measured.near), frame, 1)
            position = None
            if self._poses.reaches(t1_ns) and not self._poses.begins_after(t1_ns):
                position = self._poses.at(t1_ns).matrix[:2, 3].copy()
            rays = patch.rays(self.config.max_rays) if self.config.max_rays else None
            fused = self._fusion.process(DemFusionInputs(patch=made, centre=position, rays=rays))
            if self.config.far_factor:
                far = self._rasterised(measured, frame, self.config.far_factor)
                self._far_map = self._far_fusion.process(DemFusionInputs(patch=far, centre=position, rays=rays)).map
        except InputError as error:
            return self._failed(patch, str(error))
        self._map = fused.map
        self._newest_patch, self._last_report_ns = made, t1_ns
        cells = int(np.count_nonzero(np.isfinite(made.layer("mean"))))
        quality = patch.quality(cells, int(fused.cleared), int(fused.forgotten))
        thin = self._thinned(measured.points_m[measured.near], frame, t1_ns)
        return [
            Output("map", made, t0_ns, t1_ns, frame, quality=quality, inputs=patch.inputs),
            Output("cloud", thin, t0_ns, t1_ns, frame, quality=quality, inputs=patch.inputs),
        ]

    def _rasterised(self, measured: Joined, frame: str, factor: int) -> ElevationMap:
        """Elevation map of measurements in cells ``factor`` times the map's."""
        self._rasterisation.configure(
            {
                **self.config.rasterisation,
                "resolution_m": self.config.resolution_m * factor,
                "frame": frame,
                "overhang_gap_m": self.config.overhang_gap_m,
            }
        )
        made: ElevationMap = self._rasterisation.process(
            DemRasterisationInputs(
                points=measured.points_m,
                height_variance=measured.pose_variance_m2,
                stamps_ns=measured.stamps_ns,
                noise_variance=measured.noise_variance_m2,
                intensity=measured.brightness,
            )
        ).map
        return made

    def _thinned(self, points: NDArray[np.float64], frame: str, stamp_ns: int) -> Pointcloud:
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
