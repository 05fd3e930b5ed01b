# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of BundleAdjustment: adjust, accept, publish; marginalise on request."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import BundleProblem, LandmarkMap, PoseTrajectory
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_core.dfpcs.bundle_adjustment.configuration import BundleAdjustmentConfig
from cdff_core.dfpcs.bundle_adjustment.interface import BundleAdjustmentInterface
from cdff_core.dfpcs.bundle_adjustment.lens_uncertainty import lens_covariances

#: Variance of unit weight in units of ``sigma_px`` squared: DEGRADED above (residuals of three sigma).
_MAX_UNIT_VARIANCE = 9.0


class BundleAdjustment(BundleAdjustmentInterface):
    """Adjustment of cameras and points to their observations."""

    Config = BundleAdjustmentConfig
    config: BundleAdjustmentConfig

    def setup(self) -> None:
        """Create the DFN; offer the store item."""
        self._adjust = self.dfn("adjust")
        self._adjust_again = self.dfn("adjust")
        self._adjust_again.configure(self._adjust_again.config.model_copy(update={"covariances": "none"}))
        self.forget()
        self.store.offer("last_problem", lambda: self._problem)

    def forget(self) -> None:
        """Clear the last problem."""
        self._problem: BundleProblem | None = None

    def on_problem(self, sample: Sample) -> Iterable[Output]:
        """Adjust the problem; publish it with the trajectory and the landmarks."""
        frame = sample.value.frame or sample.frame or "site"
        try:
            adjusted = self._adjust.process(BundleOptimizationInputs(problem=sample.value))
        except InputError as error:
            quality = Quality.failed(f"bad_problem:{error}")
            return [self._output("problem", sample, frame, None, quality)]
        quality = self._quality(adjusted)
        if quality.covariance_kind is not CovarianceKind.NONE:
            adjusted = self._with_lens_uncertainty(adjusted)
        if quality.status is Status.FAILED:
            return [self._output("problem", sample, frame, None, quality)]
        self._problem = adjusted.problem
        outputs = [self._output("problem", sample, frame, adjusted.problem, quality)]
        trajectory = self._trajectory(adjusted, frame)
        if trajectory is not None:
            outputs.append(self._output("trajectory", sample, frame, trajectory, quality))
        return [*outputs, self._output("landmarks", sample, frame, self._landmarks(adjusted, frame), quality)]

    def marginalise(self, cameras: str) -> BundleProblem:
        """Remove cameras from the last problem; raises InputError or ProductNotFoundError."""
        if self._problem is None:
            raise ProductNotFoundError("bundle_adjustment: no problem was adjusted yet")
        try:
            ids = np.array([int(word) for word in cameras.split(",")], np.int64)
        except ValueError as error:
            raise InputError(f"cameras={cameras!r}: expected ids separated by commas") from error
        marginaliser = self.dfn("adjust")
        marginaliser.configure(
            marginaliser.config.model_copy(update={"max_iterations": 0, "covariances": "none"})
        )
        remaining: BundleProblem | None = marginaliser.process(
            BundleOptimizationInputs(problem=self._problem, dropped=ids)
        ).remaining
        assert remaining is not None
        self._problem = remaining
        return remaining

    def _quality(self, adjusted: BundleOptimizationOutputs) -> Quality:
        """Return the quality from the reasons of the DFN, the gauge, and the residuals relative to the
        noise.
        """
        metrics, reasons = dict(self._adjust.metrics), list(self._adjust.reasons)
        if not np.isfinite(metrics["cost_final"]):
            return Quality.failed("cost_not_finite", *reasons)
        variance = metrics["unit_variance"] / self.config.sigma_px**2
        if variance > _MAX_UNIT_VARIANCE:
            reasons.append(f"residuals_exceed_noise:{variance:.1f}>{_MAX_UNIT_VARIANCE:g}")
        has_covariances = bool(np.isfinite(adjusted.pose_covariances).all())
        status = Status.DEGRADED if reasons else Status.OK
        gauge = adjusted.gauge.tolist()
        if gauge:
            metrics["gauge_camera"] = float(gauge[0])
        if len(gauge) > 1:
            reasons.append(f"scale_kept:camera {gauge[0]} to camera {gauge[1]}")
            metrics["gauge_distance_camera"] = float(gauge[1])
        metrics = {name: value for name, value in metrics.items() if np.isfinite(value)}
        return Quality(
            status, tuple(reasons), CovarianceKind.FORMAL if has_covariances else CovarianceKind.NONE, metrics
        )

    def _with_lens_uncertainty(self, adjusted: BundleOptimizationOutputs) -> BundleOptimizationOutputs:
        """Return the outputs with the uncertainty of fixed focal lengths in their covariances."""
        poses, points = lens_covariances(self._adjust_again, adjusted.problem, self.config.focal_length_ratio)
        return replace(
            adjusted,
            pose_covariances=adjusted.pose_covariances + poses,
            point_covariances=adjusted.point_covariances + points,
        )

    def _trajectory(self, adjusted: BundleOptimizationOutputs, frame: str) -> PoseTrajectory | None:
        """Return the poses in order of their stamps; None if stamps are missing or repeated."""
        cameras = adjusted.problem.cameras
        stamps = cameras.stamps * 1000
        if len(np.unique(stamps)) < len(stamps):
            return None
        order = np.argsort(stamps)
        covariances = adjusted.pose_covariances[order]
        return PoseTrajectory.from_arrays(
            stamps[order],
            cameras.matrices[order],
            covariances if np.isfinite(covariances).all() else None,
            parent=frame,
            child=f"{self.context.robot}/navcam_left",
        )

    def _landmarks(self, adjusted: BundleOptimizationOutputs, frame: str) -> LandmarkMap:
        """Return the adjusted points with covariances and numbers of observations as landmarks."""
        problem = adjusted.problem
        counts = np.bincount(problem.observations.points, minlength=len(problem.points.ids)).astype(np.uint32)
        return LandmarkMap.from_arrays(
            problem.points.ids,
            problem.points.positions,
            frame=frame,
            stamp_ns=problem.stamp_ns,
            covariances=adjusted.point_covariances,
            observations=counts,
            producer=self.name,
        )

    def _output(self, port: str, sample: Sample, frame: str, value: Any, quality: Quality) -> Output:
        child = value.child_frame if port == "trajectory" else None
        return Output(port, value, sample.stamp_ns, sample.stamp_ns, frame, child, quality, (sample.id,))
