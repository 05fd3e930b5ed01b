# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualTargetTracking: the sequence is that of ``ImageTracking``, from a guess."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_core.dfns.image_pose_refinement.interface import ImagePoseRefinementInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfpcs.visual_target_tracking.configuration import VisualTargetTrackingConfig
from cdff_core.dfpcs.visual_target_tracking.interface import VisualTargetTrackingInterface
from cdff_core.object_models.image_tracking import ImageTracking, ViewFit
from cdff_core.object_models.shading_fit import ShadingFitter


class VisualTargetTracking(ImageTracking, VisualTargetTrackingInterface):
    """Comparison of each image, and its depth image if there is one, with the mesh at the predicted state."""

    Config = VisualTargetTrackingConfig
    config: VisualTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self.setup_images()
        self._shading = ShadingFitter(
            self.dfn("light"),
            self.dfn("detect"),
            self.dfn("track"),
            self.dfn("refine_shading"),
            self.config.max_range_px,
        )
        self._sun: FloatArray | None = None
        self._orientation = self.dfn("orientation")

    def restart(self) -> None:
        """Clear the track; the next guess starts a new one."""
        super().restart()
        self._orientation_ns: int | None = None

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Store the guess; the next image may be compared by the orientation of all edges."""
        self._orientation_ns = None
        return super().on_guess(sample)

    def on_sun(self, sample: Sample) -> Iterable[Output]:
        """Store the direction to the Sun; raises InputError if it is not finite or zero."""
        direction = np.asarray(sample.value.values, np.float64)
        if not (np.isfinite(direction).all() and direction.any()):
            raise InputError(f"sun {direction.tolist()}: expected a finite direction that is not zero")
        self._sun = direction
        return ()

    def _correct_by_shading(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit by an image in the light of the Sun."""
        cfg = self.config
        if self._sun is None or fit.grey is None:
            return
        try:
            shading_fit = self._shading.fit(model, fit.state, fit.grey, sample.value.camera_matrix, self._sun)
        except RefusedError as error:
            fit.faults.append(f"shading_{error.reasons[0]}")
            return
        fit.metrics |= {
            "shading_points": float(shading_fit.points),
            "shading_agreement": shading_fit.agreement,
            "shading_innovation": shading_fit.distance,
            "correlation": shading_fit.correlation,
        }
        if shading_fit.agreement < cfg.min_shading_agreement:
            fit.faults.append(
                f"shading_low_agreement:{shading_fit.agreement:.2f}<{cfg.min_shading_agreement:g}"
            )
        elif not shading_fit.correlation >= cfg.min_correlation:
            fit.faults.append(f"low_correlation:{shading_fit.correlation:.2f}<{cfg.min_correlation:g}")
        elif shading_fit.distance > self._gate:
            fit.faults.append(f"shading_innovation:{shading_fit.distance:.3g}>{self._gate:.3g}")
            fit.is_contradiction = True
        else:
            fit.state, fit.has_shading = shading_fit.state, True

    def _correct_by_orientation(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit by the orientation of all edges, at most once in an interval.

        The covariance is not verified in hard light: the output is DEGRADED ``edge_orientation``.
        """
        interval_ns = 1e9 * self.config.orientation_interval_s
        is_early = self._orientation_ns is not None and sample.stamp_ns - self._orientation_ns < interval_ns
        is_measured = any(fault.startswith("low_agreement:") for fault in fit.faults)
        if fit.grey is None or is_early or not is_measured:
            return
        self._orientation_ns = sample.stamp_ns
        try:
            refined_pose = self._orientation.process(
                ImagePoseRefinementInputs(
                    image=fit.grey,
                    camera_matrix=sample.value.camera_matrix,
                    pose=fit.state.T,
                    covariance=fit.state.covariance[:6, :6],
                    vertices=model.drawn_vertices,
                    triangles=model.drawn_triangles,
                    centre_m=model.centre_m,
                    diameter_m=model.diameter_m,
                )
            )
        except RefusedError as error:
            fit.faults += error.reasons
            return
        fit.metrics["edge_correlation"] = refined_pose.correlation
        fit.faults.append("edge_orientation")
        fit.state = fit.state.with_pose(refined_pose.pose, refined_pose.covariance)
        fit.has_orientation = True
