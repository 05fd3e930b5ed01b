# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of BundleAdjustment: adjust, judge, answer; marginalise on request."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import BundleProblem, LandmarkMap, PoseTrajectory
from cdff_core.dfns.bundle_optimization._interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_core.dfpcs.bundle_adjustment._interface import BundleAdjustmentInterface


class BundleAdjustmentConfig(DfpcConfig):
    """Parameters of the DFN, and when an answer is to be taken with care."""

    adjust: dict[str, Any] = Field({}, description="Of BundleOptimization")
    sigma_px: float = Field(1.0, gt=0, le=100, description="Standard deviation of an observed column or row, px")
    max_unit_variance: float = Field(
        9.0, gt=0, description="Variance of unit weight, in units of sigma_px squared, above which it is DEGRADED"
    )


class BundleAdjustment(BundleAdjustmentInterface):
    """Cameras and points that agree with what was seen."""

    Config: ClassVar[type[DfpcConfig]] = BundleAdjustmentConfig

    config: BundleAdjustmentConfig

    def setup(self) -> None:
        """Make the DFN, forget everything, offer the store's item."""
        self._adjust = self.dfn("adjust")
        self.forget()
        self.store.offer("last_problem", lambda: self._problem)

    def forget(self) -> None:
        """Forget the last problem."""
        self._problem: BundleProblem | None = None

    def on_problem(self, sample: Sample) -> Iterable[Output]:
        """Adjust one problem."""
        frame = sample.value.frame or sample.frame or "site"
        try:
            found = self._adjust.process(BundleOptimizationInputs(sample.value))
        except InputError as error:
            return [self._output("problem", sample, frame, None, Quality(Status.FAILED, (f"bad_problem:{error}",)))]
        quality = self._judged(found)
        if quality.status is Status.FAILED:
            return [self._output("problem", sample, frame, None, quality)]
        self._problem = found.problem
        outputs = [self._output("problem", sample, frame, found.problem, quality)]
        trajectory = self._trajectory(found, frame)
        if trajectory is not None:
            outputs.append(self._output("trajectory", sample, frame, trajectory, quality))
        return [*outputs, self._output("landmarks", sample, frame, self._landmarks(found, frame), quality)]

    def marginalise(self, cameras: str) -> BundleProblem:
        """Drop cameras from the last problem; raises InputError, and ProductNotFoundError where there is none."""
        if self._problem is None:
            raise ProductNotFoundError("bundle_adjustment: no problem was adjusted yet")
        try:
            ids = np.array([int(word) for word in cameras.split(",")], np.int64)
        except ValueError as error:
            raise InputError(f"cameras={cameras!r}: expected ids separated by commas") from error
        node = self.dfn("adjust")
        node.configure(node.config.model_copy(update={"max_iterations": 0, "covariances": "none"}))
        remaining = node.process(BundleOptimizationInputs(self._problem, ids)).remaining
        assert remaining is not None
        self._problem = remaining
        return remaining

    def _judged(self, found: BundleOptimizationOutputs) -> Quality:
        """Reasons of the DFN, the gauge, and whether residuals are as the noise says."""
        metrics, reasons = dict(self._adjust.metrics), list(self._adjust.reasons)
        if not np.isfinite(metrics["cost_final"]):
            return Quality(Status.FAILED, ("cost_not_finite", *reasons), metrics={})
        variance = metrics["unit_variance"] / self.config.sigma_px**2
        if variance > self.config.max_unit_variance:
            reasons.append(f"residuals_exceed_noise:{variance:.1f}>{self.config.max_unit_variance:g}")
        known = bool(np.isfinite(found.pose_covariances).all())
        status = Status.DEGRADED if reasons else Status.OK
        gauge = found.gauge.tolist()
        if gauge:
            metrics["gauge_camera"] = float(gauge[0])
        if len(gauge) > 1:
            reasons.append(f"scale_kept:camera {gauge[0]} to camera {gauge[1]}")
            metrics["gauge_distance_camera"] = float(gauge[1])
        metrics = {name: value for name, value in metrics.items() if np.isfinite(value)}
        return Quality(status, tuple(reasons), CovarianceKind.FORMAL if known else CovarianceKind.NONE, metrics)

    def _trajectory(self, found: BundleOptimizationOutputs, frame: str) -> PoseTrajectory | None:
        """Poses in the order of their stamps; None where the images have none."""
        cameras = found.problem.cameras
        stamps = cameras.stamps * 1000
        if len(np.unique(stamps)) < len(stamps):
            return None
        order = np.argsort(stamps)
        covariances = found.pose_covariances[order]
        return PoseTrajectory.from_arrays(
            stamps[order], cameras.matrices[order], covariances if np.isfinite(covariances).all() else None,
            parent=frame, child=f"{self.context.robot}/navcam_left",
        )  # fmt: skip

    def _landmarks(self, found: BundleOptimizationOutputs, frame: str) -> LandmarkMap:
        problem = found.problem
        seen = np.bincount(problem.observations.points, minlength=len(problem.points.ids)).astype(np.uint32)
        return LandmarkMap.from_arrays(
            problem.points.ids, problem.points.positions, frame=frame, stamp_ns=problem.stamp_ns,
            covariances=found.point_covariances, observations=seen, producer=self.name,
        )  # fmt: skip

    def _output(self, port: str, sample: Sample, frame: str, value: Any, quality: Quality) -> Output:
        child = value.child_frame if port == "trajectory" else None
        return Output(
            port, value, sample.stamp_ns, sample.stamp_ns, frame, child, quality, (sample.id,) if sample.id else ()
        )
