# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of Triangulation: sparse points from tracks or matches, dense ones from stereo pairs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import BundleProblem, DoubleSequence, LandmarkMap, Pointcloud
from cdff_core.dfns.disparity_image._interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud._interface import DisparityToPointCloudInputs
from cdff_core.dfns.n_view_triangulation._interface import NViewTriangulationInputs, NViewTriangulationOutputs
from cdff_core.dfpcs.triangulation._interface import TriangulationInterface


class TriangulationConfig(DfpcConfig):
    """Parameters of the DFNs, the camera of matches, and when an answer is to be taken with care."""

    triangulate: dict[str, Any] = Field({}, description="Of NViewTriangulation")
    disparity: dict[str, Any] = Field({}, description="Of DisparityImage")
    depth: dict[str, Any] = Field({}, description="Of DisparityToPointCloud")
    camera: tuple[float, float, float, float] | None = Field(
        None, description="fx fy cx cy of the camera of matches, pixels"
    )
    min_valid_share: float = Field(0.5, ge=0, le=1, description="Share of points below which landmarks are DEGRADED")
    max_unit_variance: float = Field(4.0, gt=0, description="Variance of unit weight above which they are DEGRADED")
    min_points: Annotated[int, Field(ge=1)] = Field(100, description="Points of a stereo cloud below which it FAILED")
    max_points: Annotated[int, Field(ge=1, le=400_000)] = Field(400_000, description="Points of a cloud at most")


