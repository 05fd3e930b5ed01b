# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Projection of captures into the frame of the map, with a variance for each point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, RefusedError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud.interface import DisparityToPointCloudInputs
from cdff_core.dfns.point_cloud_deskewing.interface import PointCloudDeskewingInputs
from cdff_core.dfpcs.digital_elevation_mapping.configuration import DigitalElevationMappingConfig
from cdff_core.dfpcs.digital_elevation_mapping.patch import CapturePoints
from cdff_core.dfpcs.digital_elevation_mapping.pose_history import PoseHistory
from cdff_core.dfpcs.digital_elevation_mapping.stereo_pair_gate import StereoPairGate
from cdff_core.imaging.stereo_consistency import compile_kernels, pair_consistency

Points = NDArray[np.float64]
Stamps = NDArray[np.int64]

#: Default range of points in a patch: in cells for a sweep, in metres for clouds and stereo pairs.
_SWEEP_RANGE_CELLS = 240
_RANGE_M = 100.0
#: Fraction of the standard deviation of a disparity that is common to neighbouring disparities.
_STEREO_COMMON = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoints:
    """Points of a capture in the frame of its sensor."""

    points_m: Points  # (n, 3)
    stamps_ns: Stamps  # (n,)
    sigma_m: Points  # (n,), standard deviation of the noise along the ray
    intensity: Points  # (n,)
    scale_sigma: float = 0.0  # standard deviation of the relative error that all distances share
    notes: tuple[str, ...] = ()  # reasons for DEGRADED


