# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarLocalisation: predict, get the local map, match, estimate; search if that fails."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from cdff_core.dfns.point_cloud_deskewing.interface import PointCloudDeskewingInputs
from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
from cdff_core.dfns.pose_estimation.interface import PoseEstimationInputs
from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig
from cdff_core.dfpcs.lidar_localisation.interface import LidarLocalisationInterface
from cdff_core.dfpcs.lidar_localisation.keyframes import Keyframes
from cdff_core.dfpcs.lidar_localisation.motion_prior import MotionPrior
from cdff_core.dfpcs.lidar_localisation.relocaliser import Relocaliser
from cdff_core.dfpcs.lidar_localisation.sweep_matcher import Sweep, SweepMatcher
from cdff_core.dfpcs.lidar_localisation.tiled_map import TiledMap

#: Least number of points of a sweep, and of the map around the estimate.
_MIN_POINTS = 200
#: Standard deviations of a guess without covariance.
_GUESS_SIGMA_M, _GUESS_SIGMA_DEG = 1.0, 10.0
#: Age of the newest odometry above which sweeps do not wait for further odometry.
_STALE_NS = 2_000_000_000


class LidarLocalisation(LidarLocalisationInterface):
    """Localisation of each sweep in the map.

    Docstrings name the steps of the InFuse control sequence, such as ``PointcloudMatcher.doICP``.
    """

    Config = LidarLocalisationConfig
    config: LidarLocalisationConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._range, self._deskew = self.dfn("range"), self.dfn("deskew")
        self._estimate = self.dfn("estimate")
        self._matcher = SweepMatcher(self, self.config)
        self._relocaliser = Relocaliser(self, self._matcher, self.config)
        self._motion = MotionPrior(self.dfn("increment"), self.config)
        self._waiting: Sample | None = None
        self.forget_map()
        self.store.offer("scan_map", self._scan_map)
        self.store.offer("pose_graph", lambda: self._keyframes.graph(self._map.frame))
        self.store.offer("key_frames", lambda: self._keyframes.trajectory(self._map.frame, self._child))
        self.store.offer("last_pose", lambda: self._last)

    def forget_map(self) -> None:
        """Clear map, keyframes and estimate."""
        c, matcher = self.config, self._matcher
        self._map = TiledMap(c.voxel_m, c.local_radius_m, matcher.normals, matcher.thin_coarse)
        self._keyframes = Keyframes(c.keyframe_distance_m)
        self._input_ids: dict[str, str] = {}
        self._child = ""
        self._last: TransformWithCovariance | None = None
        self.relocalise()

    def relocalise(self) -> None:
        """Clear the estimate: the next sweep is searched in the whole map."""
        self._pose: UncertainTransform | None = None
        self._pose_ns = 0
        self._motion.clear_poses()

    def get_local_map(self) -> Pointcloud:
        """Return the map around the estimate; raises ProductNotFoundError without either."""
        local = None if self._pose is None else self._map.local(self._pose.matrix[:3, 3], _MIN_POINTS)
        if local is None:
            raise ProductNotFoundError("no local map: there is no estimate, or no map around it")
        return Pointcloud.from_points(local.points_m, frame=self._map.frame, stamp_ns=self._pose_ns)

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Add a piece of the map."""
        return self._add_to_map(sample, sample.value.points_m, sample.value.frame)

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Add the cells of an elevation map."""
        geometry = sample.value.geometry
        height = np.asarray(sample.value.layer("mean"), dtype=np.float64)
        rows, columns = np.nonzero(np.isfinite(height))
        x = geometry.xmin_m + (columns + 0.5) * geometry.resolution_m
        y = geometry.ymax_m - (rows + 0.5) * geometry.resolution_m
        return self._add_to_map(sample, np.column_stack([x, y, height[rows, columns]]), geometry.frame)

    def on_graph_map(self, sample: Sample) -> Iterable[Output]:
        """Replace the map by the clouds of the keyframes; store the graph."""
        if sample.value.frame == self._map.frame:
            self._map.clear()  # the same map with corrected keyframes: the estimate remains valid
        self._add_to_map(sample, sample.value.points_m, sample.value.frame)
        self._keyframes.set_map(sample.value.graph)
        return ()

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Use the pose as the prediction for the next sweep."""
        T: UncertainTransform = sample.value.transform
        if T.covariance is None:
            sigma = np.repeat([_GUESS_SIGMA_M, np.radians(_GUESS_SIGMA_DEG)], 3)
            T = UncertainTransform(T.matrix, np.diag(sigma**2))
        self.relocalise()
        self._pose, self._pose_ns = T, sample.stamp_ns
        self._input_ids["guess"] = sample.id
        return ()

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Store the odometry; process the sweep that waited for it."""
        mount, _ = self._mount(sample.value.child_frame, sample.stamp_ns)
        self._motion.insert(sample.stamp_ns, sample.value, mount)
        if self._waiting is not None and not self._is_awaiting_odometry(self._waiting):
            return self.finish()
        return ()

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Localise the sweep, once the odometry, if any, reaches its end."""
        outputs = list(self.finish())
        if self._is_awaiting_odometry(sample):
            self._waiting = sample
            return outputs
        return [*outputs, self._localise(sample)]

    def finish(self) -> Iterable[Output]:
        """Localise the sweep that waited for odometry with the odometry so far."""
        waiting, self._waiting = self._waiting, None
        return () if waiting is None else [self._localise(waiting)]

    def _add_to_map(self, sample: Sample, points_m: se3.FloatArray, frame: str) -> Iterable[Output]:
        if self._map and frame != self._map.frame:
            self.forget_map()
        self._map.add(points_m, frame)
        self._input_ids["map"] = sample.id
        return ()

    def _is_awaiting_odometry(self, scan: Sample) -> bool:
        """Return whether odometry up to the end of the sweep is still expected."""
        last_ns = self._motion.last_ns
        wait_ns = self.config.odometry_wait_s * 1e9
        return (
            last_ns is not None
            and last_ns < scan.stamp_ns
            and scan.stamp_ns - last_ns < min(wait_ns, _STALE_NS)
        )

    def _localise(self, sample: Sample) -> Output:
        """Run the control sequence for one sweep."""
        scan: LidarScan = sample.value
        T_base_lidar, self._child = self._mount(scan.frame, scan.t1_ns)
        predicted_pose = self._predict(scan.t1_ns)
        try:
            if not self._map:
                raise RefusedError("there is no map", ["no_map"])
            sweep = self._prepare(scan, T_base_lidar)
            pose, quality = (
                self._track(sweep, predicted_pose)
                if predicted_pose is not None
                else (None, Quality(Status.FAILED))
            )
            if pose is None:
                pose, quality = self._search(sweep, quality)
        except (InputError, RefusedError) as error:
            pose, quality = None, Quality.from_error(error)
        return self._output(sample, predicted_pose, pose, quality)

    def _predict(self, stamp_ns: int) -> UncertainTransform | None:
        """Return the last pose with the motion since then; None without a pose."""
        if self._pose is None or stamp_ns < self._pose_ns:
            return self._pose
        return self._pose @ self._motion.between(self._pose_ns, stamp_ns)

    def _prepare(self, scan: LidarScan, T_base_lidar: se3.FloatArray) -> Sweep:
        """Select points in range, deskew them into the base's frame at the end of the sweep, thin them."""
        filtered = self._range.process(PointCloudFilteringInputs(points=scan.points_m.astype(np.float64)))
        points, is_near = filtered.filtered_points, filtered.kept
        if len(points) < _MIN_POINTS:
            raise InputError(f"scan: {len(points)} points within range, expected at least {_MIN_POINTS}")
        if scan.t1_ns > scan.t0_ns:
            stamps_ns = scan.t0_ns + scan.time_offset_us[is_near].astype(np.int64) * 1000
            t0_ns = min(scan.t0_ns, int(stamps_ns.min()))
            pose_stamps_ns, poses = self._motion.lidar_poses(t0_ns, scan.t1_ns, T_base_lidar)
            points = self._deskew.process(
                PointCloudDeskewingInputs(
                    points=points,
                    stamps_ns=np.minimum(stamps_ns, scan.t1_ns),
                    pose_stamps_ns=pose_stamps_ns,
                    poses=poses,
                )
            ).points
        else:
            points = se3.transform_points(T_base_lidar, points)
        return self._matcher.prepare(points)

    def _track(
        self, sweep: Sweep, predicted: UncertainTransform
    ) -> tuple[UncertainTransform | None, Quality]:
        """Run getLocalMap, PointcloudMatcher.doICP from the prediction and PoseEstimator.estimatePose.

        Return None as the pose if no match is accepted.
        """
        local = self._map.local(predicted.matrix[:3, 3], _MIN_POINTS)
        if local is None:
            return None, Quality.failed("no_map_here")
        quality = Quality(Status.FAILED)
        for register in (self._matcher.register, self._matcher.register_coarse_to_fine):
            match = register(sweep, local, predicted.matrix, allow_degenerate=True)
            quality = match.quality
            if match.accepted is not None:
                pose, quality = self._estimate_pose(predicted, self._matcher.pose(match.accepted), quality)
                if pose is not None:
                    return pose, quality
        return None, quality

    def _estimate_pose(
        self, predicted: UncertainTransform, measured: UncertainTransform, quality: Quality
    ) -> tuple[UncertainTransform | None, Quality]:
        """Run PoseEstimator.estimatePose; return None if prediction and match contradict each other."""
        assert predicted.covariance is not None  # predictions and matches have one
        assert measured.covariance is not None
        try:
            estimate = self._estimate.process(
                PoseEstimationInputs(
                    prediction=predicted.matrix,
                    prediction_covariance=predicted.covariance,
                    measurement=measured.matrix,
                    measurement_covariance=measured.covariance,
                )
            )
        except RefusedError as error:
            return None, Quality.from_error(error, quality.metrics)
        metrics = {**quality.metrics, "innovation": estimate.innovation}
        return UncertainTransform(estimate.pose, estimate.covariance), Quality(
            quality.status, quality.reasons, self.covariance_kind, metrics
        )

    def _search(self, sweep: Sweep, tracking: Quality) -> tuple[UncertainTransform | None, Quality]:
        """Search the whole map; without a match the quality is FAILED, with the reason ``lost``."""
        match = self._relocaliser.search(sweep, self._map, self._keyframes.positions_m)
        if match.accepted is None:
            return None, Quality.failed("lost", *match.quality.reasons, *tracking.reasons)
        self._motion.clear_poses()
        reasons = ["relocalised", *match.quality.reasons]
        quality = Quality.from_reasons(reasons, self.covariance_kind, match.quality.metrics)
        return self._matcher.pose(match.accepted), quality

    def _output(
        self,
        sample: Sample,
        predicted: UncertainTransform | None,
        pose: UncertainTransform | None,
        quality: Quality,
    ) -> Output:
        """Update the estimate and return the output of a sweep."""
        scan: LidarScan = sample.value
        if pose is not None:
            self._motion.add_pose(scan.t1_ns, pose.matrix)
            self._keyframes.add_pose(scan.t1_ns, pose)
        # Without a pose the prediction continues with growing covariance.
        self._pose, self._pose_ns = pose or predicted, scan.t1_ns
        output = Output.of_pose(
            "pose",
            pose,
            t0_ns=scan.t0_ns,
            stamp_ns=scan.t1_ns,
            frame=self._map.frame or "map",
            child=self._child,
            quality=quality,
            inputs=(*self._input_ids.values(), sample.id),
            producer=self.name,
        )
        self._last = output.value or self._last
        return output

    def _mount(self, frame: str, stamp_ns: int) -> tuple[se3.FloatArray, str]:
        """Return ``T_base_frame`` and the base; for an unknown mount the identity and the frame itself."""
        base = f"{self.context.robot}/base"
        try:
            return self.context.frames.lookup(base, frame, stamp_ns).matrix, base
        except FrameNotFoundError:
            return np.eye(4), frame

    def _scan_map(self) -> Pointcloud | None:
        if not self._map:
            return None
        return Pointcloud.from_points(self._map.points_m, frame=self._map.frame, stamp_ns=self._pose_ns)
