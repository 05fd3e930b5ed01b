# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of prepared models in a depth image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn, StrictModel
from cdff_common.types import DistanceImage
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs
from cdff_core.imaging.depth_images import depth_of, points_near
from cdff_core.object_models.rendering import Window, body_window, render
from cdff_core.object_models.scan_detection import (
    DetectionLimits,
    Hypothesis,
    ScanDetector,
    bounded_noise,
    on_surface,
    surface_ports,
)
from cdff_core.object_models.scan_parts import range_noise
from cdff_core.object_models.scene_parts import scene_parts

#: Largest number of points in which parts are searched, of points of a part, and of points in its
#: surroundings.
_SCENE_POINTS, _PART_POINTS, _CHECKED_POINTS = 80_000, 1500, 4000
#: Radius of the surroundings in which a pose is checked, in diameters.
_REACH = 0.6
#: Score of the search below which a part is not checked, and largest deviation of an agreeing depth,
#: standard deviations.
_MIN_RANK, _SIGMAS = 0.2, 3.0
#: Tolerance of a depth, in diameters, above which any object of this size would agree.
_RESOLVED = 0.07
#: A model is not searched if its diameter has fewer pixels than this at the median depth, or is larger than
#: this number of median depths.
_LEAST_PIXELS, _LARGEST = 5.0, 20.0
#: Least distance between the centres of two objects, in diameters of the larger model.
_MIN_SEPARATION_DIAMETERS = 0.3


class DepthDetectionConfig(StrictModel):
    """Parameters of the detection in depth images."""

    sigma_m: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="Standard deviation of a depth, metres; 0: estimated from the image",
    )
    sigma_per_m: float = Field(
        default=0.003,
        ge=0,
        le=0.1,
        description="Least standard deviation relative to the depth: errors that neighbouring depths share",
    )
    sigma_of_diameter: float = Field(
        default=0.0133,
        ge=0,
        le=0.1,
        description="Least standard deviation relative to the diameter: errors of the mesh",
    )
    max_depth_m: float = Field(
        default=100.0, gt=0, le=1e5, description="Depth beyond which nothing is searched"
    )
    min_points: int = Field(
        default=80, ge=20, le=10_000, description="Depths of the smallest part that is examined"
    )
    max_parts: int = Field(
        default=5, ge=1, le=100, description="Parts of the image that are examined, per model"
    )
    min_score: float = Field(
        default=0.84,
        gt=0,
        le=1,
        description="Fraction of the depths on the model, without those that hide it, that agree, times "
        "that of the part of the image that is on it",
    )
    min_visible: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="Fraction of the depths on the model that must not be in front of it",
    )
    min_measured: float = Field(
        default=0.5, gt=0, le=1, description="Fraction of the pixels of the model that must have a depth"
    )
    ambiguity: float = Field(
        default=12.0,
        ge=0,
        le=1000,
        description="Difference of -2 log likelihood up to which poses are alternatives",
    )


@dataclass(frozen=True, slots=True, eq=False)
class DepthDetection:
    """Poses ``T_camera_model`` of one object, best first, and the depths that support it."""

    hypotheses: list[Hypothesis]
    points: int
    centre_m: FloatArray

    @property
    def score(self) -> float:
        """Agreement of the best pose."""
        return self.hypotheses[0].score


