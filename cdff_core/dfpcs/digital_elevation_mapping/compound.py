# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of DigitalElevationMapping: queue captures, project, align, rasterise, fuse, publish."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import (
    ConfigurationError,
    ExtrapolationError,
    FrameNotFoundError,
    InputError,
    ProductNotFoundError,
    RefusedError,
)
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import ElevationMap, Pointcloud
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfpcs.digital_elevation_mapping.captured_points import CaptureProjector
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.interface import DigitalElevationMappingInterface
from cdff_core.dfpcs.digital_elevation_mapping.local_maps import LocalMapAligner, LocalMaps
from cdff_core.dfpcs.digital_elevation_mapping.patch import CapturePoints, PendingCaptures
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import PoseHistory


class DigitalElevationMapping(DigitalElevationMappingInterface):
    """Elevation patches from captures and the poses around them.

    Each measurement is part of exactly one patch, so that fused patches equal a map of all measurements.
    The layer ``variance`` of a cell is the variance of its heights, plus the mean variance of these heights
    due to the covariance of the poses and the noise along the ray. The variance of many heights already
    contains the noise, so that the sum is conservative. A cell without points is NaN.
    """

    Config = DigitalElevationMappingConfig
    config: DigitalElevationMappingConfig

    def setup(self) -> None:
        """Create the DFNs; offer the store items."""
        if {"resolution_m", "overhang_gap_m"} & self.slot_parameters("rasterisation").keys():
            raise ConfigurationError(
                f"{self.name}: rasterisation: resolution_m and overhang_gap_m are parameters of the DFPC"
            )
        if self.config.max_range_m is not None and self.config.min_range_m >= self.config.max_range_m:
            raise ConfigurationError(
                f"{self.name}: min_range_m={self.config.min_range_m}: expected below max_range_m"
            )
        self._poses = PoseHistory()
        self._projector = CaptureProjector(self.config, self.context.frames, self._poses, self.dfn)
        self._aligner = LocalMapAligner(self.dfn("registration"))
        self._maps = LocalMaps(self.config, self.dfn)
        self._thinning = self.dfn("thinning")
        self._queue: deque[Sample] = deque()
        self._patch = PendingCaptures()
        self._patch_requested = False
        self._last_output_ns: int | None = None
        self._newest_ns = 0
        self.store.offer("map", lambda: self._maps.local)
        self.store.offer("far_map", lambda: self._maps.far)
        self.store.offer("patch", lambda: self._maps.patch)

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Queue the capture; process the queued captures that the poses enclose."""
        if sample.value is None:
            return []
        self._newest_ns = max(self._newest_ns, sample.stamp_ns)
        self._queue.append(sample)
        if len(self._queue) > self.config.max_waiting:
            self._queue.popleft()
            self._patch.drops["queue_full"] += 1
        outputs = list(self._process_queue())
        if not outputs and self._patch.drops["queue_full"] and not self._patch.captures:
            outputs += self._report_missing_input()
        return outputs

    on_scan = on_stereo = on_cloud

    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Add the pose, process the captures enclosed now; a pose in another frame ends the patch."""
        if sample.value is None or sample.quality.status is Status.FAILED:
            self._patch.drops["failed_poses"] += 1
            return []
        is_new_frame = sample.value.parent_frame != self._poses.map_frame != ""
        outputs = self._publish() if is_new_frame and self._patch.captures else []
        if self._poses.insert(sample):
            self._projector.pairs.reset()
        return [*outputs, *self._process_queue()]

    def finish(self) -> Iterable[Output]:
        """Process the queued captures with the poses so far, and publish the last patch."""
        outputs = list(self._process_queue())
        only_ns = self._poses.only_pose_ns  # None unless there is exactly one pose
        while self._queue:
            sample = self._queue.popleft()
            if not self._poses.stamps_ns and sample.port == "cloud":
                self._add(sample, in_map_frame=True)
            elif only_ns is not None:
                self._patch.notes.add("not_deskewed:one_pose")
                self._add(sample, single_pose_ns=only_ns)
            else:
                self._patch.drops["not_covered_by_poses"] += 1
        if self._patch.captures:
            outputs += self._publish()
        elif self._patch.drops or self._patch.raw_points:
            outputs += self._failed_outputs()
        return outputs

    def get_map(self, resolution_m: float) -> ElevationMap:
        """Return the local map, in larger cells on request; raises ProductNotFoundError without a patch."""
        local = self._local_map()
        return local if resolution_m <= 0.0 else self._maps.pooled(local, resolution_m)

    def get_whole_map(self) -> ElevationMap:
        """Return the whole fused map; raises ProductNotFoundError without a patch."""
        self._local_map()
        return self._maps.whole()

    def publish_patch(self) -> None:
        """End the patch at the next sample."""
        self._patch_requested = True

    def _local_map(self) -> ElevationMap:
        if self._maps.local is None:
            raise ProductNotFoundError(f"{self.name}: nothing has been mapped yet")
        return self._maps.local

    def _process_queue(self) -> Iterable[Output]:
        """Process the captures that the poses enclose; publish each patch that is due."""
        outputs: list[Output] = []
        while self._queue:
            sample = self._queue[0]
            in_map_frame = sample.port == "cloud" and sample.value.frame == self._poses.map_frame != ""
            if not in_map_frame and not self._poses.reaches(sample.stamp_ns):
                break
            is_too_early = not in_map_frame and self._poses.starts_after(_start_ns(sample))
            if is_too_early and self._poses.only_pose_ns is not None:
                break  # without a second pose, finish() uses the only one for the whole capture
            self._queue.popleft()
            if is_too_early:
                self._patch.drops["before_first_pose"] += 1
                continue
            self._add(sample, in_map_frame=in_map_frame)
            if self._is_patch_due():
                outputs += self._publish()
        if not outputs and self._patch.drops["no_extrinsics"] and not self._patch.captures:
            outputs += self._report_missing_input()
        return outputs

    def _add(self, sample: Sample, *, in_map_frame: bool = False, single_pose_ns: int | None = None) -> None:
        """Project, align and add a capture to the patch, or count it as dropped by its reason.

        With ``in_map_frame``, the points are in the frame of the map already. With ``single_pose_ns``, the
        pose of this time is used for all points.
        """
        try:
            if in_map_frame:
                points: CapturePoints | None = self._projector.without_pose(sample)
            else:
                points = self._projector.project(sample, single_pose_ns)
        except ExtrapolationError:
            self._patch.drops["gap_in_poses"] += 1
        except FrameNotFoundError:
            self._patch.drops["no_extrinsics"] += 1
        except InputError:
            self._patch.drops["malformed"] += 1
        except RefusedError as refusal:
            self._patch.drops[refusal.reasons[0].split(":")[0]] += 1
        else:
            if points is not None:
                # Stereo is not aligned: its distant points are biased.
                is_aligned = self.config.align and sample.port != "stereo"
                self._patch.add(self._aligner.align(points, self._maps.local) if is_aligned else points)

    def _is_patch_due(self) -> bool:
        """Return whether the patch ends: on request, or by its duration, number of points or distance."""
        patch, c = self._patch, self.config
        if not patch.captures:
            return False
        return (
            self._patch_requested
            or patch.t1_ns - patch.t0_ns >= c.patch_period_s * 1e9
            or patch.points >= c.max_patch_points
            or self._moved_m(patch.t0_ns, patch.t1_ns) >= c.patch_distance_m
        )

    def _moved_m(self, t0_ns: int, t1_ns: int) -> float:
        """Return the distance between the positions at two times; 0 if a pose is missing."""
        if not self._poses.reaches(t1_ns) or self._poses.starts_after(t0_ns):
            return 0.0
        return float(np.linalg.norm((self._poses.at(t1_ns).matrix - self._poses.at(t0_ns).matrix)[:3, 3]))

    def _publish(self) -> list[Output]:
        """Rasterise the patch, fuse it into the maps, thin its cloud, and start the next patch."""
        patch, self._patch, self._patch_requested = self._patch, PendingCaptures(), False
        points = patch.joined()
        t0_ns, t1_ns = patch.t0_ns, patch.t1_ns
        frame = self._poses.map_frame or patch.captures[0].sample.value.frame or "map"
        position = None
        if self._poses.reaches(t1_ns) and not self._poses.starts_after(t1_ns):
            position = self._poses.at(t1_ns).matrix[:2, 3].copy()
        try:
            raster, fused = self._maps.add(patch, points, frame, position)
        except InputError as error:
            return self._failed_outputs(patch, str(error))
        self._last_output_ns = t1_ns
        cells = int(np.count_nonzero(np.isfinite(raster.layer("mean"))))
        quality = patch.quality(cells, fused.cleared, fused.forgotten)
        thin = self._thin_cloud(points.points_m[points.near], frame, t1_ns)
        products = {"map": raster, "cloud": thin}
        return [
            Output(port, value, t0_ns, t1_ns, frame, None, quality, patch.inputs)
            for port, value in products.items()
        ]

    def _thin_cloud(self, points: NDArray[np.float64], frame: str, stamp_ns: int) -> Pointcloud:
        """Return the points (n, 3) thinned to at most ``max_cloud_points``."""
        thin = self._thinning.process(PointCloudDownsamplingInputs(points=points)).points
        step = -(-len(thin) // self.config.max_cloud_points)
        return Pointcloud.from_points(thin[::step], frame=frame, stamp_ns=stamp_ns)

    def _report_missing_input(self) -> list[Output]:
        """Report once per period that captures arrive without poses, or without a mount."""
        last_ns, period_ns = self._last_output_ns, self.config.patch_period_s * 1e9
        is_due = last_ns is None or self._newest_ns - last_ns >= period_ns
        return self._failed_outputs() if is_due else []

    def _failed_outputs(self, patch: PendingCaptures | None = None, reason: str = "") -> list[Output]:
        """Return FAILED outputs with the reasons of a patch (default: the current one); start a new patch."""
        patch = patch or self._patch
        reasons = [f"dropped_{drop}:{count}" for drop, count in sorted(patch.drops.items())]
        reasons.append(reason or ("no_points_within_gates" if patch.raw_points else "no_measurements"))
        self._patch, self._last_output_ns = PendingCaptures(), self._newest_ns
        now_ns, frame, quality = self._newest_ns, self._poses.map_frame or "site", Quality.failed(*reasons)
        return [Output(port, None, now_ns, now_ns, frame, None, quality) for port in ("map", "cloud")]


def _start_ns(sample: Sample) -> int:
    """Return the start of a capture, nanoseconds."""
    length_ns: int = sample.value.t1_ns - sample.value.t0_ns if sample.port == "scan" else 0
    return sample.stamp_ns - length_ns
