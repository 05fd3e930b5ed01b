# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the compounds that track a body in images, with depth images where there are any."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import Field

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.direction_names import direction_names
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import DistanceImage
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.imaging.depth_images import RgbdPairing, RgbdSamples, points_near
from cdff_core.imaging.frames import check_undistorted
from cdff_core.imaging.grey import grey_image, rgb_image
from cdff_core.object_models.body_tracking import BodyTracking, BodyTrackingConfig, order_fault
from cdff_core.object_models.image_fit import ImageFitter
from cdff_core.object_models.region_fit import RegionFitter
from cdff_core.object_models.rendering import Window, silhouette_pixels
from cdff_core.object_models.scan_detection import bounded_noise, on_surface
from cdff_core.object_models.scan_fit import ScanFit, ScanFitter, body_ball
from cdff_core.object_models.scan_parts import range_noise
from cdff_core.object_models.state_filter import adapt_noise
from cdff_core.object_models.texture_fit import SeenBody, TextureFitter
from cdff_core.object_models.tracked_state import TrackedState

#: Weight of a new estimate of the noise of the depths.
_NOISE_GAIN = 0.2
#: If depths agree with the model, but only within this number of gates, the covariance of the prediction was
#: too small. It is then enlarged to explain the difference, times this margin.
_NEAR_GATES, _MARGIN = 10.0, 4.0


class ImageTrackingConfig(BodyTrackingConfig):
    """Parameters of the fits to images and depth images."""

    rounds: int = Field(
        3, ge=1, le=10, description="Measurements of the edges of an image, each from a better pose"
    )
    max_range_px: float = Field(
        24.0, ge=2, le=200, description="Largest distance of an image edge from the prediction, px"
    )
    min_points: int = Field(
        30, ge=6, le=10_000, description="Number of edge points in the image below which it is not used"
    )
    min_agreement: float = Field(
        0.35, gt=0, le=1, description="Fraction of the edge points below which an image is not used"
    )
    good_agreement: float = Field(
        0.5, gt=0, le=1, description="Fraction of the edge points below which a used image is DEGRADED"
    )
    texture: bool = Field(default=True, description="Track points of the surface from each image to the next")
    min_texture_agreement: float = Field(
        0.6, gt=0, le=1, description="Fraction of the tracked points below which they are not used"
    )
    colour: bool = Field(
        default=True,
        description="Use the colours of the body and of its background, if the images are in colour",
    )
    min_region_agreement: float = Field(
        0.6, gt=0, le=1, description="Fraction of the lines across the outline below which they are not used"
    )
    guess_sigma: float = Field(
        0.02,
        gt=0,
        le=1,
        description="Standard deviation of the position of a guess without covariance, in diameters",
    )
    guess_sigma_rad: float = Field(
        0.03, gt=0, le=3, description="Standard deviation of the rotation of a guess without covariance"
    )
    depth_sigma_m: float = Field(
        0.0,
        ge=0,
        le=10,
        description="Standard deviation of a depth, metres; 0: estimated from the depth images",
    )
    depth_offset_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Position of the depth camera in the frame of the camera, metres"
    )
    depth_rotation_rad: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0),
        description="Rotation vector from the axes of the depth camera to those of the camera",
    )
    depth_delay_sigma: float = Field(
        0.0,
        ge=0,
        le=5,
        description="Standard deviation of the time between a depth image and the image of its stamp, in "
        "intervals of the images; about 0.3 for cameras that are not synchronised",
    )
    max_depth_points: int = Field(
        1500, ge=50, le=100_000, description="Approximate number of depths near the body that are used"
    )
    min_depth_points: int = Field(
        30, ge=10, le=10_000, description="Number of depths near the body below which they are not used"
    )
    min_depth_agreement: float = Field(
        0.5,
        gt=0,
        le=1,
        description="Fraction of the depths of the body, without those in front of it, that must agree",
    )
    good_depth_agreement: float = Field(
        0.75,
        gt=0,
        le=1,
        description="Fraction of these depths below which a used depth image is DEGRADED",
    )
    good_visible: float = Field(
        0.6,
        gt=0,
        le=1,
        description="Fraction of the body that must have depths on it: a used depth image is DEGRADED below",
    )
    min_visible: float = Field(
        0.2, gt=0, le=1, description="Fraction of the depths of the body that must not be in front of it"
    )