class CaptureProjector:
    """Projects captures into the map (deskewing, disparity, triangulation) and applies the gates."""

    def __init__(
        self,
        config: DigitalElevationMappingConfig,
        frames: FrameGraph,
        poses: PoseHistory,
        dfn: Callable[[str], Dfn[Any, Any, Any]],
    ) -> None:
        self._config, self._frames, self._poses = config, frames, poses
        self._deskewing, self._disparity = dfn("deskewing"), dfn("disparity")
        self._triangulation = dfn("triangulation")
        self.pairs = StereoPairGate(config)
        compile_kernels()

    def without_pose(self, sample: Sample) -> CapturePoints:
        """Return the points of a cloud in the map's frame, without gates and without pose variance."""
        points = sample.value.points_m
        finite = np.isfinite(points).all(axis=1)
        n = int(np.count_nonzero(finite))
        return CapturePoints(
            points_m=points[finite],
            stamps_ns=np.full(n, sample.stamp_ns, dtype=np.int64),
            pose_variance_m2=np.zeros(n),
            noise_variance_m2=np.zeros(n),
            intensity=_intensity(sample.value.intensity, len(points))[finite],
            near=np.ones(n, dtype=np.bool_),
            sample=sample,
            poses=[],
            raw_points=len(points),
            frame=sample.value.frame,
        )

    def project(self, sample: Sample, single_pose_ns: int | None) -> CapturePoints | None:
        """Return the points of a capture in the map within the gates; None for a skipped stereo pair.

        With ``single_pose_ns``, the pose of this time is used for all points. Raises FrameNotFoundError if
        the mount of the sensor is unknown, ExtrapolationError if the poses do not enclose the capture or
        leave a gap in it, InputError if it is malformed, RefusedError if the images of a pair do not show
        the same scene.
        """
        c, T_body_sensor = self._config, self._extrinsics(sample)
        t1_ns = sample.stamp_ns if single_pose_ns is None else single_pose_ns
        T_map_body = self._poses.at(t1_ns)
        if sample.port == "stereo" and not self.pairs.is_due(t1_ns, T_map_body.matrix[:3, 3]):
            return None
        sensor_points = self._sensor_points(sample)
        raw_points = len(sensor_points.points_m)
        range_m = np.linalg.norm(sensor_points.points_m, axis=1)
        near_m, far_m = self._ranges_m(sample)
        in_range = (range_m >= c.min_range_m) & (range_m <= far_m)  # false for NaN
        points, stamps, sigma_m, intensity, range_m = (
            a[in_range]
            for a in (
                sensor_points.points_m,
                sensor_points.stamps_ns,
                sensor_points.sigma_m,
                sensor_points.intensity,
                range_m,
            )
        )
        if len(points) == 0:
            empty, frame = np.empty(0), self._poses.map_frame
            return CapturePoints(
                points_m=points,
                stamps_ns=stamps,
                pose_variance_m2=empty,
                noise_variance_m2=empty,
                intensity=empty,
                near=empty > 0,
                sample=sample,
                poses=[],
                raw_points=raw_points,
                frame=frame,
            )
        pose_stamps = (
            stamps if single_pose_ns is None else np.full(len(points), single_pose_ns, dtype=np.int64)
        )
        poses = self._poses.around(int(pose_stamps.min()), int(pose_stamps.max()))
        deskewed = self._deskewing.process(
            PointCloudDeskewingInputs(
                points=T_body_sensor.apply(points),
                stamps_ns=pose_stamps,
                pose_stamps_ns=np.array([p.stamp_ns for p in poses], dtype=np.int64),
                poses=np.array([p.value.transform.matrix for p in poses]),
                pose_covariances=_covariances(poses),
            )
        )
        origin_m = (T_map_body @ T_body_sensor).matrix[:3, 3]
        above_m = deskewed.points[:, 2] - origin_m[2]
        noise_m2 = (sigma_m * above_m / range_m) ** 2  # vertical part of the noise along the ray
        pose_m2 = deskewed.height_variance
        if sample.port == "stereo":
            pose_m2 = pose_m2 + _STEREO_COMMON**2 * noise_m2 + (sensor_points.scale_sigma * above_m) ** 2
        lowest_m = -np.inf if c.min_height_m is None else c.min_height_m
        highest_m = np.inf if c.max_height_m is None else c.max_height_m
        keep = (above_m >= lowest_m) & (above_m <= highest_m)
        return CapturePoints(
            points_m=deskewed.points[keep],
            stamps_ns=stamps[keep],
            pose_variance_m2=pose_m2[keep],
            noise_variance_m2=noise_m2[keep],
            intensity=intensity[keep],
            near=(range_m <= near_m)[keep],
            sample=sample,
            poses=poses,
            raw_points=raw_points,
            frame=self._poses.map_frame,
            pose=T_map_body,
            origin_m=origin_m,
            notes=sensor_points.notes,
        )

    def _extrinsics(self, sample: Sample) -> UncertainTransform:
        """Return ``T_body_sensor`` of the profile's frames, else of the sample; raises FrameNotFoundError."""
        value, body = sample.value, self._poses.body_frame
        frame = value.frame or sample.frame
        if frame == body:
            return UncertainTransform.identity()
        try:
            return self._frames.lookup(body, frame, sample.stamp_ns)
        except FrameNotFoundError:
            if sample.port == "scan":
                raise
            source = value.left if sample.port == "stereo" else value
            T_robot_sensor: UncertainTransform | None = source.T_robot_sensor
            if T_robot_sensor is None:
                raise
            return T_robot_sensor

    def _sensor_points(self, sample: Sample) -> SensorPoints:
        """Return the points of a capture; raises RefusedError if the images
        of a pair show different scenes.
        """
        value = sample.value
        if sample.port == "scan":
            age_ns = (value.t1_ns - value.t0_ns) - value.time_offset_us.astype(np.int64) * 1000
            sigma_m = np.full(len(value.points_m), self._config.range_sigma_m)
            intensity = _intensity(value.intensity, len(sigma_m))
            return SensorPoints(
                value.points_m.astype(np.float64), sample.stamp_ns - age_ns, sigma_m, intensity
            )
        if sample.port == "stereo":
            return self._stereo_points(sample)
        points = value.points_m
        sigma_m = np.full(len(points), self._config.range_sigma_m)
        stamps = np.full(len(points), sample.stamp_ns, dtype=np.int64)
        return SensorPoints(points, stamps, sigma_m, _intensity(value.intensity, len(points)))

    def _stereo_points(self, sample: Sample) -> SensorPoints:
        """Return the points of a stereo pair, whose disparities are tested at the corners of the image."""
        pair = sample.value
        disparity = self._disparity.process(DisparityImageInputs(left=pair.left, right=pair.right)).disparity
        cloud = self._triangulation.process(
            DisparityToPointCloudInputs(disparity=disparity, baseline_m=pair.baseline, left=pair.left)
        )
        consistency = pair_consistency(pair, disparity)
        if failures := consistency.failures():
            raise RefusedError(f"stereo pair: {', '.join(failures)}", failures)
        points = cloud.points
        return SensorPoints(
            points,
            np.full(len(points), sample.stamp_ns, dtype=np.int64),
            cloud.depth_sigma_m * np.linalg.norm(points, axis=1) / points[:, 2],
            cloud.intensity.astype(np.float64),
            cloud.scale_sigma,
            tuple(consistency.deficiencies()),
        )

    def _ranges_m(self, sample: Sample) -> tuple[float, float]:
        """Return the maximum range of points of a patch, and of points of the far map.

        Distant rings of a sweep are many cells apart: a patch with them would consist mostly of gaps.
        """
        c = self._config
        if c.max_range_m is not None:
            return c.max_range_m, c.max_range_m
        near_m = _SWEEP_RANGE_CELLS * c.resolution_m if sample.port == "scan" else _RANGE_M
        return near_m, max(near_m, min(near_m * c.far_factor, _RANGE_M))


def _covariances(poses: list[Sample]) -> NDArray[np.float64] | None:
    """Return the covariances ``(n, 6, 6)`` of poses; None if one of them has no covariance."""
    covariances = [p.value.transform.covariance for p in poses]
    return None if any(c is None for c in covariances) else np.array(covariances)


def _intensity(intensity: Any, points: int) -> Points:
    """Return the intensity of each point; NaN if intensities are missing or malformed."""
    if intensity is None or len(intensity) != points:
        return np.full(points, np.nan)
    return np.asarray(intensity, dtype=np.float64)
