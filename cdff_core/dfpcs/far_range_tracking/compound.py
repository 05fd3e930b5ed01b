# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of FarRangeTracking: register, detect, associate, filter, range, publish."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, ProductNotFoundError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import (
    Frame,
    FramePair,
    ObjectDetection,
    ObjectDetections,
    ObjectTrack,
    ObjectTrackStatusT,
    Time,
)
from cdff_core.bearing_tracking.track_output import TrackState, object_track
from cdff_core.dfns.moving_region_detection.interface import (
    MovingRegionDetectionInputs,
    MovingRegionDetectionOutputs,
)
from cdff_core.dfns.scene_registration.interface import SceneRegistrationInputs, SceneRegistrationOutputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.interface import FarRangeTrackingInterface
from cdff_core.dfpcs.far_range_tracking.object_tracks import ObjectTracks
from cdff_core.dfpcs.far_range_tracking.observer import (
    Observer,
    ObserverTrack,
    continue_attitude,
    rotation_homography,
)
from cdff_core.dfpcs.far_range_tracking.scene import Scene
from cdff_core.dfpcs.far_range_tracking.target_range import TargetRange, fuse_ranges
from cdff_core.dfpcs.far_range_tracking.tracked_object import TrackedObject
from cdff_core.imaging.frames import check_undistorted
from cdff_core.imaging.grey import grey_image

#: Noise of a pixel until the background is known, grey levels.
_FIRST_NOISE = 2.0


