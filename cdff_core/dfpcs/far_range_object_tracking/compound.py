# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of FarRangeObjectTracking: detect, identify stars, associate, filter, publish."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import IntArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, ProductNotFoundError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import (
    MatrixXd,
    ObjectDetections,
    ObjectTrack,
    ObjectTrackStatusT,
    Time,
)
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.bearing_tracking.local_orbital import LocalOrbitalAxes
from cdff_core.bearing_tracking.motion import BearingStates, across
from cdff_core.bearing_tracking.track_output import INERTIAL, LVLH, TrackState, object_track
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs
from cdff_core.dfns.multi_target_association.interface import (
    MultiTargetAssociationInputs,
    MultiTargetAssociationOutputs,
)
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig
from cdff_core.dfpcs.far_range_object_tracking.image_sources import (
    ImageSources,
    SourceExtractor,
    source_detection,
)
from cdff_core.dfpcs.far_range_object_tracking.interface import FarRangeObjectTrackingInterface
from cdff_core.dfpcs.far_range_object_tracking.star_attitude import AttitudeEstimator
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import TargetRange, TargetRanging

#: Status of an object for each state that the association returns.
_STATUS = (
    ObjectTrackStatusT.TRACK_TENTATIVE,
    ObjectTrackStatusT.TRACK_CONFIRMED,
    ObjectTrackStatusT.TRACK_COASTING,
    ObjectTrackStatusT.TRACK_LOST,
)
#: Distance of two sources that cannot be separated, in standard deviations of the point spread.
_BLEND_SIGMAS = 4.0
#: Standard deviation of the position of a body relative to its light, in extents of the light.
_LIGHT_OFFSET = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class _Tracked:
    """The confirmed objects after an image: numbers and states."""

    stamp_ns: int
    ids: IntArray
    states: BearingStates


