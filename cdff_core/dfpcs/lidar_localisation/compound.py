# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarLocalisation: predict, get the local map, match, estimate; search where that fails."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from cdff_core.dfns.point_cloud_deskewing._interface import PointCloudDeskewingInputs
from cdff_core.dfns.point_cloud_filtering._interface import PointCloudFilteringInputs
from cdff_core.dfns.pose_estimation._interface import PoseEstimationInputs
from cdff_core.dfpcs.lidar_localisation._configuration import LidarLocalisationConfig
from cdff_core.dfpcs.lidar_localisation._graph import KeyFrames
from cdff_core.dfpcs.lidar_localisation._interface import LidarLocalisationInterface
from cdff_core.dfpcs.lidar_localisation._matching import Match, Sweep, SweepMatcher
from cdff_core.dfpcs.lidar_localisation._motion import Motion
from cdff_core.dfpcs.lidar_localisation._relocalisation import Relocaliser
from cdff_core.dfpcs.lidar_localisation._scan_map import ScanMap

_LEAST_POINTS = 200
#: Odometry older than this is no longer waited for.
_STALE_NS = 2_000_000_000


class LidarLocalisation(LidarLocalisationInterface):
    """Localise each sweep on the map."""

    Config: ClassVar[type[DfpcConfig]] = LidarLocalisationConfig

    config: LidarLocalisationConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        self._range, self._deskew, self._estimate = self.dfn("range"), self.dfn("deskew"), self.dfn("estimate")
        self._matcher = SweepMatcher(self, self.config)
        self._relocaliser = Relocaliser(self, self._matcher, self.config)
        self._motion = Motion(self.dfn("increment"), self.config)
        self._waiting: Sample | None = None
        self.forget_map()
        self.store.offer("scan_map", self._scan_map)
        self.store.offer("pose_graph", lambda: self._key_frames.graph(self._map.frame))
        self.store.offer("key_frames", lambda: self._key_frames.trajectory(self._map.frame, self._child))
        self.store.offer("last_pose", lambda: self._last)

    def forget_map(self) -> None:
        """Begin without map and estimate."""
        c = self.config
        self._map = ScanMap(
            c.voxel_m, c.tile_m, c.local_radius_m, c.local_reuse_m, self._matcher.normals, self._matcher.coarse
        )
        self._key_frames = KeyFrames(c.key_frame_m)
        self._used: dict[str, str] = {}
        self._child = ""
        self._last: TransformWithCovariance | None = None
        self.relocalise()

    def relocalise(self) -> None:
        """Forget the estimate."""
        self._pose: UncertainTransform | None = None
        self._pose_ns = 0
        self._motion.forget_poses()

    def get_local_map(self) -> Pointcloud:
        """The map around the estimate; raises ProductNotFoundError where there is no estimate or no map there."""
        local = None if self._pose is None else self._map.local(self._pose.matrix[:3, 3], _LEAST_POINTS)
        if local is None:
            raise ProductNotFoundError("no local map: there is no estimate, or no map around it")
        return Pointcloud.from_points(local.points_m, frame=self._map.frame, stamp_ns=self._pose_ns)

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Put a piece of the map into its tiles."""
        return self._grow(sample, sample.value.points_m, sample.value.frame)

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Put the cells of an elevation map into the tiles."""
        geometry = sample.value.geometry
        height = np.asarray(sample.value.layer("mean"), dtype=np.float64)
        rows, columns = np.nonzero(np.isfinite(height))
        x = geometry.xmin_m + (columns + 0.5) * geometry.resolution_m
        y = geometry.ymax_m - (rows + 0.5) * geometry.resolution_m
        return self._grow(sample, np.column_stack([x, y, height[rows, columns]]), geometry.frame)

    def on_graph_map(self, sample: Sample) -> Iterable[Output]:
        """Put the clouds of the key frames into the tiles, in place of what there was; keep the graph."""
        if sample.value.frame == self._map.frame:
            self._map.clear()  # the same map, its key frames moved: the estimate stays
        list(self._grow(sample, sample.value.points_m, sample.value.frame))
        self._key_frames.take(sample.value.graph)
        return ()

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Begin the next sweep from here."""
        T: UncertainTransform = sample.value.transform
        if T.covariance is None:
            sigma = np.repeat([self.config.guess_sigma_m, np.radians(self.config.guess_sigma_deg)], 3)
            T = UncertainTransform(T.matrix, np.diag(sigma**2))
        self.relocalise()
        self._pose, self._pose_ns = T, sample.stamp_ns
        self._used["guess"] = sample.id
        return ()

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Keep the odometry; take up the sweep that waited for it."""
        mount, _ = self._mount(sample.value.child_frame, sample.stamp_ns)
        self._motion.insert(sample.stamp_ns, sample.value, mount)
        if self._waiting is not None and not self._is_early(self._waiting):
            return self.finish()
        return ()

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Localise the sweep, once odometry reaches its end where there is any."""
        outputs = list(self.finish())
        if self._is_early(sample):
            self._waiting = sample
            return outputs
        return [*outputs, self._localised(sample)]

    def finish(self) -> Iterable[Output]:
        """Localise the sweep that waited for odometry with what there is."""
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else [self._localised(waiting)]

    def _grow(self, sample: Sample, points_m: se3.FloatArray, frame: str) -> Iterable[Output]:
        if self._map and frame != self._map.frame:
            self.forget_map()
        self._map.add(points_m, frame)
        self._used["map"] = sample.id
        return ()

    def _is_early(self, scan: Sample) -> bool:
        """Whether odometry is still to come that belongs to the sweep."""
        last_ns = self._motion.last_ns
        wait_ns = self.config.odometry_wait_s * 1e9
        return last_ns is not None and last_ns < scan.stamp_ns and scan.stamp_ns - last_ns < min(wait_ns, _STALE_NS)

    def _localised(self, sample: Sample) -> Output:
        """The control sequence for one sweep."""
        scan: LidarScan = sample.value
        T_base_lidar, self._child = self._mount(scan.frame, scan.t1_ns)
        predicted = self._predicted(scan.t1_ns)
        try:
            if not self._map:
                raise RefusedError("there is no map", ["no_map"])
            sweep = self._prepared(scan, T_base_lidar)
            pose, quality = self._tracked(sweep, predicted) if predicted is not None else (None, Quality(Status.FAILED))
            if pose is None:
                pose, quality = self._searched(sweep, quality)
        except (InputError, RefusedError) as error:
            reasons = getattr(error, "reasons", ()) or (f"bad_input:{error}",)
            pose, quality = None, Quality(Status.FAILED, tuple(reasons))
        return self._output(sample, predicted, pose, quality)

    def _predicted(self, stamp_ns: int) -> UncertainTransform | None:
        """The last pose moved on by the motion since."""
        if self._pose is None or stamp_ns < self._pose_ns:
            return self._pose
        return self._pose @ self._motion.between(self._pose_ns, stamp_ns)

    def _prepared(self, scan: LidarScan, T_base_lidar: se3.FloatArray) -> Sweep:
        """Keep points in range, bring them into the base at the end of the sweep, thin them."""
        near = self._range.process(PointCloudFilteringInputs(scan.points_m.astype(np.float64)))
        points, kept = near.filtered_points, near.kept
        if len(points) < _LEAST_POINTS:
            raise InputError(f"scan: {len(points)} points within range, expected at least {_LEAST_POINTS}")
        if scan.t1_ns > scan.t0_ns:
            stamps_ns = scan.t0_ns + scan.time_offset_us[kept].astype(np.int64) * 1000
            sweep = self._motion.sweep(min(scan.t0_ns, int(stamps_ns.min())), scan.t1_ns, T_base_lidar)
            points = self._deskew.process(
                PointCloudDeskewingInputs(points, np.minimum(stamps_ns, scan.t1_ns), sweep)
            ).points
        else:
            points = se3.transform_points(T_base_lidar, points)
        return self._matcher.sweep(points)

    def _tracked(self, sweep: Sweep, predicted: UncertainTransform) -> tuple[UncertainTransform | None, Quality]:
        """getLocalMap, PointcloudMatcher.doICP from the prediction, PoseEstimator.estimatePose."""
        local = self._map.local(predicted.matrix[:3, 3], _LEAST_POINTS)
        if local is None:
            return None, Quality(Status.FAILED, ("no_map_here",))
        quality = Quality(Status.FAILED)
        for doIcp in (self._matcher.near, self._matcher.far):
            match = doIcp(sweep, local, predicted.matrix, may_be_free=True)
            if match.is_good:
                pose, quality = self._estimated(predicted, match)
                if pose is not None:
                    return pose, quality
            else:
                quality = match.quality
        return None, quality

    def _estimated(self, predicted: UncertainTransform, match: Match) -> tuple[UncertainTransform | None, Quality]:
        """PoseEstimator.estimatePose; None where prediction and match contradict each other."""
        measured = self._matcher.pose(match.found)
        q = match.quality
        try:
            joined = self._estimate.process(
                PoseEstimationInputs(predicted.matrix, predicted.covariance, measured.matrix, measured.covariance)
            )
        except RefusedError as error:
            return None, Quality(Status.FAILED, tuple(error.reasons), metrics=q.metrics)
        metrics = {**q.metrics, "innovation": float(joined.innovation)}
        return UncertainTransform(joined.pose, joined.covariance), Quality(
            q.status, q.reasons, CovarianceKind.CALIBRATED, metrics
        )

    def _searched(self, sweep: Sweep, before: Quality) -> tuple[UncertainTransform | None, Quality]:
        """Search the whole map; lost where that finds nothing either."""
        match = self._relocaliser.found(sweep, self._map, self._key_frames.places_m)
        if not match.is_good:
            return None, Quality(Status.FAILED, ("lost", *dict.fromkeys((*match.quality.reasons, *before.reasons))))
        q = match.quality
        self._motion.forget_poses()
        reasons = ("relocalised", *q.reasons)
        return self._matcher.pose(match.found), Quality(Status.DEGRADED, reasons, CovarianceKind.CALIBRATED, q.metrics)

    def _output(
        self, sample: Sample, predicted: UncertainTransform | None, pose: UncertainTransform | None, quality: Quality
    ) -> Output:
        scan: LidarScan = sample.value
        value = None
        if pose is not None:
            self._motion.localised(scan.t1_ns, pose.matrix)
            self._key_frames.localised(scan.t1_ns, pose)
            value = self._last = TransformWithCovariance.from_transform(
                pose, parent=self._map.frame, child=self._child, stamp_ns=scan.t1_ns, producer=self.name
            )
        # Without an answer the prediction goes on, ever less certain.
        self._pose, self._pose_ns = pose or predicted, scan.t1_ns
        used = tuple(i for i in (*self._used.values(), sample.id) if i)
        frame = self._map.frame or "map"
        return Output("pose", value, scan.t0_ns, scan.t1_ns, frame, self._child, quality, used)

    def _mount(self, frame: str, stamp_ns: int) -> tuple[se3.FloatArray, str]:
        """``T_base_frame`` and the base's name; the identity and the frame itself where no mount is known."""
        base = f"{self.context.robot}/base"
        try:
            return self.context.frames.lookup(base, frame, stamp_ns).matrix, base
        except FrameNotFoundError:
            return np.eye(4), frame

    def _scan_map(self) -> Pointcloud | None:
        if not self._map:
            return None
        return Pointcloud.from_points(self._map.points_m, frame=self._map.frame, stamp_ns=self._pose_ns)