class Triangulation(TriangulationInterface):
    """Points in space from images."""

    Config: ClassVar[type[DfpcConfig]] = TriangulationConfig

    config: TriangulationConfig

    def setup(self) -> None:
        """Make the DFNs, forget everything, offer the store's items."""
        self._triangulate, self._disparity = self.dfn("triangulate"), self.dfn("disparity")
        self._depth = self.dfn("depth")
        self._landmarks: LandmarkMap | None = None
        self._cloud: Pointcloud | None = None
        self._sigmas: DoubleSequence | None = None
        self.forget()
        self.store.offer("last_landmarks", lambda: self._landmarks)
        self.store.offer("last_cloud", lambda: self._cloud)
        self.store.offer("depth_sigmas", lambda: self._sigmas)

    def forget(self) -> None:
        """Forget matches and pose."""
        self._matches: Sample | None = None
        self._pose: Sample | None = None

    def on_tracks(self, sample: Sample) -> Iterable[Output]:
        """Triangulate all points of the tracks."""
        return self._sparse(sample.value, sample, (sample.id,), sample.value.frame or "site")

    def on_matches(self, sample: Sample) -> Iterable[Output]:
        """Keep the matches; triangulate them where the pose is there."""
        self._matches = sample
        return self._two_views()

    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Keep the pose; triangulate the matches that wait for one."""
        self._pose = sample
        return self._two_views()

    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Make the dense cloud of a pair."""
        pair = sample.value
        frame = sample.frame or f"{self.context.robot}/navcam_left"
        try:
            disparity = self._disparity.process(DisparityImageInputs(pair.left, pair.right)).disparity
            made = self._depth.process(DisparityToPointCloudInputs(disparity, np.array(pair.baseline), pair.left))
        except InputError as error:
            return [self._failed("cloud", sample, (sample.id,), frame, f"bad_stereo:{error}")]
        n = len(made.points)
        if n < self.config.min_points:
            reason = f"few_points:{n}<{self.config.min_points}"
            return [self._failed("cloud", sample, (sample.id,), frame, "no_points", reason)]
        keep = slice(None, None, -(-n // self.config.max_points))
        points, sigma = made.points[keep], made.depth_sigma_m[keep]
        self._cloud = Pointcloud.from_points(
            points, frame=frame, stamp_ns=sample.stamp_ns, intensity=made.intensity[keep]
        )
        self._sigmas = DoubleSequence(sigma)
        metrics = {
            "points": float(len(points)), "density": float(np.isfinite(disparity.image).mean()),
            "median_depth_sigma_m": float(np.median(sigma)),
        }  # fmt: skip
        quality = Quality(covariance_kind=CovarianceKind.FORMAL, metrics=metrics)
        return [self._output("cloud", sample, (sample.id,), frame, self._cloud, quality)]

    def _two_views(self) -> Iterable[Output]:
        """The problem of two cameras, the first at the origin."""
        if self._matches is None or self._pose is None:
            return []
        matches, pose = self._matches, self._pose
        self._matches = None
        used, frame = (matches.id, pose.id), pose.value.parent_frame
        if self.config.camera is None:
            return [self._failed("landmarks", matches, used, frame, "no_camera: configure camera = fx fy cx cy")]
        n = len(matches.value.items)
        pixels = np.stack([matches.value.sources_px, matches.value.sinks_px], axis=1).reshape(-1, 2)
        problem = BundleProblem.from_arrays(
            np.stack([np.eye(4), pose.value.transform.matrix]), self.config.camera, np.zeros((n, 3)),
            (np.tile([0, 1], n), np.repeat(np.arange(n), 2)), pixels, frame=frame,
        )  # fmt: skip
        return self._sparse(problem, matches, used, frame)

    def _sparse(self, problem: BundleProblem, sample: Sample, used: tuple[str, ...], frame: str) -> Iterable[Output]:
        try:
            found = self._triangulate.process(NViewTriangulationInputs(problem))
        except InputError as error:
            return [self._failed("landmarks", sample, used, frame, f"bad_input:{error}")]
        except RefusedError as refusal:
            return [self._failed("landmarks", sample, used, frame, *refusal.reasons)]
        quality = self._judged(found)
        valid = found.valid
        seen = np.bincount(problem.observations.points, minlength=len(valid)).astype(np.uint32)
        self._landmarks = LandmarkMap.from_arrays(
            problem.points.ids[valid], found.points[valid], frame=frame, stamp_ns=sample.stamp_ns,
            covariances=found.covariances[valid], observations=seen[valid], producer=self.name,
        )  # fmt: skip
        thin = slice(None, None, max(1, -(-int(valid.sum()) // self.config.max_points)))
        self._cloud = Pointcloud.from_points(found.points[valid][thin], frame=frame, stamp_ns=sample.stamp_ns)
        return [
            self._output("landmarks", sample, used, frame, self._landmarks, quality),
            self._output("cloud", sample, used, frame, self._cloud, quality),
        ]

    def _judged(self, found: NViewTriangulationOutputs) -> Quality:
        c, share, variance = self.config, float(found.valid.mean()), float(found.unit_variance)
        reasons = []
        if share < c.min_valid_share:
            reasons.append(f"few_valid:{share:.2f}<{c.min_valid_share:g}")
        if variance > c.max_unit_variance:
            reasons.append(f"residuals_exceed_noise:{variance:.1f}>{c.max_unit_variance:g}")
        metrics = {
            **self._triangulate.metrics, "unit_variance": variance,
            "median_angle_deg": float(np.degrees(np.median(found.angles[found.valid]))),
            "rms_px": float(np.sqrt(np.mean(found.rms_px[found.valid] ** 2))),
        }  # fmt: skip
        status = Status.DEGRADED if reasons else Status.OK
        return Quality(status, tuple(reasons), CovarianceKind.FORMAL, metrics)

    def _failed(self, port: str, sample: Sample, used: tuple[str, ...], frame: str, *reasons: str) -> Output:
        return self._output(port, sample, used, frame, None, Quality(Status.FAILED, reasons))

    def _output(
        self, port: str, sample: Sample, used: tuple[str, ...], frame: str, value: Any, quality: Quality
    ) -> Output:
        ids = tuple(i for i in used if i)
        return Output(port, value, sample.stamp_ns, sample.stamp_ns, frame, None, quality, ids)