#: Distance from the surface up to which a depth is on the body: in standard deviations, and at least the
#: spacing of the points of the surface, in diameters.
_SIGMAS, _SPACING = 3.0, 0.03


@dataclass(slots=True)
class ViewFit:
    """A state corrected by an image and its depth image.

    Attributes
    ----------
    state : TrackedState
        The prediction if nothing was used.
    faults : list of str
        Reasons against the image or the depth image.
    is_contradiction : bool
        One of them contradicts the prediction.
    metrics : dict
    grey : ndarray of uint8, shape (r, c), or None
        The image.
    rgb : ndarray of uint8, shape (r, c, 3), or None
        The image, if its colours are used.
    weak : list of str
        Directions that the used depths do not constrain.
    has_edges, has_depths, has_regions, has_shading, has_orientation : bool
        The edges, the depths, the regions of colour, the light of the Sun, the orientation of the edges were
        used.
    """

    state: TrackedState
    faults: list[str] = field(default_factory=list)
    is_contradiction: bool = False
    metrics: dict[str, float] = field(default_factory=dict)
    grey: ByteArray | None = None
    rgb: ByteArray | None = None
    weak: list[str] = field(default_factory=list)
    has_edges: bool = False
    has_depths: bool = False
    has_regions: bool = False
    has_shading: bool = False
    has_orientation: bool = False

    def add_missing(self, fault: str) -> None:
        """Add a fault of edges or colours unless depths or shading, which determine the pose, were used."""
        if not (self.has_depths or self.has_shading):
            self.faults.append(fault)

    @property
    def used(self) -> bool:
        """The image or the depth image was used."""
        uses = (self.has_edges, self.has_depths, self.has_regions, self.has_shading, self.has_orientation)
        return any(uses)