class _Comparison(NamedTuple):
    """Comparison of the depths with a model.

    Depths in front of the model hide it and do not count, except those of a large plane: an object is on a
    table, not below it.

    Attributes
    ----------
    agreement : float
        Fraction of the depths on the model, without those that hide it, that agree.
    hidden : float
        Fraction of the depths on the model that hide it.
    measured : float
        Fraction of the pixels of the model that have a depth.
    """

    agreement: float
    hidden: float
    measured: float


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """A depth image, the points (r, c, 3) of a grid of its pixels, and which of them are on large planes."""

    image: DistanceImage
    grid_m: FloatArray
    on_planes: BoolArray

    def comparison(
        self,
        model: ModelPreparationOutputs,
        T_camera_model: FloatArray,
        R_camera_depth: FloatArray,
        limit_m: float,
    ) -> _Comparison:
        """Return the comparison of a model with the depths, up to ``limit_m``."""
        rows, columns = self.on_planes.shape
        step = -(-self.image.width // columns)
        fx, fy = 1.0 / (self.image.scale_x * step), 1.0 / (self.image.scale_y * step)
        camera = Window(fx, fy, -self.image.center_x * fx, -self.image.center_y * fy, rows, columns)
        T_depth_model = se3.transform(R_camera_depth.T, np.zeros(3)) @ T_camera_model
        row, column, window = body_window(model.drawn_vertices, T_depth_model, camera)
        rendered_m = render(model.drawn_vertices, model.drawn_triangles, T_depth_model, window).depth_m
        part = np.s_[row : row + window.rows, column : column + window.columns]
        behind_m = self.grid_m[part][..., 2] - rendered_m
        is_on = np.isfinite(behind_m)
        agree = int(np.count_nonzero(is_on & (np.abs(behind_m) <= limit_m)))
        in_front = is_on & (behind_m < -limit_m)
        hidden = int(np.count_nonzero(in_front & ~self.on_planes[part]))
        count_on_surface, count_rendered = (
            int(np.count_nonzero(is_on)),
            int(np.count_nonzero(np.isfinite(rendered_m))),
        )
        return _Comparison(
            agree / max(count_on_surface - hidden, 1),
            hidden / max(count_on_surface, 1),
            count_on_surface / max(count_rendered, 1),
        )


class DepthDetector:
    """Search in the parts of a depth image, and check of the poses with their surroundings.

    Parameters
    ----------
    search, refine, register : Dfn
        ModelPoseSearch, ModelPoseRefinement, and ModelRegistration without outline.
    config : DepthDetectionConfig
    R_camera_depth : ndarray, shape (3, 3)
        Axes of the depth camera in those of the camera; the poses have the axes of the camera.
    """

    def __init__(
        self,
        search: Dfn[Any, Any, Any],
        refine: Dfn[Any, Any, Any],
        register: Dfn[Any, Any, Any],
        config: DepthDetectionConfig,
        R_camera_depth: FloatArray | None = None,
        seed: int = 0,
    ) -> None:
        self._search, self._refine, self._register = search, refine, register
        self._config, self._seed = config, seed
        self._R = np.eye(3) if R_camera_depth is None else R_camera_depth

    def detect(self, name: str, model: ModelPreparationOutputs, image: DistanceImage) -> list[DepthDetection]:
        """Return the objects of a model, the best first.

        Raises
        ------
        RefusedError
            If there is none: ``few_points``, ``no_part``, or the reasons against the parts.
        InputError
            If the depth image is not valid.
        """
        cfg = self._config
        grid_m = self._grid(image)
        count = int(np.count_nonzero(np.isfinite(grid_m[..., 2])))
        if count < cfg.min_points:
            hint = ["wrong_unit"] if np.count_nonzero(image.data > cfg.max_depth_m) > count else []
            raise RefusedError(f"{count} depths", [f"few_points:{count}<{cfg.min_points}", *hint])
        _check_scale(model, image, grid_m)
        parts, on_planes = scene_parts(grid_m, model.diameter_m, cfg.min_points, seed=self._seed)
        scene = _Scene(image, grid_m @ self._R, on_planes)
        flat = grid_m.reshape(-1, 3)
        detections: list[DepthDetection] = []
        reasons: list[str] = [] if parts else ["no_part"]
        for rows in parts[: cfg.max_parts]:
            try:
                detections.append(self._examine_part(name, model, scene, flat[rows]))
            except RefusedError as error:
                reasons += error.reasons
        if not detections:
            raise RefusedError(f"{name} is in none of {len(parts)} parts of the image", reasons)
        return sorted(detections, key=lambda detection: -detection.score)

    def _grid(self, image: DistanceImage) -> FloatArray:
        """Return the points (r, c, 3) of a grid of pixels in the axes of the camera."""
        depth_m, K = depth_of(image, 0.0, self._config.max_depth_m)
        step = max(1, int(np.ceil(np.sqrt(depth_m.size / _SCENE_POINTS))))
        rows, columns = depth_m.shape
        v, u = np.mgrid[:rows:step, :columns:step]
        z = depth_m[::step, ::step]
        points = np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=-1)
        return np.asarray(points @ self._R.T)

    def _examine_part(
        self, name: str, model: ModelPreparationOutputs, scene: _Scene, part_m: FloatArray
    ) -> DepthDetection:
        """Return the detection in one part (n, 3); raises RefusedError."""
        cfg = self._config
        noise_m = cfg.sigma_m or max(range_noise(part_m), cfg.sigma_per_m * float(np.median(part_m[:, 2])))
        sigma_m = max(noise_m, cfg.sigma_of_diameter * model.diameter_m)
        sigma_m = bounded_noise(sigma_m, model.diameter_m)
        if _SIGMAS * sigma_m > _RESOLVED * model.diameter_m:
            raise RefusedError("the noise hides the shape", [f"noise:{sigma_m:.3g}m"])
        limits = DetectionLimits(sigma_m, cfg.min_points // 2, _MIN_RANK, cfg.ambiguity)
        detector = ScanDetector(self._search, self._refine, limits)
        step = -(-len(part_m) // _PART_POINTS)
        hypotheses = detector.detect(name, model, np.ascontiguousarray(part_m[::step]), {})
        checked = [
            self._check_hypothesis(model, scene, part_m, hypothesis, sigma_m) for hypothesis in hypotheses
        ]
        checked.sort(key=lambda hypothesis_and_view: -hypothesis_and_view[0].score)
        best, view = checked[0]
        centre_m = best.T[:3, :3] @ model.centre_m + best.T[:3, 3]
        return DepthDetection([hypothesis for hypothesis, _ in checked], view, centre_m)

    def _check_hypothesis(
        self,
        model: ModelPreparationOutputs,
        scene: _Scene,
        part_m: FloatArray,
        hypothesis: Hypothesis,
        sigma_m: float,
    ) -> tuple[Hypothesis, int]:
        """Return a hypothesis registered with all depths near it, and their number; raises RefusedError.

        Its score is the fraction of the depths on the model that agree times that of the part (n, 3) on it.
        """
        cfg = self._config
        centre_m = hypothesis.T[:3, :3] @ model.centre_m + hypothesis.T[:3, 3]
        depth_centre_m, radius_m = centre_m @ self._R, _REACH * model.diameter_m
        near_m = points_near(scene.image, depth_centre_m, radius_m, _CHECKED_POINTS)[0] @ self._R.T
        assert hypothesis.covariance is not None  # of a detection by depths
        outputs = self._register.process(
            ModelRegistrationInputs(
                scan=np.ascontiguousarray(near_m),
                pose=hypothesis.T,
                prior_covariance=4.0 * hypothesis.covariance + np.diag(np.repeat([sigma_m, 0.02], 3) ** 2),
                state_jacobian=np.eye(12, 6),
                drawn_vertices=model.drawn_vertices,
                drawn_triangles=model.drawn_triangles,
                centre_m=model.centre_m,
                sigma_m=sigma_m,
                **surface_ports(model),
            )
        )
        view = scene.comparison(model, outputs.pose, self._R, _SIGMAS * sigma_m)
        _check_visible(hypothesis.name, view, cfg)
        score = view.agreement * float(np.mean(on_surface(model, outputs.pose, part_m, _SIGMAS * sigma_m)))
        if score < cfg.min_score:
            reason = f"low_score:{score:.2f}<{cfg.min_score:g}"
            raise RefusedError(f"{hypothesis.name}: {reason}", [reason])
        registered = replace(hypothesis, T=outputs.pose, covariance=outputs.covariance, score=score)
        return registered, len(near_m)


def _check_scale(model: ModelPreparationOutputs, image: DistanceImage, grid_m: FloatArray) -> None:
    """Raise RefusedError if a model is much smaller than a pixel or larger than the scene."""
    depth_m = float(np.nanmedian(grid_m[..., 2]))
    pixels = model.diameter_m / (depth_m * image.scale_x)
    if pixels < _LEAST_PIXELS:
        hint = ["wrong_unit"] if pixels < 1.0 else []
        raise RefusedError("the model is too small in the image", [f"too_small:{pixels:.2g}px", *hint])
    if model.diameter_m > _LARGEST * depth_m:
        raise RefusedError(
            "the model is larger than the scene", [f"too_large:{model.diameter_m:.3g}m", "wrong_unit"]
        )


def _check_visible(name: str, view: _Comparison, cfg: DepthDetectionConfig) -> None:
    """Raise RefusedError if too little of an object is seen."""
    if view.measured < cfg.min_measured:
        reason = f"unmeasured:{view.measured:.2f}<{cfg.min_measured:g}"
    elif view.hidden > 1.0 - cfg.min_visible:
        reason = f"hidden:{view.hidden:.2f}>{1.0 - cfg.min_visible:g}"
    else:
        return
    raise RefusedError(f"{name}: {reason}", [reason])


def separate(detections: list[tuple[DepthDetection, float]]) -> list[DepthDetection]:
    """Return detections, each with the diameter of its model, without detections at the position of a better
    one.
    """
    separate_detections: list[tuple[DepthDetection, float]] = []
    for detection, diameter_m in sorted(detections, key=lambda pair: -pair[0].score):
        is_apart = all(
            np.linalg.norm(detection.centre_m - other.centre_m)
            > _MIN_SEPARATION_DIAMETERS * max(diameter_m, other_diameter_m)
            for other, other_diameter_m in separate_detections
        )
        if is_apart:
            separate_detections.append((detection, diameter_m))
    return [detection for detection, _ in separate_detections]
