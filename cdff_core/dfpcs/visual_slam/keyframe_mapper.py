# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map under construction: location of images, keyframes, loops and the trajectory."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import VisualMap
from cdff_common.types.pose_graph_ext import ODOMETRY
from cdff_core.dfpcs.visual_slam.bundle import adjust, relative_motion, window
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframe, VisualKeyframeMap
from cdff_core.dfpcs.visual_slam.loop_search import LoopSearch, VerifiedLoop
from cdff_core.dfpcs.visual_slam.point_tracker import PointTracker
from cdff_core.dfpcs.visual_slam.stereo_calibration import StereoCalibration
from cdff_core.dfpcs.visual_slam.view import CameraView
from cdff_core.dfpcs.visual_slam.view_locator import LocatedView, ViewLocator
from cdff_core.keyframe_graph.trajectory import Trajectory
from cdff_core.stereo_odometry.motion_hypotheses import MotionHypotheses
from cdff_core.visual_map.camera_pose import CameraPoseSolver
from cdff_core.visual_map.keyframe_points import MeasuredPoints
from cdff_core.visual_map.place_index import GrowingPlaceIndex

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.visual_slam.configuration import VisualSlamConfig

#: Neighbours of the current keyframe that are matched with an image.
_NEIGHBOURS = 2
#: Similar keyframes that are compared with an image that does not fit the current keyframe.
_SEARCHED = 4
#: Largest interval over which the motion is predicted, seconds.
_MAX_PREDICTION_S = 0.5
#: Correction of a pose by a loop above which the graph is optimised: in median depths, and radians.
_LARGE_CORRECTION, _LARGE_ROTATION = 0.01, 0.005
_NO_FEATURES = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Tracking:
    """Result for one image.

    Attributes
    ----------
    located : LocatedView or None
        None for the first image of a part of the map, and for a lost one.
    increment : UncertainTransform or None
        Motion since the previous image; None if it is unknown.
    is_lost : bool
    reasons : tuple of str
        Reasons against a pose.
    is_map_changed : bool
        A loop has changed the map.
    """

    located: LocatedView | None
    increment: UncertainTransform | None
    is_lost: bool = False
    reasons: tuple[str, ...] = ()
    is_map_changed: bool = False


def _pose_solver(dfpc: Dfpc, config: VisualSlamConfig, slot: str) -> CameraPoseSolver:
    """Return the solver of poses, among competing ones, with the DFN of a slot."""
    solve, solve_others = (dfpc.dfn(slot, seed=dfpc.context.seed) for _ in range(2))
    motions = MotionHypotheses(solve, solve_others)
    return CameraPoseSolver(solve, config.poses.sigma_px, config.poses.gate, motions)