class ImageTracking(BodyTracking):
    """Compound that corrects the predicted state by depths and edges."""

    config: ImageTrackingConfig

    def setup_images(self) -> None:
        """Create the DFNs and clear the state."""
        cfg = self.config
        self._edges = ImageFitter(
            self.dfn("edges"), self.dfn("refine"), cfg.rounds, cfg.max_range_px, cfg.min_points
        )
        self._texture = TextureFitter(
            self.dfn("detect"), self.dfn("track"), self.dfn("refine_texture"), cfg.max_range_px
        )
        self._regions = RegionFitter(
            self.dfn("regions"), self.dfn("refine_regions"), self.dfn("learn"), cfg.max_range_px
        )
        self._depths = ScanFitter(None, self.dfn("registration"))
        self._R_camera_depth = se3.exp_so3(np.array(cfg.depth_rotation_rad))
        self._pairing = RgbdPairing()
        self.setup_track()

    def restart(self) -> None:
        """Clear the track; the next guess starts a new one."""
        super().restart()
        self._depth_sigma_m = self.config.depth_sigma_m
        self._depth_ns = -1
        self._seen: SeenBody | None = None
        self._regions.clear()
        self._pairing.clear()

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Track the body in an image, with the depth image of its time if there is one."""
        return self._track_views(self._pairing.add(sample))

    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Track the body in a depth image, with the image of its time if there is one."""
        return self._track_views(self._pairing.add(sample))

    def finish(self) -> Iterable[Output]:
        """Track the body in a sample that still waits for its image or depth image."""
        return self._track_views(self._pairing.take_waiting())

    def _track_views(self, views: list[RgbdSamples]) -> list[Output]:
        return [output for view in views for output in self._track(view)]

    def _track(self, view: RgbdSamples) -> Iterator[Output]:
        """Yield the outputs of an image and its depth image."""
        sample, model, state = view.newest, self._model, self._state
        if model is None:
            yield from self._outputs(sample, None, Quality.failed("no_model"))
            return
        if state is not None and not self._is_newer(view, state):
            yield from self._outputs(sample, None, Quality.failed(order_fault(state, sample.stamp_ns)))
            return
        reasons = self._start_from_guess(model, sample.stamp_ns)
        if self._state is None:
            yield from self._without_track(view, model)
            return
        predicted_state, transition = self._filter.prediction(self._state, sample.stamp_ns)
        fit = self._fit(view, model, predicted_state, transition)
        if fit.used:
            yield from self._used_fit(view, predicted_state, fit, reasons)
            return
        self._seen = None
        self._not_used(fit.state, is_contradiction=fit.is_contradiction)
        yield from self._without_fit(view, model, fit, reasons)

    def _is_newer(self, view: RgbdSamples, state: TrackedState) -> bool:
        """Return whether samples are newer than the state, or the first depth image of its time."""
        stamp_ns = view.newest.stamp_ns
        is_first_depth = view.image is None and stamp_ns == state.stamp_ns and stamp_ns != self._depth_ns
        return stamp_ns > state.stamp_ns or is_first_depth

    def _without_track(self, view: RgbdSamples, model: ModelPreparationOutputs) -> Iterable[Output]:
        """Return the outputs without a track and a guess."""
        return self._outputs(view.newest, None, Quality.failed("no_guess"))

    def _without_fit(
        self, view: RgbdSamples, model: ModelPreparationOutputs, fit: ViewFit, reasons: list[str]
    ) -> Iterable[Output]:
        """Publish the prediction."""
        return self._published(view.newest, [*reasons, "coasting", *fit.faults], fit.metrics)

    def _used_fit(
        self, view: RgbdSamples, predicted: TrackedState, fit: ViewFit, reasons: list[str]
    ) -> Iterable[Output]:
        """Use a corrected state and publish it."""
        self._state, self._unused = adapt_noise(predicted, fit.state), 0
        self._used += 1
        self._last_used_ns = view.newest.stamp_ns
        self._seen = None if fit.grey is None else SeenBody(fit.grey, self._state)
        if fit.rgb is not None and view.image is not None and self._model is not None:
            self._regions.learn(self._model, self._state.T, fit.rgb, view.image.value.camera_matrix)
        return self._published(view.newest, [*reasons, *fit.faults], fit.metrics)

    def _fit(
        self,
        view: RgbdSamples,
        model: ModelPreparationOutputs,
        predicted: TrackedState,
        transition: FloatArray,
    ) -> ViewFit:
        """Return the state corrected with texture, depths, sunlight, colours and edges, in this order.

        If none of them agrees, the orientation of all edges is used.
        """
        fit = ViewFit(predicted)
        if view.image is not None:
            check_undistorted(view.image.value)
            fit.grey = grey_image(view.image.value)
            self._correct_by_texture(view.image, model, transition, fit)
        if view.depth is not None:
            self._depth_ns = view.depth.stamp_ns
            delay_s = 0.0
            if view.image is not None and self._state is not None:
                interval_s = 1e-9 * (predicted.stamp_ns - self._state.stamp_ns)
                delay_s = self.config.depth_delay_sigma * interval_s
            self._correct_by_depths(view.depth, model, fit, delay_s)
        if view.image is not None:
            self._correct_by_shading(view.image, model, fit)
            self._correct_by_regions(view.image, model, fit)
            # The edges of a body are not where its shadows are; the rendering contains both.
            if not fit.has_shading:
                self._correct_by_edges(view.image, model, fit)
            if not (fit.used or fit.is_contradiction):
                self._correct_by_orientation(view.image, model, fit)
        if not fit.has_edges:
            fit.faults += [f"degenerate:{name}" for name in fit.weak]
        return fit

    def _correct_by_texture(
        self, sample: Sample, model: ModelPreparationOutputs, transition: FloatArray, fit: ViewFit
    ) -> None:
        """Correct the prediction of a fit with the motion since the previous image.

        It adds no knowledge of the pose itself: a state with this correction alone is still a prediction.
        """
        seen_body, cfg = self._seen, self.config
        if not cfg.texture or seen_body is None or fit.grey is None:
            return
        camera_matrix = sample.value.camera_matrix
        try:
            texture_fit = self._texture.fit(model, seen_body, fit.state, transition, fit.grey, camera_matrix)
        except RefusedError:
            return
        fit.metrics |= {"features": float(texture_fit.points), "texture_agreement": texture_fit.agreement}
        is_near = texture_fit.state.squared_distance(fit.state) < self._gate
        if texture_fit.agreement >= cfg.min_texture_agreement and is_near:
            fit.state = texture_fit.state

    def _correct_by_depths(
        self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit, delay_sigma_s: float
    ) -> None:
        """Correct the state of a fit with a depth image whose delay has the given standard deviation."""
        cfg = self.config
        # With the axes of the camera and the origin of the depth camera.
        state = replace(fit.state, T=moved(fit.state.T, -np.array(cfg.depth_offset_m)))
        try:
            points_m, step = self._body_points(sample, model, state)
        except InputError as error:
            fit.faults.append(f"bad_depth:{error}")
            return
        if len(points_m) < cfg.min_depth_points:
            fit.faults.append(f"few_depths:{len(points_m)}<{cfg.min_depth_points}")
            return
        if not self._depth_sigma_m:
            self._depth_sigma_m = bounded_noise(range_noise(points_m), model.diameter_m)
        try:
            depth_fit = self._fit_depths(model, state, points_m, delay_sigma_s)
            if self._is_underestimated(depth_fit):
                fit.faults.append(f"depth_innovation:{depth_fit.distance:.3g}>{self._gate:.3g}")
                factor = _MARGIN * depth_fit.distance / self._gate
                state = replace(state, covariance=factor * state.covariance)
                depth_fit = self._fit_depths(model, state, points_m, delay_sigma_s)
        except RefusedError as error:
            fit.faults.append(f"depth_{error.reasons[0]}")
            return
        fit.metrics |= {
            "depths": float(depth_fit.points),
            "depth_agreement": depth_fit.agreement,
            "depth_innovation": depth_fit.distance,
            "depth_sigma_m": self._depth_sigma_m,
            "hidden": depth_fit.in_front,
        }
        fault = ""
        if depth_fit.agreement < cfg.min_depth_agreement:
            fault = f"depth_low_agreement:{depth_fit.agreement:.2f}<{cfg.min_depth_agreement:g}"
        elif depth_fit.in_front > 1.0 - cfg.min_visible:
            fault = f"hidden:{depth_fit.in_front:.2f}>{1.0 - cfg.min_visible:g}"
        elif depth_fit.distance > self._gate:
            fault = f"depth_innovation:{depth_fit.distance:.3g}>{self._gate:.3g}"
            fit.is_contradiction = True
        if fault:
            fit.faults.append(fault)
            return
        if depth_fit.agreement < cfg.good_depth_agreement:
            fit.faults.append(f"depth_low_agreement:{depth_fit.agreement:.2f}<{cfg.good_depth_agreement:g}")
        visible = self._visible(sample, model, depth_fit, points_m, step)
        fit.metrics["visible"] = visible
        if visible < cfg.good_visible:
            fit.faults.append(f"partly_hidden:{visible:.2f}<{cfg.good_visible:g}")
        if len(depth_fit.weak_directions):
            fit.weak = direction_names(depth_fit.weak_directions)
        fit.state = replace(depth_fit.state, T=moved(depth_fit.state.T, np.array(cfg.depth_offset_m)))
        fit.has_depths = True
        if not cfg.depth_sigma_m:
            noise_m = bounded_noise(depth_fit.sigma_m, model.diameter_m)
            self._depth_sigma_m += _NOISE_GAIN * (noise_m - self._depth_sigma_m)

    def _fit_depths(
        self, model: ModelPreparationOutputs, state: TrackedState, points_m: FloatArray, delay_sigma_s: float
    ) -> ScanFit:
        times_s = np.zeros(len(points_m))
        return self._depths.fit(model, state, points_m, times_s, self._depth_sigma_m, delay_sigma_s)

    def _is_underestimated(self, depth_fit: ScanFit) -> bool:
        """Return whether the covariance of the prediction is too small: the depths agree with the model, and
        are only a few gates away from the prediction.
        """
        is_near = self._gate < depth_fit.distance < _NEAR_GATES * self._gate
        return is_near and depth_fit.agreement >= self.config.good_depth_agreement

    def _body_points(
        self, sample: Sample, model: ModelPreparationOutputs, state: TrackedState
    ) -> tuple[FloatArray, int]:
        """Return the depths near a state as points (n, 3) in the camera's axes, and the step of pixels."""
        centre_m, radius_m = body_ball(model, state)
        R = self._R_camera_depth
        points_m, step = points_near(sample.value, centre_m @ R, radius_m, self.config.max_depth_points)
        return np.ascontiguousarray(points_m @ R.T), step

    def _visible(
        self,
        sample: Sample,
        model: ModelPreparationOutputs,
        depth_fit: ScanFit,
        points_m: FloatArray,
        step: int,
    ) -> float:
        """Return the number of points on the body, relative to its pixels if nothing hides it."""
        image: DistanceImage = sample.value
        fx, fy = 1.0 / image.scale_x, 1.0 / image.scale_y
        camera = Window(fx, fy, -image.center_x * fx, -image.center_y * fy, image.height, image.width)
        T = se3.transform(self._R_camera_depth.T, np.zeros(3)) @ depth_fit.state.T
        pixels = silhouette_pixels(model.drawn_vertices, model.drawn_triangles, T, camera)
        limit_m = max(_SIGMAS * self._depth_sigma_m, _SPACING * model.diameter_m)
        count = int(np.count_nonzero(on_surface(model, depth_fit.state.T, points_m, limit_m)))
        return min(count * step**2 / max(pixels, 1.0), 1.0)

    def _correct_by_shading(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit by an image in the light of the Sun; nothing by default."""

    def _correct_by_orientation(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit by an image whose edges do not agree one by one; nothing by default."""

    def _correct_by_regions(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit by the colours of an image."""
        cfg = self.config
        if not cfg.colour or sample.value.image.ndim != 3:
            return
        fit.rgb = rgb_image(sample.value)
        try:
            region_fit = self._regions.fit(model, fit.state, fit.rgb, sample.value.camera_matrix)
        except RefusedError as error:
            fit.add_missing(f"region_{error.reasons[0]}")
            return
        fit.metrics |= {
            "lines": float(region_fit.lines),
            "region_agreement": region_fit.agreement,
            "region_innovation": region_fit.distance,
        }
        if region_fit.agreement < cfg.min_region_agreement:
            fit.add_missing(f"region_low_agreement:{region_fit.agreement:.2f}<{cfg.min_region_agreement:g}")
        elif region_fit.distance > self._gate:
            fit.faults.append(f"region_innovation:{region_fit.distance:.3g}>{self._gate:.3g}")
        else:
            fit.state, fit.has_regions = region_fit.state, True

    def _correct_by_edges(self, sample: Sample, model: ModelPreparationOutputs, fit: ViewFit) -> None:
        """Correct the state of a fit with the edges in an image."""
        cfg = self.config
        assert fit.grey is not None
        image = fit.grey.astype(np.float32)
        try:
            edge_fit = self._edges.fit(model, fit.state, image, sample.value.camera_matrix)
        except RefusedError as error:
            fit.add_missing(error.reasons[0])
            return
        fit.metrics |= {
            "points": float(edge_fit.points),
            "agreement": edge_fit.agreement,
            "innovation": edge_fit.distance,
            "sigma_px": edge_fit.sigma_px,
            "range_px": edge_fit.range_px,
        }
        if edge_fit.agreement < cfg.min_agreement:
            fit.add_missing(f"low_agreement:{edge_fit.agreement:.2f}<{cfg.min_agreement:g}")
            return
        if edge_fit.distance > self._gate:
            fit.faults.append(f"innovation:{edge_fit.distance:.3g}>{self._gate:.3g}")
            fit.is_contradiction = True
            return
        if edge_fit.agreement < cfg.good_agreement:
            fit.add_missing(f"low_agreement:{edge_fit.agreement:.2f}<{cfg.good_agreement:g}")
        fit.state, fit.has_edges = edge_fit.state, True

    def _guess_sigmas(self, model: ModelPreparationOutputs) -> FloatArray:
        """Return the standard deviations (6,) of a guess without covariance, metres and rad."""
        return np.repeat([self.config.guess_sigma * model.diameter_m, self.config.guess_sigma_rad], 3)

    def _sensor_frame(self, sample: Sample) -> str:
        return str(getattr(sample.value, "frame", "")) or sample.frame


def moved(T: FloatArray, by_m: FloatArray) -> FloatArray:
    """Return a pose (4, 4) moved by a vector (3,) in the frame."""
    return se3.transform(T[:3, :3], T[:3, 3] + by_m)