class FarRangeTracking(FarRangeTrackingInterface):
    """Tracking of distant objects on the ground."""

    Config = FarRangeTrackingConfig
    config: FarRangeTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store items."""
        self._register, self._detect = self.dfn("registration"), self.dfn("detect")
        self._tracks = ObjectTracks(
            self.dfn("filter"), self.dfn("coast"), self.dfn("match"), self.dfn("associate"), self.config
        )
        self._observers = ObserverTrack(self.config, self.context.frames)
        self._ranges = TargetRange(self.dfn("match"), self.dfn("terrain"), self.config)
        self._previous: np.ndarray | None = None
        self._observer: Observer | None = None
        self._stamp_ns: int | None = None
        self._designations: Sample | None = None
        self._noise = _FIRST_NOISE
        self._newest: ObjectTrack | None = None
        self.store.offer("tracks", lambda: self._newest)

    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Store the attitude for the image of its time."""
        self._observers.give_attitude(sample)
        return ()

    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Store the pose of the observer."""
        self._observers.give_pose(sample)
        return ()

    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Store the elevation map."""
        self._ranges.give_dem(sample)
        return ()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Store the height of the object."""
        self._ranges.give_model(sample)
        return ()

    def on_designation(self, sample: Sample) -> Iterable[Output]:
        """Store the boxes for the image of their time, or the next one."""
        self._designations = sample
        return ()

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process one image; raises InputError for the same reasons as ``on_pair``."""
        return self._process(sample, sample.value, None)

    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Process a rectified pair.

        Raises
        ------
        InputError
            If an image has no camera, is not of 8 bit, has another size than the previous one, or is not
            later; if the pair is not rectified.
        """
        check_undistorted(sample.value.left, sample.value.right)
        return self._process(sample, sample.value.left, sample.value)

    def predict(self, id: int, t_ns: int) -> ObjectTrack:
        """Return direction and covariance of an object at a time.

        Raises
        ------
        ProductNotFoundError
            If there is no such object.
        InputError
            If the time is before the last image.
        """
        matching_objects = [o for o in self._tracks.confirmed if o.number == id]
        if not matching_objects or self._observer is None or self._stamp_ns is None:
            raise ProductNotFoundError(
                f"object {id}: expected one of {[o.number for o in self._tracks.confirmed]}"
            )
        t_ns = self._stamp_ns if t_ns < 0 else t_ns
        if t_ns < self._stamp_ns:
            raise InputError(f"t_ns={t_ns}: expected {self._stamp_ns} or later")
        states = self._tracks.predicted(matching_objects[0], t_ns)
        nothing = np.full(2, np.nan)
        direction, rate, covariance = states.directions[0], states.rates[0], states.covariances[0]
        if self._observer.is_camera:
            direction, rate, covariance = _rotate_state(
                self._observer.rotation.T, direction, rate, covariance
            )
        state = TrackState(
            id, direction, rate, covariance, nothing, nothing, ObjectTrackStatusT.TRACK_COASTING, 0.0
        )
        return object_track(state, t_ns, self._observer.frame, self.name, self._observer.axes)

    def _process(self, sample: Sample, frame: Frame, pair: FramePair | None) -> list[Output]:
        """Run the control sequence for one image, with its pair if there is one."""
        camera = CameraModel.of_frame(frame)
        image = grey_image(frame)
        self._check(sample, image)
        camera_frame = sample.frame or frame.frame or f"{self.context.robot}/camera"
        stated_observer = self._observers.at(sample.stamp_ns, camera_frame)
        registration, reasons = self._register_image(image, stated_observer, camera)
        observer = self._current_observer(stated_observer, registration, camera, camera_frame)
        regions, refused = self._detect_regions(image, registration)
        reasons = (*reasons, *refused, *self._observers.reasons)
        scene = Scene(
            sample.stamp_ns,
            image,
            camera,
            observer,
            regions,
            registration,
            None if self._observer is None else rotation_homography(self._observer, observer, camera),
            self._noise,
        )
        lost = self._tracks.step(scene)
        self._designate(scene)
        images = None if pair is None else (image, grey_image(pair.right))
        for o in self._tracks.confirmed:
            self._measure_range(o, scene, pair, images)
        self._previous, self._observer, self._stamp_ns = image, observer, sample.stamp_ns
        return self._outputs(sample, scene, lost, camera_frame, reasons)

    def _check(self, sample: Sample, image: np.ndarray) -> None:
        """Raise InputError if the image is not later than the previous one or differs in size."""
        if self._stamp_ns is not None and sample.stamp_ns <= self._stamp_ns:
            raise InputError(
                f"image at {sample.stamp_ns} ns: expected later than the previous one, {self._stamp_ns} ns"
            )
        if self._previous is not None and image.shape != self._previous.shape:
            raise InputError(
                f"image {image.shape}: expected the size of the previous one, {self._previous.shape}"
            )

    def _register_image(
        self, image: np.ndarray, stated_observer: Observer | None, camera: CameraModel
    ) -> tuple[SceneRegistrationOutputs | None, tuple[str, ...]]:
        """Return the registration with the previous image, None without one, and the reasons of a refusal."""
        if self._previous is None:
            return None, ()
        guess = None
        if (
            stated_observer is not None
            and self._observer is not None
            and self._observer.frame == stated_observer.frame
        ):
            guess = rotation_homography(self._observer, stated_observer, camera)
        try:
            return self._register.process(
                SceneRegistrationInputs(previous=self._previous, current=image, guess=guess)
            ), ()
        except RefusedError as refusal:
            return None, tuple(refusal.reasons)

    def _current_observer(
        self,
        stated_observer: Observer | None,
        registration: SceneRegistrationOutputs | None,
        camera: CameraModel,
        camera_frame: str,
    ) -> Observer:
        """Return the observer at this image; if its frame is new, express all objects in that frame."""
        previous = self._observer
        if previous is None:
            return stated_observer or self._observers.start(camera_frame)
        H = None if registration is None else registration.homography
        observer_by_images = continue_attitude(previous, H, camera)
        if stated_observer is None:
            return observer_by_images
        if stated_observer.frame != previous.frame:
            self._tracks.rotate(stated_observer.rotation @ observer_by_images.rotation.T)
        return stated_observer

    def _detect_regions(
        self, image: np.ndarray, registration: SceneRegistrationOutputs | None
    ) -> tuple[MovingRegionDetectionOutputs | None, tuple[str, ...]]:
        """Return the moving regions, None if the image cannot be compared, and the reasons of a refusal."""
        if registration is None and self._previous is not None:
            return None, ()
        try:
            detected_regions = self._detect.process(
                MovingRegionDetectionInputs(
                    image=image,
                    places=None if registration is None else registration.places,
                    sigma=None if registration is None else registration.sigma,
                    is_at_rest=registration is None or registration.is_at_rest,
                    excluded=self._tracks.occupied(image.shape),
                    departed=self._tracks.occupied(image.shape, departed=True),
                    replaced=self._tracks.resting(image.shape),
                )
            )
        except RefusedError as refusal:
            return None, tuple(refusal.reasons)
        self._noise = detected_regions.noise
        return detected_regions, ()

    def _designate(self, scene: Scene) -> None:
        """Start the objects of stored boxes."""
        if self._designations is None or self._designations.stamp_ns > scene.stamp_ns:
            return
        for detection in self._designations.value.detections:
            u, v, w, h = detection.image_box
            if w > 0.0 and h > 0.0:
                self._tracks.designate(np.array([u, u + w - 1.0, v, v + h - 1.0]), detection.label, scene)
        self._designations = None

    def _measure_range(
        self,
        o: TrackedObject,
        scene: Scene,
        pair: FramePair | None,
        images: tuple[np.ndarray, np.ndarray] | None,
    ) -> None:
        """Measure the range of an object seen in this image and update its range filter."""
        o.range_reasons = ()
        if o.misses:
            return
        ranges = self._ranges.measure(o, scene.camera, scene.observer, pair, images, scene.noise)
        if ranges:
            mean, o.range_reasons = fuse_ranges(ranges, o.range.value)
            if mean is None:
                return
            o.range_inputs = self._ranges.inputs(ranges)
            o.range.update(scene.stamp_ns, mean.range_m, mean.sigma_m, mean.systematic)

    # -- outputs

    def _outputs(
        self,
        sample: Sample,
        scene: Scene,
        lost: list[TrackedObject],
        camera_frame: str,
        reasons: tuple[str, ...],
    ) -> list[Output]:
        """Return the tracks of lost and confirmed objects, and the detections of the image."""
        outputs, detections = [], []
        reasons = (*reasons, *scene.observer.reasons)
        # The last output is the newest product: objects that are visible come last.
        order = sorted(self._tracks.confirmed, key=lambda o: (o.misses == 0, -o.number))
        for o in [*lost, *order]:
            outputs.append(self._track_output(sample, scene, o, reasons))
            if np.isfinite(o.box).all() and o.misses == 0:
                u0, u1, v0, v1 = o.box
                detections.append(
                    ObjectDetection(
                        label=o.label or f"object {o.number}",
                        score=float(np.clip(o.score, 0.0, 1.0)),
                        image_box=np.array([u0, v0, u1 - u0, v1 - v0]),
                    )
                )
        message = ObjectDetections(
            time_stamp=Time.from_ns(sample.stamp_ns),
            producer_id=self.name,
            sensor_id=camera_frame,
            frame_id=camera_frame,
            detections=tuple(detections),
        )
        quality = Quality(Status.DEGRADED if reasons else Status.OK, reasons, CovarianceKind.NONE)
        stamp_ns = sample.stamp_ns
        outputs.append(
            Output("detections", message, stamp_ns, stamp_ns, camera_frame, None, quality, (sample.id,))
        )
        return outputs

    def _track_output(
        self, sample: Sample, scene: Scene, o: TrackedObject, reasons: tuple[str, ...]
    ) -> Output:
        """Return the track of an object with its quality."""
        observer = scene.observer
        covariance = o.states.covariances[0].copy()
        # The error of the attitude is the same in many images: the filter does not average it.
        covariance[:3, :3] += np.eye(3) * (observer.attitude.bias_rad**2 if not observer.is_camera else 0.0)
        direction, rate = o.direction, o.states.rates[0]
        if observer.is_camera:
            direction, rate, covariance = _rotate_state(observer.rotation.T, direction, rate, covariance)
        pixel, sigma_px = self._pixel(scene, o)
        range_m, range_sigma_m = o.range.value
        has_position = observer.position_m is not None and np.isfinite(range_m)
        state = TrackState(
            o.number,
            direction,
            rate,
            covariance,
            pixel,
            sigma_px,
            o.status,
            float(np.clip(o.score, 0.0, 1.0)),
            range_m=range_m,
            range_sigma_m=range_sigma_m,
            label=o.label,
            origin_m=observer.position_m if has_position else None,
            origin_covariance=observer.position_covariance if has_position else None,
            is_located=observer.position_m is not None or not observer.has_origin,
        )
        track = object_track(state, sample.stamp_ns, observer.frame, self.name, observer.axes)
        track_reasons = list(o.range_reasons)
        if o.status is ObjectTrackStatusT.TRACK_COASTING:
            track_reasons.append("coasting")
        elif o.status is ObjectTrackStatusT.TRACK_LOST:
            track_reasons.append("lost")
        elif not o.is_whole:
            track_reasons.append("partly_visible")
        if not np.isfinite(range_m):
            track_reasons.append("range_unobservable")
        is_degraded = bool(reasons or o.range_reasons) or o.status is not ObjectTrackStatusT.TRACK_CONFIRMED
        quality = Quality(
            Status.DEGRADED if is_degraded else Status.OK,
            (*reasons, *track_reasons),
            self.covariance_kind,
            {"sigma_rad": float(track.data.bearings[0, 2:4].max()), "size_px": float(o.size_px.max())},
        )
        self._newest = track
        stamp_ns = sample.stamp_ns
        inputs = (sample.id, *observer.inputs, *o.range_inputs)
        return Output("track", track, stamp_ns, stamp_ns, observer.frame, None, quality, inputs)

    @staticmethod
    def _pixel(scene: Scene, o: TrackedObject) -> tuple[FloatArray, FloatArray]:
        """Return the image position (2,), measured or else predicted, and its standard deviations (2,),
        pixels.

        NaN for a predicted position outside the image.
        """
        if o.misses == 0:
            return o.pixel, np.sqrt(np.diag(o.pixel_covariance))
        pixel = scene.observer.attitude.pixels(scene.camera, o.states.directions)[0]
        size = np.array([scene.camera.cols, scene.camera.rows])
        if not np.all((pixel >= -0.5) & (pixel <= size - 0.5)):
            return np.full(2, np.nan), np.full(2, np.nan)
        trace = float(np.trace(o.states.covariances[0, :3, :3]))
        return pixel, np.full(2, np.sqrt(0.5 * trace) * scene.camera.fx)


def _rotate_state(
    R_new_old: FloatArray, direction: FloatArray, rate: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return direction, rate and covariance, rotated into other axes by ``R_new_old`` (3, 3)."""
    block_rotation = np.kron(np.eye(2), R_new_old)
    return R_new_old @ direction, R_new_old @ rate, block_rotation @ covariance @ block_rotation.T
