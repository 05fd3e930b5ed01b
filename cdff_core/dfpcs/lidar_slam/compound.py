# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarSlam: track, keep key frames, close loops, answer."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import LidarMap, Pointcloud, PoseGraph, PoseTrajectory, TransformWithCovariance
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfpcs.lidar_slam._interface import LidarSlamInterface
from cdff_core.dfpcs.lidar_slam.closing import LoopCloser
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyFrame, KeyFrameMap
from cdff_core.dfpcs.lidar_slam.tracking import Tracked, Tracker
from cdff_core.dfpcs.lidar_slam.trajectory import Trajectory
from cdff_core.dfpcs.lidar_slam.verdict import degraded_of, metrics_of
from cdff_core.dfpcs.lidar_slam.wheels import Wheels

Float = NDArray[np.float64]

#: Way after which the place is worth keeping anew.
_STATE_WAY_M = 1.0
#: Sweeps after which a place that was found again after a restart is known well enough.
_SOUGHT_SWEEPS = 16


class LidarSlam(LidarSlamInterface):
    """Odometry on a map of the surroundings, key frames in a pose graph.

    Two frames: in ``{robot}/lidar_odom`` poses follow from one another and never jump; ``{robot}/slam`` is the frame of
    the map, where they are corrected as loops close. Both begin at the lidar's first sweep.
    """

    Config: ClassVar[type[DfpcConfig]] = LidarSlamConfig

    config: LidarSlamConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        robot = self.context.robot
        self._slam, self._odom, self._lidar = f"{robot}/slam", f"{robot}/lidar_odom", f"{robot}/lidar"
        self._closer = LoopCloser(self, self.config)
        self._thin_keyframe, self._thin_map = self.dfn("thin_keyframe"), self.dfn("thin_map")
        self._optimiser = self.dfn("optimise")
        self.forget()
        self.store.offer("map", lambda: self.export_map() if len(self._places) else None)
        self.store.offer("graph", lambda: self._graph() if len(self._places) else None)
        self.store.offer(
            "trajectory", lambda: self.get_trajectory(-1, -1) if self._trajectory.is_placed(self._places) else None
        )
        self.store.offer("cloud", lambda: self.get_map(0.0) if len(self._places) else None)

    def forget(self) -> None:
        """Forget map and trajectory and begin anew."""
        self._tracker = self._new_tracker()
        self._places = KeyFrameMap()
        self._trajectory = Trajectory(self.config.history)
        self._current: int | None = None
        self._T_current_lidar = UncertainTransform.identity()
        self._fresh: list[Float] = []
        self._resumed_at: tuple[int, Float] | None = None
        self._sought: tuple[int, Float] | None = None  # the place before a restart, while it is not found again
        self._sought_sweeps = 0
        self._alone = False  # one sweep is all that was seen since a restart: a place found by it is not claimed yet
        self._told_m = 0.0  # way at which the state was last called new; it is, too, after 1, 2, 4, ... sweeps
        self._sweeps = 0
        self._odometry_covariance = np.zeros((6, 6))
        self._way_m = 0.0
        self._begun_m: dict[int, float] = {}  # way at the begin of each key frame of this run
        self._degraded = 0
        self._used: tuple[str, ...] = ()
        self.state_revision += 1

    @property
    def places(self) -> KeyFrameMap:
        """The key frames, for whoever judges them; not to be changed."""
        return self._places

    # -- samples in -----------------------------------------------------------------------------------------------

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Keep the pose until the sweeps of its time are in."""
        if sample.value is not None and sample.quality.status is not Status.FAILED:
            self._tracker.take_odometry(sample.stamp_ns, sample.value.transform)
        return ()

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Track the sweep, keep it in a key frame, close loops where the key frame ends."""
        tracked = self._tracker.track(sample.value)
        if self._current is None:
            self._begin(sample, tracked)
        else:
            self._alone = False
            self._T_current_lidar = self._T_current_lidar @ tracked.increment
            self._way_m += float(np.linalg.norm(tracked.increment.matrix[:3, 3]))
        self._gather(tracked)
        found = self._seek_place()
        if found and not len(self._trajectory):
            tracked = self._tracked_on_map(sample, tracked)
        ended = self._is_far()
        closed = self._end_keyframe(sample.stamp_ns) if ended else False
        self._sweeps += 1
        if self._way_m - self._told_m > _STATE_WAY_M or not self._sweeps & (self._sweeps - 1):
            self._told_m = self._way_m
            self.state_revision += 1
        assert self._current is not None
        self._trajectory.append(sample.stamp_ns, self._current, _noisy(self._T_current_lidar, tracked))
        self._used = (sample.id,) if sample.id else ()
        yield from self._poses(sample, tracked)
        if found or closed or (ended and self.config.report_keyframes):
            yield from self._reports(sample.stamp_ns)

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Take a map over, or hold it beside the own one until a loop links both; one that is linked now is merged."""
        taken = self._take(sample.value)
        if self._places.root in taken.values():
            return ()
        for key in taken.values():
            self._close(key, known=taken.values())
            if key in self._places.part(self._places.root):
                break
        return self._reports(max(sample.stamp_ns, self._newest_ns()))

    def finish(self) -> Iterable[Output]:
        """End the key frame, and publish trajectory, graph and cloud of the whole map."""
        if self._current is None:
            return
        self._finish_cloud(self._current)
        self._close(self._current, dissolve=False)
        yield from self._reports(self._newest_ns())
        cloud = self.get_map(0.0)
        yield Output("cloud", cloud, self._first_ns(), cloud.stamp_ns, self._slam, None, self._map_quality())

    # -- operations -----------------------------------------------------------------------------------------------

    def export_map(self) -> LidarMap:
        """Key frames with their clouds and graph, and where the lidar is; the current key frame with what it has."""
        if not len(self._places):
            raise ProductNotFoundError(f"{self.name}: nothing has been mapped yet")
        if self._current is not None:
            self._finish_cloud(self._current, describe=False)
        position = self._sought or self._resumed_at
        if position is None and self._current is not None:
            position = self._current, self._T_current_lidar.matrix
        return self._places.to_message(frame=self._slam, sensor=self._lidar, producer=self.name, position=position)

    def get_map(self, voxel_m: float) -> Pointcloud:
        """The clouds of all key frames linked with the first, as the graph places them, thinned."""
        keys = sorted(self._places.part(self._places.root))
        if not keys:
            raise ProductNotFoundError(f"{self.name}: nothing has been mapped yet")
        clouds = [self._places.frames[k].points_m for k in keys]
        if self._current in keys:
            clouds[keys.index(self._current)] = self._gathered()
        placed = [se3.transform_points(self._places.poses[k], c) for k, c in zip(keys, clouds, strict=True)]
        edge = np.array(voxel_m) if voxel_m > 0.0 else None
        thinned = self._thin_map.process(PointCloudDownsamplingInputs(np.concatenate(placed), edge)).points
        return Pointcloud.from_points(thinned, frame=self._slam, stamp_ns=self._newest_ns())

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """``T_slam_lidar`` between two times; raises ProductNotFoundError where there is none."""
        stamps, poses, covariances = self._trajectory.placed(self._places, t0_ns, t1_ns)
        if not len(stamps):
            raise ProductNotFoundError(f"{self.name}: no pose between {t0_ns} and {t1_ns}")
        return PoseTrajectory.from_arrays(
            stamps, poses, covariances, parent=self._slam, child=self._lidar, producer=self.name
        )

    # -- what survives a restart ----------------------------------------------------------------------------------

    def state(self) -> LidarMap | None:
        """The map; None while there is none."""
        return self.export_map() if len(self._places) else None

    def resume(self, state: Any) -> None:
        """Take over the map of before; the place is believed when the first sweep fits it.

        Raises
        ------
        InputError
            If the state is no LidarMap.
        """
        if not isinstance(state, LidarMap):
            raise InputError(f"{self.name}: state of type {type(state).__name__}, expected LidarMap")
        self.forget()
        new = self._take(state)
        position = state.last_position
        self._resumed_at = None if position is None else (new[position[0]], position[1])

    # -- inside ---------------------------------------------------------------------------------------------------

    def _take(self, message: LidarMap) -> dict[int, int]:
        """Add the key frames of a message and describe them; their new ids by the old ones."""
        new = self._places.absorb(message)
        for key in new.values():
            self._places.frames[key] = self._closer.described(self._places.frames[key])
        if self._places.root in new.values():
            self._places.optimise(self._optimiser)
        self.state_revision += 1
        return new

    def _new_tracker(self, wheels: Wheels | None = None) -> Tracker:
        """Tracking that knows no surroundings yet, with what is known of the odometry."""
        try:
            T_base_lidar = self.context.frames.lookup(f"{self.context.robot}/base", self._lidar, 0).matrix
        except FrameNotFoundError:
            T_base_lidar = np.eye(4)  # without extrinsics odometry is taken as that of the lidar
        wheels = Wheels(self.config.wheels_age_s, T_base_lidar) if wheels is None else wheels
        return Tracker(self.config, self.dfn("deskewing"), self.dfn("tracking"), wheels)

    def _begin(self, sample: Sample, tracked: Tracked) -> None:
        """The first key frame: of a new map, or after a restart of a part that has yet to be linked with it."""
        self._sought, self._resumed_at = self._resumed_at, None
        self._alone = self._sought is not None
        self._T_current_lidar = UncertainTransform.identity()
        self._current = self._places.begin(sample.stamp_ns, tracked.T_odom_lidar)
        self._begun_m[self._current] = self._way_m
        self.state_revision += 1  # the frame of the map begins here: whoever resumes must know

    def _seek_place(self) -> bool:
        """Compare what was seen since a restart with the map around the place before it; whether a link was found.

        After 1, 2, 4, ... sweeps: the more was seen, the surer and the better known is the link that it gives.
        """
        if self._sought is None or self._current is None:
            return False
        self._sought_sweeps += 1
        if self._sought_sweeps & (self._sought_sweeps - 1):
            return False
        linked = self._places.part(self._places.root)
        is_found = self._current in linked
        key, T_key_lidar = self._sought
        last_m = (self._places.poses[self._current] if is_found else self._places.poses[key] @ T_key_lidar)[:3, 3]
        around = sorted(
            linked - set(self._begun_m), key=lambda k: (float(np.linalg.norm(self._places.poses[k][:3, 3] - last_m)), k)
        )
        self._finish_cloud(self._current, describe=False)
        loops = self._closer.found_again(self._places, self._current, around[: self.config.candidates])
        if is_found and self._sought_sweeps >= _SOUGHT_SWEEPS:
            self._sought = None
        if not loops:
            return False
        self._places.unlink(self._current)
        for loop in loops:
            self._places.link(loop.old, loop.new, loop.T)
        self._places.optimise(self._optimiser)
        return True

    def _tracked_on_map(self, sample: Sample, alone: Tracked) -> Tracked:
        """The first sweep after a restart on the map around the place found, where the next ones go on.

        Held at that place where the clouds of the map are too thin to hold it; as it was tracked ``alone`` where they
        do not fit at all.
        """
        assert self._current is not None
        T_map_key = self._places.poses[self._current]
        around = [
            se3.transform_points(self._places.poses[k], self._places.frames[k].points_m)
            for k in self._places.part(self._places.root) - {self._current}
            if np.linalg.norm(self._places.poses[k][:3, 3] - T_map_key[:3, 3]) < self.config.max_range_m
        ]
        tracker = self._new_tracker(self._tracker.wheels)
        tracker.begin_at(T_map_key, np.concatenate(around))
        tracked = tracker.track(sample.value)
        found = tracked.registration
        if found is None or tracked.lost:
            return alone
        T = _rigid(se3.inverse(T_map_key) @ tracked.T_odom_lidar)
        self._tracker, self._T_current_lidar = tracker, UncertainTransform(T, found.covariance)
        return tracked

    def _gather(self, tracked: Tracked) -> None:
        """Add the sweep to the cloud of the current key frame."""
        if tracked.lost:
            return
        points = tracked.points_m
        near = points[np.einsum("ij,ij->i", points, points) < self.config.keyframe_range_m**2]
        if len(near):
            thinned = self._thin_keyframe.process(PointCloudDownsamplingInputs(near)).points
            self._fresh.append(se3.transform_points(self._T_current_lidar.matrix, thinned))

    def _gathered(self) -> NDArray[np.float32]:
        """The current key frame's cloud so far."""
        assert self._current is not None
        frame = self._places.frames[self._current]
        known = [np.asarray(frame.points_m, dtype=np.float64)] if len(frame.points_m) else []
        parts = [*known, *self._fresh]
        if not parts:
            return np.zeros((0, 3), np.float32)
        merged = self._thin_keyframe.process(PointCloudDownsamplingInputs(np.concatenate(parts))).points
        return merged.astype(np.float32)

    def _finish_cloud(self, key: int, *, describe: bool = True) -> None:
        """Put what was gathered into the key frame."""
        frame = KeyFrame(self._places.frames[key].stamp_ns, self._gathered(), self._places.frames[key].descriptor)
        self._fresh.clear()
        self._closer.forget(key)
        self._places.frames[key] = self._closer.described(frame) if describe else frame

    def _is_far(self) -> bool:
        return float(np.linalg.norm(self._T_current_lidar.matrix[:3, 3])) > self.config.keyframe_distance_m

    def _end_keyframe(self, stamp_ns: int) -> bool:
        """End the current key frame, close its loops, and begin the next; True where a loop was closed."""
        assert self._current is not None
        self._finish_cloud(self._current)
        before = self._places.loops, self._places.loops_rejected
        self._close(self._current)
        closed = before != (self._places.loops, self._places.loops_rejected)
        self._current = self._places.follow(self._current, stamp_ns, self._T_current_lidar)
        self._begun_m[self._current] = self._way_m
        self._T_current_lidar = UncertainTransform.identity()
        self.state_revision += 1
        return closed

    def _close(self, key: int, *, dissolve: bool = True, known: Collection[int] | None = None) -> None:
        """Find and verify loops of a key frame, link them, optimise; a key frame next to an old one goes up in it.

        Loops with the key frames that are ``known``, by default those on the way just come, would be no news.
        """
        if known is None:
            since_m = self._way_m - 2.0 * self.config.search_radius_m
            known = {k for k, begun_m in self._begun_m.items() if begun_m > since_m}
        loops = list(self._closer.loops(self._places, key, known))
        if not loops:
            return
        for loop in loops:
            self._places.link(loop.old, loop.new, loop.T)
        if self._places.root in self._places.part(key):
            self._places.optimise(self._optimiser)
        nearest = min(loops, key=lambda found: float(np.linalg.norm(found.T.matrix[:3, 3])))
        apart_m = float(np.linalg.norm(nearest.T.matrix[:3, 3]))
        kept = any({nearest.old, nearest.new} == set(e[:2]) for e in self._places.edges)
        if dissolve and kept and key != self._places.root and apart_m < self.config.reuse_distance_m:
            self._dissolve(key, nearest.old, nearest.T)

    def _dissolve(self, key: int, into: int, T_into_key: UncertainTransform) -> None:
        """Let a key frame go up in an older one."""
        self._places.dissolve(key, into, T_into_key)
        self._closer.forget(key)
        self._begun_m.pop(key, None)
        self._trajectory.move(key, into, T_into_key.matrix)
        if self._current == key:
            self._current, self._T_current_lidar = into, T_into_key @ self._T_current_lidar

    # -- samples out ----------------------------------------------------------------------------------------------

    def _poses(self, sample: Sample, tracked: Tracked) -> Iterator[Output]:
        """Odometry and pose of a sweep."""
        c, scan = self.config, sample.value
        reasons = degraded_of(tracked, c)
        self._degraded += bool(reasons)
        metrics = metrics_of(tracked) | {"keyframes": float(len(self._places)), "way_m": self._way_m}
        status = Status.DEGRADED if reasons else Status.OK
        quality = Quality(status, reasons, CovarianceKind.FORMAL, metrics)
        if tracked.lost:
            failed = Quality(Status.FAILED, ("lost", *reasons), CovarianceKind.NONE, metrics)
            for port, frame in (("odometry", self._odom), ("pose", self._slam)):
                yield Output(port, None, scan.t0_ns, scan.t1_ns, frame, self._lidar, failed, self._used)
            return
        step = tracked.increment
        before = UncertainTransform(_rigid(tracked.T_odom_lidar @ se3.inverse(step.matrix)), self._odometry_covariance)
        odometry = before @ step
        assert odometry.covariance is not None  # every increment has one
        assert self._current is not None  # since the sweep was tracked
        self._odometry_covariance = odometry.covariance
        yield self._pose("odometry", self._odom, _noisy(odometry, tracked), scan, quality)
        if self._alone or self._current not in self._places.part(self._places.root):
            unknown = Quality(Status.FAILED, ("not_localised_in_map", *reasons), CovarianceKind.NONE, metrics)
            yield Output("pose", None, scan.t0_ns, scan.t1_ns, self._slam, self._lidar, unknown, self._used)
            return
        key = UncertainTransform(self._places.poses[self._current], self._places.covariances[self._current])
        yield self._pose("pose", self._slam, _noisy(key @ self._T_current_lidar, tracked), scan, quality)

    def _pose(self, port: str, parent: str, T: UncertainTransform, scan: Any, quality: Quality) -> Output:
        value = TransformWithCovariance.from_transform(
            T, parent=parent, child=self._lidar, stamp_ns=scan.t1_ns, producer=self.name
        )
        return Output(port, value, scan.t0_ns, scan.t1_ns, parent, self._lidar, quality, self._used)

    def _reports(self, stamp_ns: int) -> Iterator[Output]:
        """Trajectory and graph as they are now."""
        first_ns, quality = self._first_ns(), self._map_quality()
        if self._trajectory.is_placed(self._places):
            value = self.get_trajectory(-1, -1)
            yield Output("trajectory", value, first_ns, stamp_ns, self._slam, self._lidar, quality, self._used)
        yield Output("graph", self._graph(), first_ns, stamp_ns, self._slam, None, quality, self._used)

    def _map_quality(self) -> Quality:
        """How well the map hangs together."""
        parts = len(self._places) - len(self._places.part(self._places.root))
        reasons = [f"degraded_sweeps:{self._degraded}"] if self._degraded else []
        reasons += [f"keyframes_not_linked:{parts}"] if parts else []
        metrics = {
            "keyframes": float(len(self._places)),
            "loops": float(self._places.loops),
            "loops_rejected": float(self._places.loops_rejected),
            "refused_loops": float(sum(self._closer.refusals.values())),
            "cloud_mb": self._places.point_bytes / 1e6,
            "way_m": self._way_m,
        }
        return Quality(Status.DEGRADED if reasons else Status.OK, tuple(reasons), CovarianceKind.FORMAL, metrics)

    def _graph(self) -> PoseGraph:
        """Places linked with the first: where the others are in the map is not known."""
        linked = self._places.part(self._places.root)
        return self._places.graph(linked, frame=self._slam, producer=self.name)

    def _first_ns(self) -> int:
        return min(f.stamp_ns for f in self._places.frames.values())

    def _newest_ns(self) -> int:
        newest = max(f.stamp_ns for f in self._places.frames.values())
        return max(newest, self._trajectory.last_ns)


def _noisy(T: UncertainTransform, tracked: Tracked) -> UncertainTransform:
    """The pose with the noise of the sweep that it was measured by."""
    return T @ UncertainTransform(np.eye(4), tracked.noise)


def _rigid(T: Float) -> Float:
    return se3.transform(se3.normalise_rotation(T[:3, :3]), T[:3, 3])
