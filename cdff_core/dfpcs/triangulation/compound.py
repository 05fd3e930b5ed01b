# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of Triangulation: sparse points from tracks or matches, dense ones from stereo pairs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import BundleProblem, DoubleSequence, LandmarkMap, Pointcloud
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud.interface import DisparityToPointCloudInputs
from cdff_core.dfns.n_view_triangulation.interface import NViewTriangulationInputs, NViewTriangulationOutputs
from cdff_core.dfpcs.triangulation.configuration import TriangulationConfig
from cdff_core.dfpcs.triangulation.interface import TriangulationInterface
from cdff_core.imaging.stereo_consistency import compile_kernels, pair_consistency

#: Minimum fraction of valid points and maximum variance of unit weight: landmarks are DEGRADED otherwise.
_MIN_VALID_FRACTION, _MAX_UNIT_VARIANCE = 0.5, 4.0
#: Minimum number of points of a stereo cloud.
_MIN_POINTS = 100


class Triangulation(TriangulationInterface):
    """Triangulation of points from images at known poses, or from a stereo pair."""

    Config = TriangulationConfig
    config: TriangulationConfig

    def setup(self) -> None:
        """Create the DFNs; offer the store items."""
        self._triangulate, self._disparity = self.dfn("triangulate"), self.dfn("disparity")
        self._depth = self.dfn("depth")
        compile_kernels()
        self._landmarks: LandmarkMap | None = None
        self._cloud: Pointcloud | None = None
        self._sigmas: DoubleSequence | None = None
        self.forget()
        self.store.offer("last_landmarks", lambda: self._landmarks)
        self.store.offer("last_cloud", lambda: self._cloud)
        self.store.offer("depth_sigmas", lambda: self._sigmas)

    def forget(self) -> None:
        """Clear matches and pose."""
        self._matches: Sample | None = None
        self._pose: Sample | None = None

    def on_tracks(self, sample: Sample) -> Iterable[Output]:
        """Triangulate all points of the tracks."""
        return self._triangulate_tracks(sample.value, sample, (sample.id,), sample.value.frame or "site")

    def on_matches(self, sample: Sample) -> Iterable[Output]:
        """Store the matches; triangulate them if there is a pose."""
        self._matches = sample
        return self._triangulate_matches()

    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Store the pose; triangulate the stored matches."""
        self._pose = sample
        return self._triangulate_matches()

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Compute the dense cloud of a stereo pair."""
        pair = sample.value
        frame = sample.frame or f"{self.context.robot}/navcam_left"
        try:
            disparity = self._disparity.process(
                DisparityImageInputs(left=pair.left, right=pair.right)
            ).disparity
            dense = self._depth.process(
                DisparityToPointCloudInputs(disparity=disparity, baseline_m=pair.baseline, left=pair.left)
            )
        except InputError as error:
            return [self._failed("cloud", sample, (sample.id,), frame, f"bad_stereo:{error}")]
        n = len(dense.points)
        if n < _MIN_POINTS:
            reason = f"few_points:{n}<{_MIN_POINTS}"
            return [self._failed("cloud", sample, (sample.id,), frame, "no_points", reason)]
        consistency = pair_consistency(pair, disparity)
        if failures := consistency.failures():
            return [self._failed("cloud", sample, (sample.id,), frame, *failures)]
        keep = slice(None, None, -(-n // self.config.max_points))
        points = dense.points[keep]
        sigma = np.hypot(dense.depth_sigma_m[keep], dense.scale_sigma * points[:, 2])
        self._cloud = Pointcloud.from_points(
            points, frame=frame, stamp_ns=sample.stamp_ns, intensity=dense.intensity[keep]
        )
        self._sigmas = DoubleSequence(sigma)
        metrics = {
            "points": len(points),
            "density": float(np.isfinite(disparity.image).mean()),
            "median_depth_sigma_m": float(np.median(sigma)),
            **consistency.metrics(),
        }
        quality = Quality.from_reasons(consistency.deficiencies(), CovarianceKind.FORMAL, metrics)
        return [self._output("cloud", sample, (sample.id,), frame, self._cloud, quality)]

    def _triangulate_matches(self) -> Iterable[Output]:
        """Triangulate the stored matches with two cameras, the first at the origin, once there is a pose."""
        if self._matches is None or self._pose is None:
            return []
        matches, pose = self._matches, self._pose
        self._matches = None
        input_ids, frame = (matches.id, pose.id), pose.value.parent_frame
        if self.config.camera is None:
            return [
                self._failed(
                    "landmarks", matches, input_ids, frame, "no_camera: configure camera = fx fy cx cy"
                )
            ]
        n = len(matches.value.items)
        pixels = np.stack([matches.value.sources_px, matches.value.sinks_px], axis=1).reshape(-1, 2)
        problem = BundleProblem.from_arrays(
            np.stack([np.eye(4), pose.value.transform.matrix]),
            self.config.camera,
            np.zeros((n, 3)),
            (np.tile([0, 1], n), np.repeat(np.arange(n), 2)),
            pixels,
            frame=frame,
        )
        return self._triangulate_tracks(problem, matches, input_ids, frame)

    def _triangulate_tracks(
        self, problem: BundleProblem, sample: Sample, input_ids: tuple[str, ...], frame: str
    ) -> Iterable[Output]:
        """Triangulate points observed by cameras with known poses; publish landmarks and their cloud."""
        try:
            triangulated = self._triangulate.process(NViewTriangulationInputs(tracks=problem))
        except InputError as error:
            return [self._failed("landmarks", sample, input_ids, frame, f"bad_input:{error}")]
        except RefusedError as refusal:
            return [self._failed("landmarks", sample, input_ids, frame, *refusal.reasons)]
        quality = self._quality(triangulated)
        valid = triangulated.valid
        counts = np.bincount(problem.observations.points, minlength=len(valid)).astype(np.uint32)
        self._landmarks = LandmarkMap.from_arrays(
            problem.points.ids[valid],
            triangulated.points[valid],
            frame=frame,
            stamp_ns=sample.stamp_ns,
            covariances=triangulated.covariances[valid],
            observations=counts[valid],
            producer=self.name,
        )
        thin = slice(None, None, max(1, -(-int(valid.sum()) // self.config.max_points)))
        self._cloud = Pointcloud.from_points(
            triangulated.points[valid][thin], frame=frame, stamp_ns=sample.stamp_ns
        )
        return [
            self._output("landmarks", sample, input_ids, frame, self._landmarks, quality),
            self._output("cloud", sample, input_ids, frame, self._cloud, quality),
        ]

    def _quality(self, triangulated: NViewTriangulationOutputs) -> Quality:
        """Return the quality from the fraction of valid points and the variance of unit weight."""
        valid, variance = triangulated.valid, triangulated.unit_variance
        reasons = []
        if valid.mean() < _MIN_VALID_FRACTION:
            reasons.append(f"few_valid:{valid.mean():.2f}<{_MIN_VALID_FRACTION:g}")
        if variance > _MAX_UNIT_VARIANCE:
            reasons.append(f"residuals_exceed_noise:{variance:.1f}>{_MAX_UNIT_VARIANCE:g}")
        metrics = {
            **self._triangulate.metrics,
            "unit_variance": variance,
            "median_angle_deg": float(np.degrees(np.median(triangulated.angles[valid]))),
            "rms_px": float(np.sqrt(np.mean(triangulated.rms_px[valid] ** 2))),
        }
        return Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)

    def _failed(
        self, port: str, sample: Sample, input_ids: tuple[str, ...], frame: str, *reasons: str
    ) -> Output:
        return self._output(port, sample, input_ids, frame, None, Quality.failed(*reasons))

    def _output(
        self, port: str, sample: Sample, input_ids: tuple[str, ...], frame: str, value: Any, quality: Quality
    ) -> Output:
        return Output(port, value, sample.stamp_ns, sample.stamp_ns, frame, None, quality, input_ids)
