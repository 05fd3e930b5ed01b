# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of TargetDetection: prepare the models, examine each body of a scan, publish."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import FrameNotFoundError, InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.types import Frame
from cdff_core.dfns.image_pose_search.interface import ImagePoseSearchInputs
from cdff_core.dfns.image_undistortion.interface import ImageUndistortionInputs
from cdff_core.dfpcs.target_detection.configuration import TargetDetectionConfig
from cdff_core.dfpcs.target_detection.interface import TargetDetectionInterface
from cdff_core.imaging.grey import grey_image
from cdff_core.object_models.body_detection import BodyDetection
from cdff_core.object_models.image_search import LARGEST_SCORE
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    no_body_reasons,
    valid_points,
)
from cdff_core.object_models.scan_parts import bodies

#: Distance of a body from its expected position, standard deviations, above which it is not examined.
_GATE = 4.0


class TargetDetection(BodyDetection, TargetDetectionInterface):
    """Detection of known bodies in each scan."""

    Config = TargetDetectionConfig
    config: TargetDetectionConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        cfg, seed = self.config, self.context.seed
        limits = DetectionLimits(cfg.sigma_m, cfg.min_points, cfg.min_score, cfg.ambiguity)
        self._detector = ScanDetector(self.dfn("search", seed=seed), self.dfn("refine", seed=seed), limits)
        self._undistort = self.dfn("undistort")
        self._image_search = self.dfn("image_search", seed=seed)
        self._expected: Sample | None = None
        self.setup_models(cfg.unit)

    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in the scan; without a model the scan waits."""
        return self.detect(sample)

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in a scan whose points have times."""
        return self.detect(sample)

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Detect the models in an image."""
        return self.detect(sample)

    def on_position(self, sample: Sample) -> Iterable[Output]:
        """Store the expected position of the bodies."""
        self._expected = sample
        return ()

    def _frame(self, sample: Sample) -> str:
        return str(sample.value.frame)

    def _limits(self, sample: Sample) -> list[str]:
        """Return the reason why the poses of an image are DEGRADED: nothing confirms them."""
        return ["single_image"] if sample.port == "image" else []

    def _hypotheses(self, sample: Sample, metrics: dict[str, float]) -> tuple[list[Hypothesis], list[str]]:
        """Return the accepted hypotheses of all bodies, best first, and the reasons against the others."""
        if sample.port == "image":
            return self._image_hypotheses(sample.value, metrics)
        points_m = valid_points(sample.value.points_m)[0]
        metrics["points"] = float(len(points_m))
        if len(points_m) < self.config.min_points:
            raise RefusedError(
                f"a scan of {len(points_m)} points", [f"few_points:{len(points_m)}<{self.config.min_points}"]
            )
        reasons: list[str] = []
        accepted: dict[int, list[Hypothesis]] = {}
        expected = self._expected_position(sample, reasons)
        for name, model in self._models.by_name.items():
            parts = bodies(points_m, model.diameter_m)
            if expected is not None:
                count = len(parts)
                parts = near_position(parts, points_m, expected, model.diameter_m)
                reasons += [f"away_from_position:{count - len(parts)}"] if len(parts) < count else []
            parts = parts[: self.config.max_bodies]
            metrics["bodies"] = float(len(parts))
            if not parts and expected is None:
                reasons += no_body_reasons(points_m, model.diameter_m)
            for rows in parts:
                try:
                    hypotheses = self._detector.detect(name, model, points_m[rows], metrics)
                except RefusedError as error:
                    reasons += error.reasons
                    continue
                key = int(rows[0])
                if key not in accepted or hypotheses[0].score > accepted[key][0].score:
                    accepted[key] = hypotheses
        groups = sorted(accepted.values(), key=lambda group: -group[0].score)
        return [hypothesis for group in groups for hypothesis in group], reasons

    def _image_hypotheses(
        self, frame: Frame, metrics: dict[str, float]
    ) -> tuple[list[Hypothesis], list[str]]:
        """Return the poses of the model that agrees best with an image; the others follow as alternatives."""
        if not np.any(frame.camera_matrix):
            raise InputError("image without a camera: expected its camera matrix, as image=IMAGE,CAMERA")
        if np.any(frame.intrinsic.dist_coeffs):
            frame = self._undistort.process(ImageUndistortionInputs(image=frame)).image
        grey = grey_image(frame)
        best: list[Hypothesis] = []
        for name, model in self._models.by_name.items():
            found = self._image_search.process(
                ImagePoseSearchInputs(
                    image=grey,
                    camera_matrix=frame.camera_matrix,
                    vertices=model.drawn_vertices,
                    triangles=model.drawn_triangles,
                    centre_m=model.centre_m,
                    diameter_m=model.diameter_m,
                )
            )
            scores = found.scores / LARGEST_SCORE
            if best and best[0].score >= scores[0]:
                continue
            metrics |= {
                "score": float(scores[0]),
                "edge_correlation": float(found.agreements[0, 0]),
                "light_inside": float(found.agreements[0, 1]),
                "light_extent_px": float(found.light[2]),
            }
            best = [
                Hypothesis(name, T, None, float(score), is_alternative=i > 0)
                for i, (T, score) in enumerate(zip(found.poses, scores, strict=True))
            ]
        return best, []

    def _expected_position(self, sample: Sample, reasons: list[str]) -> UncertainTransform | None:
        """Return T_scan_body of the expected position, its covariance increased by the motion since then;
        None without a recent one.
        """
        expected = self._expected
        if expected is None or expected.value.transform.covariance is None:
            return None
        age_s = 1e-9 * abs(sample.stamp_ns - expected.stamp_ns)
        if age_s > self.config.position_max_age_s:
            reasons.append(f"position_old:{age_s:.3g}s")
            return None
        T = expected.value.transform
        frame, parent = self._frame(sample), expected.value.parent_frame
        if parent != frame:
            try:
                mount = self.context.frames.lookup(frame, parent, sample.stamp_ns)
                T = UncertainTransform.exact(mount.matrix) @ T
            except FrameNotFoundError:
                reasons.append(f"position_frame_unknown:{parent}")
                return None
        covariance = np.array(T.covariance)
        covariance[:3, :3] += np.square(self.config.relative_speed_mps * age_s) * np.eye(3)
        return UncertainTransform(T.matrix, covariance)


def near_position(
    parts: list[IntArray], points_m: FloatArray, expected: UncertainTransform, diameter_m: float
) -> list[IntArray]:
    """Return the bodies, rows of points (n, 3), that may be at an expected position.

    The distance of the centre of their points from it is at most 4 standard deviations; the standard
    deviation of this centre is a quarter of the diameter of the model.
    """
    assert expected.covariance is not None
    covariance = expected.covariance[:3, :3] + np.square(0.25 * diameter_m) * np.eye(3)
    information = np.linalg.inv(covariance)
    offsets = np.array([points_m[rows].mean(axis=0) for rows in parts]).reshape(-1, 3)
    offsets -= expected.matrix[:3, 3]
    squares = np.einsum("ni,ij,nj->n", offsets, information, offsets)
    return [rows for rows, square in zip(parts, squares, strict=True) if square <= _GATE**2]
