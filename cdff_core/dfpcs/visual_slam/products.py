# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of VisualSlam with their quality."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import Pointcloud, VisualMap
from cdff_core.dfpcs.visual_slam.keyframe_mapper import KeyframeMapper, Tracking
from cdff_core.dfpcs.visual_slam.view import CameraView
from cdff_core.keyframe_graph.products import GraphProducts

#: Largest relative standard deviation of the depth of a point of the cloud, and largest number of points.
_MAX_SIGMA_RATIO, _MAX_CLOUD = 0.05, 100_000


class ProductBuilder(GraphProducts[KeyframeMapper]):
    """Builds the outputs, in the frames ``{robot}/visual_slam``, ``{robot}/visual_odom`` and the camera's."""

    def __init__(self, producer: str, robot: str, mapper: KeyframeMapper) -> None:
        super().__init__(producer, f"{robot}/visual_slam", mapper)
        self._robot = robot
        self._odom_frame = f"{robot}/visual_odom"
        self._odometry = UncertainTransform.identity()
        self._lost_images = 0
        self._inputs: tuple[str, ...] = ()
        self._camera_frame = f"{self._robot}/camera"

    @property
    def sensor_frame(self) -> str:
        """Frame of the camera."""
        return self._camera_frame

    @property
    def inputs(self) -> tuple[str, ...]:
        """Ids of the newest images."""
        return self._inputs

    def poses(self, view: CameraView, tracking: Tracking) -> Iterator[Output]:
        """Yield odometry and pose of the camera at an image."""
        self._inputs = view.inputs
        self._camera_frame = view.frame or self._camera_frame
        metrics = {} if tracking.located is None else tracking.located.metrics()
        reasons = [] if tracking.located is None else tracking.located.reasons()
        metrics |= {
            "keyframes": float(len(self._mapper.keyframes)),
            "path_length_m": self._mapper.path_length_m,
        }
        self._lost_images += tracking.is_lost
        is_first = tracking.located is None and not tracking.is_lost
        if tracking.increment is not None:
            self._odometry = self._odometry @ tracking.increment
        if tracking.increment is None and not is_first:
            failed = Quality.failed("lost", *tracking.reasons, metrics=metrics)
            yield self._pose("odometry", self._odom_frame, None, view.stamp_ns, failed)
        else:
            quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)
            yield self._pose("odometry", self._odom_frame, self._odometry, view.stamp_ns, quality)
        T_map_camera = None if tracking.is_lost else self._mapper.T_map_camera
        if T_map_camera is None:
            reason = "lost" if tracking.is_lost else "not_localised_in_map"
            failed = Quality.failed(reason, *tracking.reasons, metrics=metrics)
            yield self._pose("pose", self._map_frame, None, view.stamp_ns, failed)
        else:
            quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)
            yield self._pose("pose", self._map_frame, T_map_camera, view.stamp_ns, quality)

    def refused(self, stamp_ns: int, inputs: tuple[str, ...], quality: Quality) -> Iterator[Output]:
        """Yield FAILED outputs for images that cannot be used."""
        self._inputs = inputs
        yield self._pose("odometry", self._odom_frame, None, stamp_ns, quality)
        yield self._pose("pose", self._map_frame, None, stamp_ns, quality)

    def final(self) -> Iterator[Output]:
        """Yield trajectory, graph, cloud and map."""
        yield from self.reports()
        mapper, quality = self._mapper, self.map_quality()
        for port, value in (("cloud", self.cloud()), ("map", self.visual_map())):
            yield Output(
                port, value, mapper.keyframes.first_ns, self.newest_ns, self._map_frame, None, quality
            )

    def cloud(self) -> Pointcloud:
        """Return the points of the map; raises ProductNotFoundError without a map."""
        self.require_map()
        points_m = self._mapper.points_m(_MAX_SIGMA_RATIO)
        step = -(-len(points_m) // _MAX_CLOUD) or 1
        return Pointcloud.from_points(
            np.ascontiguousarray(points_m[::step]), frame=self._map_frame, stamp_ns=self.newest_ns
        )

    def visual_map(self) -> VisualMap:
        """Return the keyframes connected with the first one; raises ProductNotFoundError without a map."""
        self.require_map()
        return self._mapper.keyframes.to_message(
            self._mapper.keyframes.linked,
            frame=self._map_frame,
            sensor=self._camera_frame,
            producer=self._producer,
        )

    def map_quality(self) -> Quality:
        """Return the quality of the map: lost images and keyframes that are not linked."""
        keyframes = self._mapper.keyframes
        unlinked = len(keyframes) - len(self._mapper.keyframes.linked)
        reasons = [f"lost_images:{self._lost_images}"] if self._lost_images else []
        reasons += [f"keyframes_not_linked:{unlinked}"] if unlinked else []
        metrics = {
            "keyframes": float(len(keyframes)),
            "loops": float(keyframes.loop_count),
            "loops_rejected": float(keyframes.loops_rejected),
            "refused_loops": float(self._mapper.loops.refusals.total()),
            "path_length_m": self._mapper.path_length_m,
            **self._mapper.calibration.metrics(),
        }
        return Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)

    def _pose(
        self, port: str, parent: str, T: UncertainTransform | None, stamp_ns: int, quality: Quality
    ) -> Output:
        """Return a pose of the camera as an output; ``T`` is None for FAILED."""
        return Output.of_pose(
            port,
            T,
            stamp_ns=stamp_ns,
            frame=parent,
            child=self._camera_frame,
            quality=quality,
            inputs=self._inputs,
            producer=self._producer,
        )
