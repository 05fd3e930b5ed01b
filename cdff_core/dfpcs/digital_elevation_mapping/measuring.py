# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a capture to points in the frame of the map, each with its own uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfns.disparity_image._interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud._interface import DisparityToPointCloudInputs
from cdff_core.dfns.point_cloud_deskewing._interface import PointCloudDeskewingInputs
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.patch import Measurements
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import PoseHistory

Points = NDArray[np.float64]
Stamps = NDArray[np.int64]
Node = Dfn[Any, Any, Any]

_SWEEP_RANGE_CELLS = 240
_RANGE_M = 100.0


class Measuring:
    """The DFNs between a capture and its points in the map, and the gates.

    Parameters
    ----------
    frames : FrameGraph
        Where the sensors sit on the robot.
    poses : PoseHistory
        Read, never changed.
    """

    def __init__(
        self,
        config: DigitalElevationMappingConfig,
        frames: FrameGraph,
        poses: PoseHistory,
        *,
        deskewing: Node,
        disparity: Node,
        triangulation: Node,
    ) -> None:
        self._config, self._frames, self._poses = config, frames, poses
        self._deskewing, self._disparity, self._triangulation = deskewing, disparity, triangulation
        self._last_pair: tuple[int, Points] | None = None

    def forget_last_pair(self) -> None:
        """Use the next stereo pair whenever it comes."""
        self._last_pair = None

    def as_it_is(self, sample: Sample) -> Measurements:
        """A cloud that is already in the frame of the map: no sensor, so no gate and no uncertainty of a pose."""
        given = sample.value.points_m
        finite = np.isfinite(given).all(axis=1)
        n = int(np.count_nonzero(finite))
        stamps = np.full(n, sample.stamp_ns, dtype=np.int64)
        return Measurements(
            given[finite], stamps, np.zeros(n), np.zeros(n), _brightness(sample.value.intensity, len(given))[finite],
            np.ones(n, dtype=np.bool_), sample, [], len(given), sample.value.frame,
        )  # fmt: skip

    def measure(self, sample: Sample, at_ns: int | None) -> Measurements | None:
        """Points of a capture in the frame of the map, within the gates; None for a pair that is not needed.

        Parameters
        ----------
        at_ns : int or None
            Take all points as if measured at this time instead of their own.

        Raises
        ------
        FrameNotFoundError
            If nobody says where the sensor sits on the robot.
        ExtrapolationError
            If the poses do not enclose the capture, or leave a gap in it.
        InputError
            If the capture is malformed.
        """
        T_body_sensor = self._extrinsics(sample)
        t1_ns = sample.stamp_ns if at_ns is None else at_ns
        T_map_body = self._poses.at(t1_ns)
        if sample.port == "stereo" and not self._pair_is_due(t1_ns, T_map_body):
            return None
        points, stamps, sigma_m, brightness = self._points_of(sample)
        taken = len(points)
        range_m = np.linalg.norm(points, axis=1)
        near_m, far_m = self._ranges_m(sample)
        kept = (range_m >= self._config.min_range_m) & (range_m <= far_m)  # false for NaN
        points, stamps, sigma_m, brightness, range_m = (a[kept] for a in (points, stamps, sigma_m, brightness, range_m))
        if len(points) == 0:
            none, frame = np.empty(0), self._poses.map_frame
            return Measurements(
                np.empty((0, 3)), np.empty(0, np.int64), none, none, none, none > 0, sample, [], taken, frame
            )
        pose_stamps = stamps if at_ns is None else np.full(len(points), at_ns, dtype=np.int64)
        trajectory, poses = self._poses.around(int(pose_stamps.min()), int(pose_stamps.max()))
        moved = self._deskewing.process(
            PointCloudDeskewingInputs(points=T_body_sensor.apply(points), stamps_ns=pose_stamps, trajectory=trajectory)
        )
        above_m = moved.points[:, 2] - (T_map_body @ T_body_sensor).matrix[2, 3]
        noise_m2 = (sigma_m * above_m / range_m) ** 2  # the vertical part of the noise along the ray
        shared_m2 = moved.height_variance
        if sample.port == "stereo":
            shared_m2 = shared_m2 + self._config.stereo_common**2 * noise_m2
        keep = np.ones(len(above_m), dtype=np.bool_)
        if self._config.min_height_m is not None:
            keep &= above_m >= self._config.min_height_m
        if self._config.max_height_m is not None:
            keep &= above_m <= self._config.max_height_m
        return Measurements(
            moved.points[keep], stamps[keep], shared_m2[keep], noise_m2[keep], brightness[keep],
            (range_m <= near_m)[keep], sample, poses, taken, self._poses.map_frame, T_map_body,
            (T_map_body @ T_body_sensor).matrix[:3, 3],
        )  # fmt: skip

    def _extrinsics(self, sample: Sample) -> UncertainTransform:
        """``T_body_sensor`` of the profile's frames, else as the sample states it; raises FrameNotFoundError."""
        value, body = sample.value, self._poses.body_frame
        frame = value.frame or sample.frame
        if frame == body:
            return UncertainTransform.identity()
        try:
            return self._frames.lookup(body, frame, sample.stamp_ns)
        except FrameNotFoundError:
            stated: UncertainTransform | None = None
            if sample.port == "stereo":
                stated = value.left.T_robot_sensor
            elif sample.port == "cloud":
                stated = value.T_robot_sensor
            if stated is None:
                raise
            return stated

    def _points_of(self, sample: Sample) -> tuple[Points, Stamps, Points, Points]:
        """Points ``(n, 3)`` in the sensor's frame, their stamps, noise along the ray (metres) and brightness."""
        value = sample.value
        if sample.port == "scan":
            behind_ns = (value.t1_ns - value.t0_ns) - value.time_offset_us.astype(np.int64) * 1000
            sigma_m = np.full(len(value.points_m), self._config.range_sigma_m)
            brightness = _brightness(value.intensity, len(sigma_m))
            return value.points_m.astype(np.float64), sample.stamp_ns - behind_ns, sigma_m, brightness
        if sample.port == "stereo":
            disparity = self._disparity.process(DisparityImageInputs(left=value.left, right=value.right)).disparity
            baseline_m = np.array(value.baseline, dtype=np.float64)
            seen = self._triangulation.process(DisparityToPointCloudInputs(
                disparity=disparity, baseline_m=baseline_m, left=value.left
            ))  # fmt: skip
            points, brightness = seen.points, seen.intensity.astype(np.float64)
            sigma_m = seen.depth_sigma_m * np.linalg.norm(points, axis=1) / points[:, 2]
        else:
            points = value.points_m
            sigma_m = np.full(len(points), self._config.range_sigma_m)
            brightness = _brightness(value.intensity, len(points))
        return points, np.full(len(points), sample.stamp_ns, dtype=np.int64), sigma_m, brightness

    def _ranges_m(self, sample: Sample) -> tuple[float, float]:
        """How far points go into patches, and into the far map.

        Far rings of a sweep lie many cells apart: a patch that held them would be empty for the most part.
        """
        c = self._config
        if c.max_range_m is not None:
            return c.max_range_m, c.max_range_m
        near_m = _SWEEP_RANGE_CELLS * c.resolution_m if sample.port == "scan" else _RANGE_M
        return near_m, max(near_m, min(near_m * c.far_factor, _RANGE_M))

    def _pair_is_due(self, stamp_ns: int, T_map_body: UncertainTransform) -> bool:
        position = T_map_body.matrix[:3, 3]
        if self._last_pair is not None:
            then_ns, there = self._last_pair
            waited_s, moved_m = (stamp_ns - then_ns) / 1e9, float(np.linalg.norm(position - there))
            idle = moved_m < self._config.stereo_distance_m and waited_s < self._config.stereo_period_s
            if idle or waited_s < self._config.stereo_min_period_s:
                return False
        self._last_pair = (stamp_ns, position)
        return True


def _brightness(intensity: Any, points: int) -> Points:
    """Intensity of each point, NaN where the capture has none."""
    if intensity is None or len(intensity) != points:
        return np.full(points, np.nan)
    return np.asarray(intensity, dtype=np.float64)