class KeyframeMapper:
    """Locates images relative to keyframes, makes keyframes, and closes loops between them.

    Attributes
    ----------
    keyframes : VisualKeyframeMap
    trajectory : Trajectory
    current : int or None
        Keyframe relative to which the last image was located; None before the first image.
    T_keyframe_camera : UncertainTransform
        Pose of the last image relative to this keyframe.
    path_length_m : float
    """

    def __init__(self, dfpc: Dfpc, config: VisualSlamConfig) -> None:
        self._config = config
        self._locator = ViewLocator(dfpc.dfn("match"), _pose_solver(dfpc, config, "solve"), config.poses)
        self._tracker = PointTracker(
            dfpc.dfn("track"), _pose_solver(dfpc, config, "solve_tracked"), config.poses
        )
        self.calibration = StereoCalibration(dfpc.dfn("motion"))
        self._index = GrowingPlaceIndex(config.clusters, dfpc.context.seed)
        self.loops = LoopSearch(self._locator, self._index, config.loops)
        self._adjust, self._adjust_map = dfpc.dfn("adjust"), dfpc.dfn("adjust_map")
        self._optimiser = dfpc.dfn("optimise")
        self.clear()

    def clear(self) -> None:
        """Start with an empty map."""
        self.keyframes, self.trajectory = VisualKeyframeMap(), Trajectory()
        self._index.clear()
        self.loops.clear()
        self.current: int | None = None
        self.T_keyframe_camera = UncertainTransform.identity()
        self.path_length_m = 0.0
        self._is_lost = False
        self._tracker.clear()
        self.calibration.clear()
        self._velocity = np.zeros(6)  # of the camera in its frame, per second
        self._last_ns = 0

    @property
    def T_map_camera(self) -> UncertainTransform | None:
        """Pose of the camera in the map; None without a connection with the root."""
        if self.current is None or self.current not in self.keyframes.linked:
            return None
        return self.keyframes.pose(self.current) @ self.T_keyframe_camera

    def add_view(self, view: CameraView) -> Tracking:
        """Locate an image; make a keyframe of it and close its loops if it shows enough that is new."""
        tracked_view = self._track(view)
        try:
            is_due = tracked_view is None or self._is_keyframe_due(tracked_view)
            located_view = (
                self._locate(view, tracked_view) if tracked_view is None or is_due else tracked_view
            )
        except RefusedError as error:
            return self._start_part(view, tuple(error.reasons))
        increment = self._move_to(view, located_view)
        is_changed = False
        if located_view is not tracked_view and self._is_keyframe_due(located_view):
            is_changed = self._make_keyframe(view, located_view)
        assert self.current is not None  # the image is located
        self.trajectory.append(view.stamp_ns, self.current, self.T_keyframe_camera)
        return Tracking(located_view, increment, is_map_changed=is_changed)

    def import_map(self, message: VisualMap) -> dict[int, int]:
        """Add a map; it stays a separate part until a loop closure connects it. Return the new ids."""
        new_ids = self.keyframes.add_message(message)
        for key in new_ids.values():
            self._index.insert(key, self.keyframes.keyframes[key].points.descriptors)
        return new_ids

    def connect(self, keys: Iterable[int]) -> bool:
        """Search loops of keyframes outside the component of the root; return
        whether a loop connected them.
        """
        is_connected = False
        for key in keys:
            if key in self.keyframes.keyframes and key not in self.keyframes.linked:
                is_connected |= self._close_loops(key)
        return is_connected

    def finish(self) -> None:
        """Connect the parts of the map as far as possible, and adjust all keyframes of the root's part."""
        self.connect(sorted(set(self.keyframes.keyframes) - self.keyframes.linked))
        root = self.keyframes.root
        linked_keys = self.keyframes.linked
        if root is None or len(linked_keys) < 2:
            return
        self.keyframes.optimise(self._optimiser)
        linked_keys = self.keyframes.linked
        if len(linked_keys) <= self._config.max_adjusted:
            free = sorted(linked_keys - {root})
            adjust(self.keyframes, free, [root], self._adjust_map, self._config.poses.sigma_px)

    def points_m(self, max_sigma_ratio: float) -> FloatArray:
        """Return the points (n, 3) of the linked keyframes whose depth has at most this relative standard
        deviation.
        """
        clouds = [np.zeros((0, 3))]
        for key in sorted(self.keyframes.linked):
            points = self.keyframes.keyframes[key].points
            is_certain = points.depth_sigmas_m < max_sigma_ratio * points.positions_m[:, 2]
            clouds.append(se3.transform_points(self.keyframes.poses[key], points.positions_m[is_certain]))
        return np.concatenate(clouds)

    def _track(self, view: CameraView) -> LocatedView | None:
        """Return the pose relative to the current keyframe without descriptors; None if it is unusable."""
        if self.current is None or self._is_lost:
            return None
        interval_s = min(1e-9 * (view.stamp_ns - self._last_ns), _MAX_PREDICTION_S)
        T = self.T_keyframe_camera.matrix @ se3.exp_se3(interval_s * self._velocity)
        keyframe = self.keyframes.keyframes[self.current]
        return self._tracker.locate(view, self.current, keyframe, se3.normalise_transform(T))

    def _locate(self, view: CameraView, tracked_view: LocatedView | None) -> LocatedView:
        """Return the pose of the camera relative to the current keyframe or, if that fails, to a similar
        keyframe.
        """
        reasons: list[str] = []
        if self.current is not None:
            keys = [self.current, *self.keyframes.neighbours(self.current, _NEIGHBOURS)]
            T_guess = self.T_keyframe_camera if tracked_view is None else tracked_view.T_reference_camera
            guess = None if self._is_lost else T_guess.matrix
            try:
                return self._locator.locate(
                    view.features, view.focal_px, self.keyframes, keys, guess, shape=view.shape
                )
            except RefusedError as error:
                reasons = list(error.reasons)
        limit = self._config.loops.min_inliers
        for key in self._index.nearest(view.features.descriptors, _SEARCHED):
            keys = [key, *self.keyframes.neighbours(key, 1)]
            with suppress(RefusedError):
                return self._locator.locate(
                    view.features,
                    view.focal_px,
                    self.keyframes,
                    keys,
                    min_inliers=limit,
                    shape=view.shape,
                )
        raise RefusedError("the image fits no keyframe", reasons)

    def _move_to(self, view: CameraView, located_view: LocatedView) -> UncertainTransform | None:
        """Set the pose of the camera; return the motion since the previous image if it is known."""
        keyframes, previous = self.keyframes, self.current
        increment: UncertainTransform | None = None
        if previous is None:
            increment = UncertainTransform.identity()
        elif located_view.reference in keyframes.component(previous):
            T_reference_previous = (
                se3.inverse(keyframes.poses[located_view.reference]) @ keyframes.poses[previous]
            )
            T_previous = se3.normalise_transform(T_reference_previous @ self.T_keyframe_camera.matrix)
            T = se3.normalise_transform(se3.inverse(T_previous) @ located_view.T_reference_camera.matrix)
            covariance = located_view.T_reference_camera.covariance
            assert covariance is not None  # a located view has one
            R = T_previous[:3, :3].T
            rotation = np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])
            increment = UncertainTransform(T, rotation @ covariance @ rotation.T)
            self.path_length_m += float(np.linalg.norm(T[:3, 3]))
            self._velocity = se3.log_se3(T) / max(1e-9 * (view.stamp_ns - self._last_ns), 1e-3)
        self._last_ns = view.stamp_ns
        best = max(located_view.shared, key=lambda k: (len(located_view.shared[k][0]), -k))
        T_best_reference = se3.normalise_transform(
            se3.inverse(keyframes.poses[best]) @ keyframes.poses[located_view.reference]
        )
        self.current = best
        self.T_keyframe_camera = UncertainTransform.exact(T_best_reference) @ located_view.T_reference_camera
        self._is_lost = False
        return increment

    def _is_keyframe_due(self, located_view: LocatedView) -> bool:
        """Return whether overlap, translation or rotation since the current keyframe require a new one."""
        assert self.current is not None  # the image is located
        keyframe, limits = self.keyframes.keyframes[self.current], self._config.keyframes
        T = self.T_keyframe_camera.matrix
        return (
            located_view.overlap(len(keyframe.points)) < limits.overlap
            or float(np.linalg.norm(T[:3, 3])) > limits.translation_ratio * keyframe.median_depth_m
            or float(se3.rotation_angle(T[:3, :3])) > np.radians(limits.rotation_deg)
        )

    def _measure_points(self, view: CameraView, foreign: IntArray = _NO_FEATURES) -> MeasuredPoints | None:
        """Return the points of an image; None if there are too few for a keyframe.

        Points of ``foreign (k,)``, rows of features that follow another motion, are omitted.
        """
        measured_points = view.measured.without(foreign) if len(foreign) else view.measured
        is_usable = len(measured_points.points) >= self._config.keyframes.min_points
        return measured_points if is_usable else None

    def _start_part(self, view: CameraView, reasons: tuple[str, ...]) -> Tracking:
        """Start a separate part of the map, or the map, with an image; too few points are refused."""
        measured_points = self._measure_points(view)
        is_first = self.current is None
        if measured_points is None:
            if is_first:
                raise RefusedError(
                    "too few features with a depth to start a map",
                    [f"few_points:{len(view.measured.points)}<{self._config.keyframes.min_points}"],
                )
            self._is_lost = True
            return Tracking(None, None, is_lost=True, reasons=reasons)
        pose = np.eye(4)
        if self.current is not None:
            pose = self.keyframes.poses[self.current] @ self.T_keyframe_camera.matrix
        keyframe = self._keyframe(view, measured_points)
        self.current = self.keyframes.insert_component(keyframe, pose)
        self.T_keyframe_camera = UncertainTransform.identity()
        self._is_lost = False
        self._index.insert(self.current, keyframe.points.descriptors)
        self._tracker.start(self.current, view, measured_points.features)
        self._velocity, self._last_ns = np.zeros(6), view.stamp_ns
        self.trajectory.append(view.stamp_ns, self.current, self.T_keyframe_camera)
        return Tracking(None, None, is_lost=not is_first, reasons=reasons)

    def _make_keyframe(self, view: CameraView, located_view: LocatedView) -> bool:
        """Make a keyframe of a located image, adjust it and close its loops; return whether a loop was
        found.
        """
        assert self.current is not None  # the image is located
        measured_points = self._measure_points(view, located_view.foreign)
        if measured_points is None:
            return False
        keyframe = self._keyframe(view, measured_points)
        key = self.keyframes.insert_successor(self.current, keyframe, self.T_keyframe_camera)
        row_of_feature = np.full(len(view.features), -1)
        row_of_feature[measured_points.features] = np.arange(len(measured_points.features))
        for other, (features, rows) in located_view.shared.items():
            mine = row_of_feature[features]
            self.keyframes.link(other, key, rows[mine >= 0], mine[mine >= 0])
        self._refine_motion(self.current, key)
        self.current, self.T_keyframe_camera = key, UncertainTransform.identity()
        is_changed = self._close_loops(key)
        if self.current == key:
            self._index.insert(key, keyframe.points.descriptors)
            self._tracker.start(key, view, measured_points.features)
            self._adjust_around(key)
        self._limit_count()
        return is_changed

    def _keyframe(self, view: CameraView, measured: MeasuredPoints) -> VisualKeyframe:
        """Return the keyframe of an image, with the estimated errors of the rectification corrected."""
        keyframe = VisualKeyframe.of_points(view.stamp_ns, measured.points, view.focal_px, measured.stereo)
        return self.calibration.keyframe(keyframe, self.keyframes)

    def _refine_motion(self, reference: int, key: int) -> None:
        """Refine the pose of a new keyframe with the disparities of both keyframes."""
        guess = self.T_keyframe_camera.matrix
        T = self.calibration.motion(self.keyframes, reference, key, guess, is_estimated=True)
        if T is not None:
            self.keyframes.edges[reference, key, ODOMETRY] = T
            pose = self.keyframes.pose(reference) @ T
            assert pose.covariance is not None  # both factors have one
            self.keyframes.poses[key], self.keyframes.covariances[key] = pose.matrix, pose.covariance

    def _adjust_around(self, key: int) -> None:
        free, fixed = window(self.keyframes, key, self._config.window)
        adjust(self.keyframes, free, fixed, self._adjust, self._config.poses.sigma_px)

    def _close_loops(self, key: int) -> bool:
        """Add the verified loops of a keyframe; return whether one connected or clearly changed the map."""
        is_changed = False
        for loop in self.loops.of_keyframe(self.keyframes, key):
            is_changed |= self._add_loop(loop)
        if is_changed and key in self.keyframes.linked:
            self.keyframes.optimise(self._optimiser)
        older = self._older_copy(key)
        if older is not None:
            self._replace(key, older)
        return is_changed

    def _add_loop(self, loop: VerifiedLoop) -> bool:
        """Add a loop; return whether it connects two parts or corrects the graph clearly."""
        keyframes, old, new = self.keyframes, loop.old, loop.new
        is_connected = new in keyframes.component(old)
        T_graph = se3.inverse(keyframes.poses[old]) @ keyframes.poses[new]
        distance_m, angle = relative_motion(T_graph, loop.T.matrix)
        keyframes.link(old, new, loop.rows_old, loop.rows_new)
        refined_motion = self.calibration.motion(keyframes, old, new, loop.T.matrix, is_estimated=False)
        keyframes.add_loop(old, new, loop.T if refined_motion is None else refined_motion)
        depth_m = keyframes.keyframes[old].median_depth_m
        return not is_connected or distance_m > _LARGE_CORRECTION * depth_m or angle > _LARGE_ROTATION

    def _older_copy(self, key: int) -> int | None:
        """Return an older linked keyframe at almost the same pose; None without one."""
        keyframes, limits = self.keyframes, self._config.keyframes
        for other in keyframes.linked_with(key):
            distance_m, angle = relative_motion(keyframes.poses[other], keyframes.poses[key])
            is_near = distance_m < limits.merge_ratio * keyframes.keyframes[other].median_depth_m
            if is_near and angle < np.radians(0.3 * limits.rotation_deg) and key != keyframes.root:
                return other
        return None

    def _replace(self, key: int, older: int) -> None:
        """Replace a keyframe by an older, linked one in graph, index and trajectory."""
        keyframes = self.keyframes
        T = se3.normalise_transform(se3.inverse(keyframes.poses[older]) @ keyframes.poses[key])
        T_older_key = UncertainTransform(T, keyframes.edge_covariance(older, key))
        if key in self._index:
            self._index.remove(key)
        keyframes.replace_by(key, older, T_older_key)
        self.trajectory.move(key, older, T)
        if self.current == key:
            self.current, self.T_keyframe_camera = older, T_older_key @ self.T_keyframe_camera

    def _limit_count(self) -> None:
        """Merge the two nearest linked keyframes if there are too many."""
        keyframes = self.keyframes
        if len(keyframes) <= self._config.keyframes.max_count:
            return
        candidates: Collection[tuple[int, int]] = [
            (min(a, b), max(a, b)) for a, b in keyframes.links if keyframes.root != max(a, b) != self.current
        ]
        if not candidates:
            return

        def size(pair: tuple[int, int]) -> float:
            older, newer = pair
            distance_m, angle = relative_motion(keyframes.poses[older], keyframes.poses[newer])
            return distance_m / keyframes.keyframes[older].median_depth_m + angle

        older, newer = min(candidates, key=size)
        self._replace(newer, older)