class FarRangeObjectTracking(FarRangeObjectTrackingInterface):
    """Tracking of objects among the stars."""

    Config = FarRangeObjectTrackingConfig
    config: FarRangeObjectTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._extractor = SourceExtractor(
            self.dfn("background"),
            self.dfn("detect"),
            self.dfn("detect_weak"),
            self.dfn("centroid"),
            self.config.point_spread_px,
            self.config.saturation_dn,
        )
        self._attitudes = AttitudeEstimator(
            self.dfn("identify"), self.dfn("attitude"), self.config, self.context.frames
        )
        self._filter = self.dfn("filter")
        self._ranging = TargetRanging(self.dfn("range"), self.config)
        self._frame: str | None = None
        self._tracked: _Tracked | None = None
        self._newest: ObjectTrack | None = None
        self.store.offer("tracks", lambda: self._newest)
        self.store.offer("point_spread", lambda: MatrixXd(self._extractor.point_spread))

    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store the attitude for the image of its time."""
        self._attitudes.give(sample)
        return ()

    def on_navigation(self, sample: Sample) -> Iterable[Output]:
        """Store the velocity for the aberration of the stars."""
        self._attitudes.give_navigation(sample)
        return ()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Store the mesh of the target."""
        self._ranging.give_model(sample)
        return ()

    def on_body_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store the attitude of the target."""
        self._ranging.give_attitude(sample)
        return ()

    def on_sun(self, sample: Sample) -> Iterable[Output]:
        """Store the direction of the Sun."""
        self._ranging.give_sun(sample)
        return ()

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process one image.

        Raises
        ------
        InputError
            If the image has no camera, or is not later than the previous one.
        """
        camera = CameraModel.of_frame(sample.value)
        if self._tracked is not None and sample.stamp_ns <= self._tracked.stamp_ns:
            raise InputError(
                f"image at {sample.stamp_ns} ns: expected later than the previous one,"
                f" {self._tracked.stamp_ns} ns"
            )
        reasons: tuple[str, ...] = ()
        try:
            sources = self._extractor.extract(sample.value)
        except RefusedError as refusal:
            if self._tracked is None:
                return [self._no_detections(sample, Quality.from_error(refusal))]
            sources, reasons = None, tuple(refusal.reasons)
        if sources is None:
            return self._coast(sample, camera, reasons)
        attitude = self._attitudes.estimate(
            sample.stamp_ns,
            camera,
            sources.pixels,
            sources.sigmas_px,
            sources.snr,
            self._camera_frame(sample),
        )
        if self._extractor.is_smeared:
            reasons += ("smeared",)
        reasons += attitude.reasons
        frame = self._frame_of(sample, attitude)
        if frame is None:
            return self._coast(sample, camera, reasons)
        sources = self._with_weak(sources, attitude, camera, sample.stamp_ns)
        association, source_rows = self._associate(sample.stamp_ns, camera, attitude, sources)
        outputs = self._outputs(sample, camera, attitude, sources.selected(source_rows), association, reasons)
        if attitude.is_from_stars:
            outputs.append(self._attitude_output(sample, attitude))
        return outputs

    def predict(self, id: int, t_ns: int) -> ObjectTrack:
        """Return direction and covariance of an object at a time.

        Raises
        ------
        ProductNotFoundError
            If there is no such object.
        InputError
            If the time is before the last image.
        """
        last_tracks = self._tracked
        if last_tracks is None or id not in last_tracks.ids:
            known_ids = [] if last_tracks is None else last_tracks.ids.tolist()
            raise ProductNotFoundError(f"object {id}: expected one of {known_ids}")
        t_ns = last_tracks.stamp_ns if t_ns < 0 else t_ns
        states = self._predict_states(last_tracks, t_ns)
        i = int(np.flatnonzero(last_tracks.ids == id)[0])
        nothing = np.full(2, np.nan)
        state = TrackState(
            id,
            states.directions[i],
            states.rates[i],
            states.covariances[i],
            nothing,
            nothing,
            ObjectTrackStatusT.TRACK_COASTING,
            0.0,
        )
        return object_track(state, t_ns, self._frame or INERTIAL, self.name)

    def _frame_of(self, sample: Sample, attitude: CameraAttitude) -> str | None:
        """Return the frame of the objects at an image; None if the objects are in the inertial frame, and the
        attitude is not known.

        Objects that were tracked in the camera frame are cleared when the attitude becomes known.
        """
        if attitude.rotation is None:
            frame = sample.frame or f"{self.context.robot}/camera"
            if self._frame == INERTIAL:
                return None
        else:
            frame = INERTIAL
        if frame != self._frame:
            self._frame, self._tracked = frame, None
            self._association = self.dfn("associate")
        return frame

    def _with_weak(
        self, sources: ImageSources, attitude: CameraAttitude, camera: CameraModel, stamp_ns: int
    ) -> ImageSources:
        """Add the weak sources near the predicted image positions of the objects."""
        self._star_count = int(attitude.stars.sum())
        is_star = attitude.stars
        strong = sources.selected(~is_star)
        self._stars_px = sources.pixels[is_star]
        if self._tracked is None or len(self._tracked.ids) == 0:
            return strong
        states = self._predict_states(self._tracked, stamp_ns)
        positions_px = attitude.pixels(camera, states.directions)
        position_covariances, _ = across(states)
        reach = 4.0 * np.sqrt(np.linalg.eigvalsh(position_covariances)[:, -1]) * camera.fx + 2.0
        for position_px, reach_px in zip(positions_px, reach, strict=True):
            if np.isfinite(position_px).all() and reach_px < self.config.weak_window_px:
                weak = self._extractor.weak_sources(position_px, float(reach_px), sources.pixels)
                strong = ImageSources.joined(strong, weak)
        return strong

    def _associate(
        self, stamp_ns: int, camera: CameraModel, attitude: CameraAttitude, sources: ImageSources
    ) -> tuple[MultiTargetAssociationOutputs, IntArray]:
        """Associate the sources that are no defects; return the objects and these sources."""
        source_rows = np.flatnonzero(~sources.is_defect)
        selected_sources = sources.selected(source_rows)
        directions = attitude.directions(camera, selected_sources.pixels)
        covariances = attitude.covariances(camera, selected_sources.covariances, directions)
        # The stars of the catalogue that are no sources of their own.
        stars = attitude.directions(camera, self._stars_px)
        spread_px = float(np.sqrt(np.linalg.eigvalsh(self._extractor.point_spread)[-1]))
        association = self._association.process(
            MultiTargetAssociationInputs(
                stamp=stamp_ns,
                directions=directions,
                covariances=covariances,
                snr=selected_sources.snr,
                pixels=selected_sources.pixels,
                can_start=~selected_sources.is_weak,
                defect_evidence=selected_sources.evidence,
                stars=stars[np.isfinite(stars).all(axis=1)],
                blend_angle=max(_BLEND_SIGMAS * spread_px, 1.5) / camera.fx,
                solid_angle=camera.rows * camera.cols / (camera.fx * camera.fy),
                is_dark=False,
            )
        )
        self._keep(stamp_ns, association)
        return association, source_rows

    def _coast(self, sample: Sample, camera: CameraModel, reasons: tuple[str, ...]) -> list[Output]:
        """Publish the predicted objects of an image that cannot be used."""
        none = np.zeros(0)
        association = self._association.process(
            MultiTargetAssociationInputs(
                stamp=sample.stamp_ns,
                directions=np.zeros((0, 3)),
                covariances=np.zeros((0, 3, 3)),
                snr=none,
                pixels=np.zeros((0, 2)),
                can_start=none.astype(bool),
                defect_evidence=none,
                stars=np.zeros((0, 3)),
                blend_angle=1.0 / camera.fx,
                solid_angle=camera.rows * camera.cols / (camera.fx * camera.fy),
                is_dark=True,
            )
        )
        self._keep(sample.stamp_ns, association)
        unknown = CameraAttitude(None, np.zeros((3, 3)), none.astype(bool))
        return self._outputs(sample, camera, unknown, None, association, reasons)

    def _keep(self, stamp_ns: int, association: MultiTargetAssociationOutputs) -> None:
        alive = (association.states == 1) | (association.states == 2)
        states = BearingStates(
            association.object_directions, association.rates, association.object_covariances
        )
        self._tracked = _Tracked(stamp_ns, association.ids[alive], states.selected(alive))

    def _predict_states(self, tracks: _Tracked, stamp_ns: int) -> BearingStates:
        """Return the states of the objects that the filter predicts for a time."""
        result = self._filter.process(
            BearingFilteringInputs(
                directions=tracks.states.directions,
                rates=tracks.states.rates,
                covariances=tracks.states.covariances,
                interval=(stamp_ns - tracks.stamp_ns) * 1e-9,
            )
        )
        return BearingStates(result.directions, result.rates, result.covariances)

    def _outputs(
        self,
        sample: Sample,
        camera: CameraModel,
        attitude: CameraAttitude,
        sources: ImageSources | None,
        association: MultiTargetAssociationOutputs,
        reasons: tuple[str, ...],
    ) -> list[Output]:
        """Return a track for each confirmed object, and the detections of the image."""
        frame = self._frame or INERTIAL
        outputs = []
        detections = []
        is_frame_known = attitude.rotation is not None or frame != INERTIAL
        positions_px = np.full((len(association.ids), 2), np.nan)
        if is_frame_known:
            positions_px = attitude.pixels(camera, association.object_directions)
        position, _ = across(
            BearingStates(association.object_directions, association.rates, association.object_covariances)
        )
        axes = self._attitudes.orbital_axes(sample.stamp_ns) if frame == INERTIAL else None
        target, range_measurement = self._target_range(
            sample.stamp_ns, camera, attitude, sources, association
        )
        # The last output is the newest product: lost objects come first, the ranged target at the end.
        rows = np.flatnonzero(association.states > 0)
        for i in sorted(rows, key=lambda i: (i == target, -association.states[i], -association.ids[i])):
            source = int(association.sources[i])
            status = _STATUS[int(association.states[i])]
            pixel, sigma_px = positions_px[i], np.full(2, np.sqrt(0.5 * np.trace(position[i])) * camera.fx)
            if sources is not None and source >= 0 and status is ObjectTrackStatusT.TRACK_CONFIRMED:
                pixel = sources.pixels[source]
                sigma_px = np.sqrt(np.diag(sources.covariances[source]))
                detections.append(source_detection(sources, source, int(association.ids[i])))
            inside = np.all((pixel >= -0.5) & (pixel <= np.array([camera.cols, camera.rows]) - 0.5))
            if not inside:
                pixel, sigma_px = np.full(2, np.nan), np.full(2, np.nan)
            score = 1.0 - np.exp(-max(float(association.scores[i]), 0.0))
            # Errors of lens and catalogue are the same in all images: the filter does not average them.
            covariance = association.object_covariances[i].copy()
            covariance[:3, :3] += np.eye(3) * (attitude.lens_rad**2 + attitude.bias_rad**2)
            if sources is not None and source >= 0 and sources.is_extended[source]:
                # The centroid of the light of a partly shadowed body differs from the centre of the body.
                box = sources.boxes[source]
                extent_rad = max(box[1] - box[0], box[3] - box[2]) / camera.fx
                covariance[:3, :3] += np.eye(3) * (_LIGHT_OFFSET * extent_rad) ** 2
            ranging = range_measurement if i == target else None
            state = TrackState(
                int(association.ids[i]),
                association.object_directions[i],
                association.rates[i],
                covariance,
                pixel,
                sigma_px,
                status,
                float(score),
            )
            if ranging is not None:
                state = replace(
                    state,
                    range_m=ranging.range_m,
                    range_sigma_m=ranging.sigma_m,
                    size_m=np.full(3, ranging.size_m),
                    label=ranging.body,
                )
                outputs.append(self._position_output(sample, ranging))
            track = object_track(state, sample.stamp_ns, frame, self.name)
            output = self._track_output(
                sample, track, frame, attitude, reasons, int(association.hypotheses[i]), ranging
            )
            if axes is not None:
                outputs.append(self._lvlh_output(output, state, axes))
            outputs.append(output)
        message = ObjectDetections(
            time_stamp=Time.from_ns(sample.stamp_ns),
            producer_id=self.name,
            sensor_id=sample.value.frame,
            frame_id=self._camera_frame(sample),
            detections=tuple(detections),
        )
        quality = Quality(Status.DEGRADED if reasons else Status.OK, reasons, CovarianceKind.NONE)
        outputs.append(
            self._output(sample, "detections", message, self._camera_frame(sample), quality, attitude)
        )
        return outputs

    def _track_output(
        self,
        sample: Sample,
        track: ObjectTrack,
        frame: str,
        attitude: CameraAttitude,
        reasons: tuple[str, ...],
        hypotheses: int,
        ranging: TargetRange | None,
    ) -> Output:
        """Return the track of an object with its quality."""
        status = track.metadata.status
        track_reasons: list[str] = [] if ranging is None else list(ranging.reasons)
        if status is ObjectTrackStatusT.TRACK_COASTING:
            track_reasons.append("coasting")
        if status is ObjectTrackStatusT.TRACK_LOST:
            track_reasons.append("lost")
        if not np.isfinite(track.data.bearings[0, 4]):
            track_reasons.append("range_unobservable")
        limited = [*reasons, *track_reasons]
        is_degraded = (
            bool(reasons or (ranging and ranging.reasons)) or status is not ObjectTrackStatusT.TRACK_CONFIRMED
        )
        metrics = {"hypotheses": float(hypotheses), "sigma_rad": float(track.data.bearings[0, 2:4].max())}
        if ranging is not None:
            metrics |= ranging.metrics
        if attitude.is_from_stars:
            metrics |= {"stars": float(attitude.stars.sum()), "stars_rms_rad": attitude.residual_rad}
        quality = Quality(
            Status.DEGRADED if is_degraded else Status.OK, tuple(limited), self.covariance_kind, metrics
        )
        self._newest = track
        return self._output(sample, "track", track, frame, quality, attitude)

    def _lvlh_output(self, inertial: Output, state: TrackState, axes: LocalOrbitalAxes) -> Output:
        """Return the state of an inertial track in the LVLH axes of the carrier."""
        frame = f"{self.context.robot}{LVLH}"
        quality = inertial.quality
        if not np.isfinite(axes.sigma_rad):
            axes = replace(axes, sigma_rad=0.0)
            reasons = (*quality.reasons, "navigation_covariance_unknown")
            quality = replace(quality, status=Status.DEGRADED, reasons=reasons)
        track = object_track(state.in_axes(axes), inertial.t1_ns, frame, self.name)
        return replace(inertial, port="track_lvlh", value=track, frame=frame, quality=quality)

    def _target_range(
        self,
        stamp_ns: int,
        camera: CameraModel,
        attitude: CameraAttitude,
        sources: ImageSources | None,
        association: MultiTargetAssociationOutputs,
    ) -> tuple[int, TargetRange | None]:
        """Return the row of the largest resolved object and its range; (-1, None) without one."""
        image = self._extractor.image
        if sources is None or image is None or not self._ranging.has_size:
            return -1, None
        rows = np.flatnonzero((association.states == 1) & (association.sources >= 0))
        rows = rows[sources.is_extended[association.sources[rows]]]
        if len(rows) == 0:
            return -1, None
        boxes = sources.boxes[association.sources[rows]]
        largest = int(np.argmax((boxes[:, 1] - boxes[:, 0] + 1) * (boxes[:, 3] - boxes[:, 2] + 1)))
        try:
            target_range = self._ranging.measure(
                stamp_ns, camera, attitude, image, boxes[largest], self._extractor.point_spread
            )
        except RefusedError:  # not resolved: the track has the reason range_unobservable
            return -1, None
        return int(rows[largest]), target_range

    def _position_output(self, sample: Sample, ranging: TargetRange) -> Output:
        """Return T_camera_body for the compounds of close range."""
        status = Status.DEGRADED if ranging.reasons else Status.OK
        quality = Quality(status, ranging.reasons, CovarianceKind.FORMAL, ranging.metrics)
        return Output.of_pose(
            "position",
            ranging.T_camera_body,
            stamp_ns=sample.stamp_ns,
            frame=self._camera_frame(sample),
            child=f"{ranging.body}/body",
            quality=quality,
            inputs=(sample.id, *ranging.inputs),
            producer=self.name,
        )

    def _attitude_output(self, sample: Sample, attitude: CameraAttitude) -> Output:
        """Return the attitude estimated from stars."""
        assert attitude.rotation is not None
        covariance = np.zeros((6, 6))
        covariance[3:, 3:] = attitude.covariance
        T = UncertainTransform(se3.transform(attitude.rotation, np.zeros(3)), covariance)
        metrics = {
            "stars": float(attitude.stars.sum()),
            "residual_rad": attitude.residual_rad,
            "focal_length_ratio": attitude.scale,
        }
        status = Status.DEGRADED if attitude.reasons else Status.OK
        quality = Quality(status, ("rotation_only", *attitude.reasons), CovarianceKind.FORMAL, metrics)
        return Output.of_pose(
            "attitude_estimate",
            T,
            stamp_ns=sample.stamp_ns,
            frame=INERTIAL,
            child=self._camera_frame(sample),
            quality=quality,
            inputs=(sample.id, *attitude.inputs),
            producer=self.name,
        )

    def _output(
        self,
        sample: Sample,
        port: str,
        value: ObjectTrack | ObjectDetections | None,
        frame: str,
        quality: Quality,
        attitude: CameraAttitude | None = None,
    ) -> Output:
        """Return a product of an image."""
        inputs = (sample.id, *(attitude.inputs if attitude is not None else ()))
        return Output(port, value, sample.stamp_ns, sample.stamp_ns, frame, None, quality, inputs)

    def _no_detections(self, sample: Sample, quality: Quality) -> Output:
        return self._output(sample, "detections", None, self._camera_frame(sample), quality)

    def _camera_frame(self, sample: Sample) -> str:
        return sample.frame or sample.value.frame or f"{self.context.robot}/camera"
