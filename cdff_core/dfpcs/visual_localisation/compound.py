# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualLocalisation: search keyframes, match their points, estimate the pose, decide."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import Frame, FramePair, Pointcloud, TransformWithCovariance
from cdff_core.dfpcs.visual_localisation.configuration import VisualLocalisationConfig
from cdff_core.dfpcs.visual_localisation.interface import VisualLocalisationInterface
from cdff_core.dfpcs.visual_localisation.map_matcher import MapMatcher
from cdff_core.imaging.frames import check_principal_point
from cdff_core.imaging.grey import checked_image, grey_image
from cdff_core.visual_map.camera_order import check_camera_order
from cdff_core.visual_map.camera_pose import CameraPose, CameraPoseSolver
from cdff_core.visual_map.features import FeatureExtractor
from cdff_core.visual_map.focal_length import FocalMonitor, FocalRatio, fit_focal_ratio
from cdff_core.visual_map.matches import MAP_FOCAL_PX, MapMatches
from cdff_core.visual_map.pose_fit import PoseFit

#: Largest number of images that wait for a map, and of points of the cloud in the store.
_MAX_WAITING, _MAX_CLOUD = 16, 100_000


class VisualLocalisation(VisualLocalisationInterface):
    """Localisation of each image in the map."""

    Config = VisualLocalisationConfig
    config: VisualLocalisationConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._extractor = FeatureExtractor(self.dfn("detect"), self.dfn("describe"))
        self._match, self._stereo = self.dfn("match"), self.dfn("disparity")
        self._pose_solver = CameraPoseSolver(
            self.dfn("solve", seed=self.context.seed), self.config.sigma_px, self.config.gate
        )
        self._focal_monitor = FocalMonitor(self.config.max_focal_error)
        self._waiting: list[Sample] = []
        self._last: TransformWithCovariance | None = None
        self.forget_map()
        self.store.offer("last_pose", lambda: self._last)
        self.store.offer("map_points", self._map_points)

    def forget_map(self) -> None:
        """Clear the map."""
        self._map: MapMatcher | None = None
        self._focal_monitor.clear()
        self._map_id = ""

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Replace the map; locate the images that waited for it."""
        cfg = self.config
        self._focal_monitor.clear()
        self._map = MapMatcher(
            sample.value, self._match, cfg.clusters, cfg.sigma_px / MAP_FOCAL_PX, self.context.seed
        )
        self._map_id = sample.id
        waiting, self._waiting = self._waiting, []
        return [self._localise(image) for image in waiting]

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Locate the image; without a map it waits."""
        if self._map is None:
            self._waiting = [*self._waiting, sample][-_MAX_WAITING:]
            return ()
        return [self._localise(sample)]

    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Locate the left image; the right one only shows whether the cameras are swapped."""
        return self.on_image(sample)

    def finish(self) -> Iterable[Output]:
        """Return FAILED no_map for the images that still wait."""
        waiting, self._waiting = self._waiting, []
        return [self._output(sample, None, Quality.failed("no_map")) for sample in waiting]

    def _localise(self, sample: Sample) -> Output:
        """Run the control sequence for one image."""
        metrics: dict[str, float] = {}
        try:
            pose, reasons = self._estimate(sample.value, metrics)
            quality = Quality.from_reasons(reasons, self.covariance_kind, metrics)
        except (InputError, RefusedError) as error:
            pose, quality = None, Quality.from_error(error, metrics)
            if isinstance(error, RefusedError) and not quality.reasons[0].startswith("cameras_swapped"):
                quality = Quality.failed("not_on_the_map", *quality.reasons, metrics=metrics)
        return self._output(sample, pose, quality)

    def _estimate(
        self, value: Frame | FramePair, metrics: dict[str, float]
    ) -> tuple[UncertainTransform, list[str]]:
        """Return T_map_camera and its deficiencies; raises RefusedError with the reasons against it."""
        assert self._map is not None
        cfg = self.config
        frame = _left(value)
        camera = CameraModel.of_frame(frame)
        check_principal_point(frame)
        grey = checked_image(grey_image(frame))
        features = self._extractor.extract(grey, camera)
        if isinstance(value, FramePair):
            check_camera_order(grey, grey_image(value.right), features.pixels, self._stereo)
        matches = self._map.match(features, cfg.candidates)
        metrics |= {"features": float(len(features)), "matches": float(len(matches))}
        focal_px = float(np.sqrt(camera.fx * camera.fy))
        camera_pose = self._pose_solver.solve(features, matches, focal_px)
        fit, inliers, ratio = camera_pose.fit, camera_pose.inliers, camera_pose.inlier_ratio
        metrics |= {"inliers": float(inliers), "inlier_ratio": ratio, "variance_factor": fit.variance_factor}
        pose = self._with_map_covariance(camera_pose, matches)
        assert pose.covariance is not None
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1]))
        reasons = []
        if inliers < cfg.min_inliers:
            reasons.append(f"few_inliers:{inliers}<{cfg.min_inliers}")
        if ratio < cfg.min_inlier_ratio:
            reasons.append(f"low_inlier_ratio:{ratio:.2f}<{cfg.min_inlier_ratio}")
        if sigma_m > cfg.max_sigma_m:
            reasons.append(f"large_covariance:{sigma_m:.2g}>{cfg.max_sigma_m}")
        if reasons:
            raise RefusedError("the image does not fit the map", reasons)
        directions = features.directions[matches.features]
        return pose, self._focal_length_reasons(fit, matches, directions, focal_px, metrics)

    def _focal_length_reasons(
        self,
        fit: PoseFit,
        matches: MapMatches,
        directions: FloatArray,
        focal_px: float,
        metrics: dict[str, float],
    ) -> list[str]:
        """Return a reason if the matches contradict the stated focal length, else nothing."""
        cfg = self.config
        ratio = fit_focal_ratio(
            fit.T_camera_map,
            matches.points_m,
            matches.covariances,
            directions,
            cfg.sigma_px / focal_px,
            cfg.gate,
        )
        if ratio is None:
            return []
        sigma = ratio.sigma * float(np.sqrt(cfg.correlation * max(fit.variance_factor, 1.0)))
        metrics |= {"focal_length_ratio": ratio.value, "focal_length_ratio_sigma": sigma}
        estimate_px = self._focal_monitor.estimate_px(focal_px, FocalRatio(ratio.value, sigma))
        return [] if estimate_px is None else [f"focal_length:{estimate_px:.4g}!={focal_px:.4g}"]

    def _with_map_covariance(self, camera_pose: CameraPose, matches: MapMatches) -> UncertainTransform:
        """Return T_map_camera with the covariance of the fit and of the poses of the matched keyframes."""
        assert self._map is not None
        pose = camera_pose.transform(self.config.correlation)
        T, covariance = pose.matrix, pose.covariance
        assert covariance is not None
        vertices, counts = np.unique(matches.vertices[camera_pose.fit.inliers], return_counts=True)
        for vertex, weight in zip(vertices, counts / max(int(counts.sum()), 1), strict=True):
            covariance = covariance + weight * self._covariance_from_keyframe(int(vertex), T)
        return UncertainTransform(T, covariance)

    def _covariance_from_keyframe(self, vertex: int, T_map_camera: FloatArray) -> FloatArray:
        """Return the covariance of T_map_camera due to the covariance of a keyframe."""
        assert self._map is not None
        T_map_keyframe = self._map.poses[vertex]
        T_keyframe_camera = se3.inverse(T_map_keyframe) @ T_map_camera
        return compose_covariance(
            T_map_keyframe, self._map.pose_covariances[vertex], T_keyframe_camera, np.zeros((6, 6))
        )

    def _output(self, sample: Sample, pose: UncertainTransform | None, quality: Quality) -> Output:
        """Return the pose as an output, and store it if there is one."""
        output = Output.of_pose(
            "pose",
            pose,
            stamp_ns=sample.stamp_ns,
            frame="map" if self._map is None else self._map.frame,
            child=_left(sample.value).frame or f"{self.context.robot}/camera",
            quality=quality,
            inputs=(self._map_id, sample.id),
            producer=self.name,
        )
        self._last = output.value or self._last
        return output

    def _map_points(self) -> Pointcloud | None:
        if self._map is None:
            return None
        step = -(-len(self._map.points_m) // _MAX_CLOUD) or 1
        return Pointcloud.from_points(self._map.points_m[::step], frame=self._map.frame, stamp_ns=0)


def _left(value: Frame | FramePair) -> Frame:
    """Return the image that is located."""
    return value.left if isinstance(value, FramePair) else value
