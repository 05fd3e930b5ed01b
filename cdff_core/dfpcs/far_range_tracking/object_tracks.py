# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All tracked objects of a camera: prediction, association, correction, start and end."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ObjectTrackStatusT
from cdff_core.bearing_tracking.motion import (
    BearingStates,
    across,
    join_states,
    states_at_rest,
)
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingInputs, AppearanceTrackingOutputs
from cdff_core.dfns.track_association.interface import TrackAssociationInputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.continuation import (
    EARLY_HITS,
    coasting_predecessor,
    motion_distance,
    moves_steadily,
)
from cdff_core.dfpcs.far_range_tracking.object_motion import ObjectMotion
from cdff_core.dfpcs.far_range_tracking.observer import Observer
from cdff_core.dfpcs.far_range_tracking.scene import Scene, boxes_around
from cdff_core.dfpcs.far_range_tracking.tracked_object import Appearance, TrackedObject

#: Reach of the search for the appearance: standard deviations of the predicted position, and bounds, pixels.
_REACH_SIGMAS, _REACH_PX = 3.0, (4.0, 30.0)
#: Correlation from which the appearance alone is a measurement, and by how much it must exceed the
#: correlation at the next best position.
_ALONE_SCORE, _DISTINCT = 0.8, 0.1
#: Least size for a measurement by appearance alone, pixels.
_ALONE_PX = 6.0
#: Standard deviation of the position of a region: from its varying shape, relative to the size of the object,
#: and the constant part, pixels.
_SHAPE_ERROR, _SHAPE_PX = 0.01, 0.15
#: Standard deviation of the position of a partly hidden object from its edges, relative to its size.
_EDGES_ERROR = 0.07
#: Correlation of an object with the region of another one: never associated.
_OTHER = -1.0
#: Largest distance between the positions of region and appearance that agree, relative to the size.
_AGREE = 0.3
#: Number of successive images with a different size after which that size is adopted.
_NEW_SIZE = 20
#: An unconfirmed object is removed after more missed images than this, or, if it has not moved, after this
#: many measurements.
_MAX_MISSES, _MAX_AGE = 2, 40
#: Largest squared normalised difference of motion and ratio of sizes of two tracks of the same object.
_REPEATS, _REPEATS_SIZE = 16.0, 1.6
#: Least sharpness of a new object, 1/pixel: dust has less.
_SHARP = 0.12
#: Largest area, distance and difference of motion, relative to an object, of its parts and its shadow.
_COMPANION_AREA, _COMPANION_DISTANCE, _COMPANION_MOTION = 0.5, 4.0, 0.5
#: Objects with fewer measurements than this are lost after twice as many misses as measurements.
_BRIEF = 10
#: Distance, relative to the size, below which two tracks follow the same object.
_SAME = 0.35
#: Squared normalised innovation above which a measurement does not belong to a coasting object.
_CONTRADICTS = 30.0
#: Number of measurements between two tests whether an object is at rest.
_REST_HITS = 20


class ObjectTracks:
    """Tracked objects.

    Parameters
    ----------
    filter_seen, coast, match, associate : Dfn
        Filters of seen and of coasting objects, comparison of the appearance, association with regions.
    """

    def __init__(
        self,
        filter_seen: Dfn[Any, Any, Any],
        coast: Dfn[Any, Any, Any],
        match: Dfn[Any, Any, Any],
        associate: Dfn[Any, Any, Any],
        config: FarRangeTrackingConfig,
    ) -> None:
        self._motion = ObjectMotion(filter_seen, coast)
        self._match, self._associate, self._config = match, associate, config
        self.objects: list[TrackedObject] = []
        self._next_number = 1
        self._stamp_ns: int | None = None
        self._observer: Observer | None = None
        self._resting: list[FloatArray] = []

    @property
    def confirmed(self) -> list[TrackedObject]:
        """Objects with a number."""
        return [o for o in self.objects if o.is_confirmed]

    def occupied(self, shape: tuple[int, ...], *, departed: bool = False) -> BoolArray:
        """Return the pixels of the objects seen in the last image: of all, or of those that have left their
        first positions.
        """
        mask = np.zeros(shape, bool)
        for o in self.objects:
            if np.isfinite(o.pixel).all() and (o.has_departed or not departed):
                half = 0.5 * o.size_px + 3.0
                low = np.maximum(np.floor(o.pixel - half), 0).astype(int)
                high = np.maximum(np.ceil(o.pixel + half), 0).astype(int) + 1
                mask[low[1] : high[1], low[0] : high[0]] = True
        return mask

    def resting(self, shape: tuple[int, ...]) -> BoolArray:
        """Return the pixels of the objects that the last image removed because they are at rest."""
        mask = np.zeros(shape, bool)
        for box in self._resting:
            if not np.isfinite(box).all():
                continue
            u0, v0 = (max(int(x) - 2, 0) for x in (box[0], box[2]))
            mask[v0 : int(box[3]) + 4, u0 : int(box[1]) + 4] = True
        return mask

    def rotate(self, R_new_old: FloatArray) -> None:
        """Express all states in another frame, given the rotation (3, 3)."""
        R6 = np.kron(np.eye(2), R_new_old)  # of direction and rate
        for o in self.objects:
            o.states, o.clear_states = (
                BearingStates(s.directions @ R_new_old.T, s.rates @ R_new_old.T, R6 @ s.covariances @ R6.T)
                for s in (o.states, o.clear_states)
            )
            o.start = R_new_old @ o.start

    def step(self, scene: Scene) -> list[TrackedObject]:
        """Update all objects with an image; return the objects that this image makes lost."""
        self._resting = []
        self._predict(scene)
        positions_px, sigmas_px = self._predicted_positions(scene)
        matches = [
            self._match_appearance(o, p, s, scene)
            for o, p, s in zip(self.objects, positions_px, sigmas_px, strict=True)
        ]
        region_rows, is_ambiguous = self._assign_regions(positions_px, sigmas_px, matches, scene)
        for i, o in enumerate(self.objects):
            self._correct(o, positions_px[i], matches[i], int(region_rows[i]), bool(is_ambiguous[i]), scene)
        self._confirm(scene)
        self._remove_repeated(scene)
        lost = self._end(scene)
        used_regions = {o.region for o in self.objects if o.region >= 0}
        self._start(scene, used_regions)
        self._stamp_ns, self._observer = scene.stamp_ns, scene.observer
        return lost

    def predicted(self, o: TrackedObject, stamp_ns: int) -> BearingStates:
        """Return the state of an object at a time after the last image."""
        return self._motion.predicted(o, (stamp_ns - (self._stamp_ns or stamp_ns)) * 1e-9)

    def designate(self, box: FloatArray, label: str, scene: Scene) -> TrackedObject | None:
        """Track the object in a box (4,): first and last column, first and last row; None at the border."""
        position_px = np.array([0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])])
        mask = np.zeros(scene.image.shape, bool)
        mask[int(box[2]) : int(np.ceil(box[3])) + 1, int(box[0]) : int(np.ceil(box[1])) + 1] = True
        appearance = Appearance.cut(scene.image, mask, box, position_px)
        if appearance is None:
            return None
        o = self._new(position_px, 0.25 * np.eye(2), appearance.size_px, appearance, scene)
        o.label, o.is_designated, o.number = label, True, self._next_number
        o.box, o.pixel, o.pixel_covariance = box, position_px, 0.25 * np.eye(2)
        o.status = ObjectTrackStatusT.TRACK_CONFIRMED
        self._next_number += 1
        self.objects.append(o)
        return o

    # -- steps

    def _predict(self, scene: Scene) -> None:
        """Predict all objects to the time of the image; known translation moves the objects with a range."""
        if self._stamp_ns is None:
            return
        moved_m = np.zeros(3)
        before = self._observer
        if before is not None and before.position_m is not None and scene.observer.position_m is not None:
            moved_m = scene.observer.position_m - before.position_m
        for o in self.objects:
            o.range.predict(scene.stamp_ns)
            self._motion.predict(o, (scene.stamp_ns - self._stamp_ns) * 1e-9, moved_m)

    def _predicted_positions(self, scene: Scene) -> tuple[FloatArray, FloatArray]:
        """Return the expected image positions (m, 2) and their standard deviations (m,), pixels."""
        if not self.objects:
            return np.zeros((0, 2)), np.zeros(0)
        states = join_states([o.states for o in self.objects])
        pixels = scene.observer.attitude.pixels(scene.camera, states.directions)
        position, _ = across(states)
        noise = np.trace(scene.observer.attitude.covariance) / 3.0
        sigma = np.sqrt(0.5 * np.trace(position, axis1=1, axis2=2) + noise) * scene.camera.fx
        return pixels, sigma

    def _match_appearance(
        self, o: TrackedObject, position_px: FloatArray, sigma_px: float, scene: Scene
    ) -> AppearanceTrackingOutputs | None:
        """Return the best match of the appearance of an object near its predicted position, or None."""
        if o.appearance is None or not np.isfinite(position_px).all():
            return None
        reach = float(np.clip(_REACH_SIGMAS * sigma_px + 1.0, *_REACH_PX))
        return self._compare(o, position_px, reach, scene)

    def _compare(
        self, o: TrackedObject, position_px: FloatArray, reach: float, scene: Scene
    ) -> AppearanceTrackingOutputs | None:
        """Return the best match of the appearance of an object within ``reach`` pixels of a position of the
        object.
        """
        a = o.appearance
        if a is None:
            return None
        ratio = float(np.sqrt(np.prod(o.size_px / a.size_px)))
        # Without regions the size is that of the best correlation.
        scales = ratio * (np.array([1.0, 0.95, 1.05]) if o.is_designated else np.ones(1))
        match: AppearanceTrackingOutputs = self._match.process(
            AppearanceTrackingInputs(
                image=scene.image,
                template=a.template,
                weights=a.weights,
                place=position_px - ratio * a.offset,
                reach=np.array([reach, reach]),
                scales=scales,
                noise=scene.noise,
            )
        )
        if not np.isfinite(match.place).all():
            return None
        return AppearanceTrackingOutputs(
            place=match.place + match.scale * a.offset,
            covariance=match.covariance,
            scale=match.scale,
            score=match.score,
            second=match.second,
        )

    def _similarity(self, o: TrackedObject, position_px: FloatArray, scene: Scene) -> float:
        """Return the correlation of the appearance of an object with an image position; -1 without one."""
        match = self._compare(o, position_px, 3.0, scene)
        return _OTHER if match is None else match.score

    def _assign_regions(
        self,
        positions_px: FloatArray,
        sigmas_px: FloatArray,
        matches: list[AppearanceTrackingOutputs | None],
        scene: Scene,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the row of the region of each object (m,), -1 for none, and which choices are ambiguous
        (m,).
        """
        regions = scene.regions
        m = len(self.objects)
        region_rows, is_ambiguous = np.full(m, -1), np.zeros(m, bool)
        visible = np.flatnonzero(np.isfinite(positions_px).all(axis=1))
        if regions is None or len(regions.centroids) == 0 or len(visible) == 0:
            return region_rows, is_ambiguous
        objects = [self.objects[i] for i in visible]
        sizes = np.array([o.size_px for o in objects])
        slack = (0.1 * sizes) ** 2 + 0.25
        covariances = np.array([np.eye(2) * s**2 for s in sigmas_px[visible]]) + np.einsum(
            "ni,ij->nij", slack, np.eye(2)
        )
        gap = np.linalg.norm(positions_px[visible][:, None] - regions.centroids, axis=2)
        near = (
            gap < 5.0 * np.sqrt(np.trace(covariances, axis1=1, axis2=2))[:, None] + sizes.max(axis=1)[:, None]
        )
        similar = np.full(near.shape, np.nan)
        is_followed = self._followed_regions(matches, scene)
        for i, o in enumerate(objects):
            if near[i].sum() > 1 or near[:, near[i]].sum() > 1 or o.misses > 0:
                for j in np.flatnonzero(near[i]):
                    if o.misses > _MAX_MISSES and (is_followed[j] or not o.is_similar_size(scene.sizes[j])):
                        # That of an object in view, or a part of a hidden one, which is not at its centre.
                        similar[i, j] = _OTHER
                        continue
                    match = self._compare(o, regions.centroids[j], 2.0 + 0.1 * float(sizes[i].max()), scene)
                    similar[i, j] = _OTHER if match is None else match.score
        association = self._associate.process(
            TrackAssociationInputs(
                places=positions_px[visible],
                covariances=covariances,
                sizes=sizes,
                size_sigmas=np.array([0.2 + 0.8 / o.size_px.min() for o in objects]),
                regions=regions.centroids,
                region_covariances=regions.covariances,
                region_sizes=scene.sizes,
                similarities=similar,
            )
        )
        region_rows[visible], is_ambiguous[visible] = association.chosen, association.is_ambiguous
        # An object without a region may be a part of the region around it.
        for i in map(int, visible):
            if region_rows[i] < 0 and self.objects[i].misses == 0:
                around = np.flatnonzero(boxes_around(regions.boxes, positions_px[i]))
                if len(around) == 1 and around[0] not in region_rows:
                    region_rows[i] = int(around[0])
        return region_rows, is_ambiguous

    def _followed_regions(self, matches: list[AppearanceTrackingOutputs | None], scene: Scene) -> BoolArray:
        """Return which regions (n,) contain the appearance of an object seen in the last image."""
        assert scene.regions is not None  # the caller has checked it
        boxes = scene.regions.boxes
        result = np.zeros(len(boxes), bool)
        for o, match in zip(self.objects, matches, strict=True):
            if o.is_confirmed and o.misses == 0 and match is not None and o.is_in_full_view(match.score):
                result |= boxes_around(boxes, match.place)
        return result

    def _correct(
        self,
        o: TrackedObject,
        position_px: FloatArray,
        match: AppearanceTrackingOutputs | None,
        region: int,
        is_ambiguous: bool,
        scene: Scene,
    ) -> None:
        """Correct an object with its region, its appearance, both or none."""
        config = self._config
        o.region, o.is_whole, o.is_full_height = -1, False, False
        o.pixel, o.pixel_covariance, o.box = np.full(2, np.nan), np.full((2, 2), np.nan), np.full(4, np.nan)
        good = match if match is not None and match.score > config.min_score else None
        regions = scene.regions
        z: tuple[FloatArray, FloatArray] | None = None
        is_clear = False
        if o.is_designated and self._path_px(o, scene) < config.confirm_path_px:
            region = -1  # a landmark at rest is no moving region: one near it is an error of the registration
        if region >= 0 and regions is not None:
            size = scene.sizes[region]
            whole = o.is_similar_size(size)
            centroid = regions.centroids[region]
            shape = (_SHAPE_ERROR * o.size_px) ** 2 + _SHAPE_PX**2
            by_region = (centroid, regions.covariances[region] + np.diag(shape))
            o.unlike = 0 if whole else o.unlike + 1
            o.is_full_height, o.box = o.is_similar_height(float(size[1])), regions.boxes[region]
            is_full_view = good is not None and o.is_in_full_view(good.score)
            is_clear = whole or is_full_view
            if is_full_view:
                o.resize(size, is_clear=True)
            if whole or o.unlike >= _NEW_SIZE or not o.is_confirmed:
                z, middle = by_region, None
                if not whole and o.is_confirmed:
                    o.allow_move(float(np.linalg.norm(centroid - position_px)) / scene.camera.fx)
                agree = max(_AGREE * float(o.size_px.max()), 1.0)
                if good is not None and np.linalg.norm(good.place - centroid) < agree:
                    offset = np.zeros(2) if o.appearance is None else o.appearance.offset
                    middle = good.place - good.scale * offset
                    z = o.anchored(good.place, good.covariance, *by_region)
                o.region, o.is_whole = region, whole
                o.learn_centre(centroid)
                if not is_full_view:
                    o.resize(size)
                if good is not None:
                    o.learn_score(good.score)
                if not is_ambiguous:
                    mask = regions.labels == region + 1
                    appearance = Appearance.cut(scene.image, mask, o.box, z[0])
                    o.adopt(appearance, middle, z[0])
                o.unlike = 0
            elif is_full_view and good is not None:
                # With dust or a shadow, or without its darkest part: the appearance gives the position.
                z = (good.place, good.covariance + o.anchor_variance * np.eye(2))
                o.region = region
            elif (visible := o.by_edges(o.box, position_px)) is not None:
                # Partly hidden: the edges in view give the position.
                z = (visible, regions.covariances[region] + (_EDGES_ERROR * o.size_px.max()) ** 2 * np.eye(2))
                o.region = region
            elif good is not None:
                # Merged with another region: the appearance gives the position.
                z = (good.place, good.covariance + (0.05 * o.size_px.max()) ** 2 * np.eye(2))
                o.region = region
        elif match is not None and self._is_distinct(o, match) and not self._is_taken(o, match.place):
            z, is_clear = (match.place, match.covariance + (0.05 * o.size_px.max()) ** 2 * np.eye(2)), True
            if o.is_designated and o.appearance is not None:
                o.resize(o.appearance.size_px * match.scale)
        if z is None or not self._update(o, *z, scene):
            self._miss(o)
            return
        if not o.is_confirmed:
            o.clear_states = o.states
        elif is_clear:
            self._motion.correct_clear(o, *z, scene)
        o.score = 0.8 if good is None else good.score
        o.hits, o.misses, o.seen_ns = o.hits + 1, 0, scene.stamp_ns
        o.has_departed = o.has_departed or self._path_px(o, scene) > float(o.size_px.max())
        o.parallax_rad += scene.parallax_at(o.pixel) / scene.camera.fx

    @staticmethod
    def _miss(o: TrackedObject) -> None:
        if o.misses == 0:
            # The positions of the partly hidden object are biased towards its visible part.
            o.states = o.clear_states
        o.misses += 1
        o.score *= 0.9
        o.region, o.is_whole = -1, False
        o.pixel, o.pixel_covariance, o.box = np.full(2, np.nan), np.full((2, 2), np.nan), np.full(4, np.nan)

    @staticmethod
    def _path_px(o: TrackedObject, scene: Scene) -> float:
        """Return the path of an object relative to the scene since its start, pixels."""
        return float(np.linalg.norm(o.direction - o.start)) * scene.camera.fx

    def _is_distinct(self, o: TrackedObject, match: AppearanceTrackingOutputs) -> bool:
        """Return whether the appearance alone is a measurement: large enough, well correlated and unique."""
        least = _ALONE_SCORE if o.misses == 0 else 0.5 * (1.0 + _ALONE_SCORE)
        large = bool((o.size_px >= _ALONE_PX).all())
        return large and match.score > least and match.score - match.second > _DISTINCT

    def _is_taken(self, o: TrackedObject, position_px: FloatArray) -> bool:
        """Return whether an image position is in the region of another object."""
        boxes = np.array([other.box for other in self.confirmed if other is not o]).reshape(-1, 4)
        return bool(boxes_around(boxes, position_px).any())

    def _update(self, o: TrackedObject, pixel: FloatArray, covariance: FloatArray, scene: Scene) -> bool:
        """Correct the state with an image position; return False, without a correction, if it contradicts
        the motion of a coasting object.
        """
        states, nis = self._motion.corrected(o, pixel, covariance, scene)
        if o.misses > _MAX_MISSES and nis > _CONTRADICTS:
            return False
        o.states = states
        o.pixel, o.pixel_covariance = pixel, covariance
        return True

    def _new(
        self,
        position_px: FloatArray,
        covariance: FloatArray,
        size: FloatArray,
        appearance: Appearance | None,
        scene: Scene,
    ) -> TrackedObject:
        """Return an unconfirmed object at an image position, with unknown velocity."""
        attitude = scene.observer.attitude
        direction = attitude.directions(scene.camera, position_px[None])
        states = states_at_rest(
            direction,
            attitude.covariances(scene.camera, covariance[None], direction),
            0.5 * self._config.max_rate_rad_s,
        )
        return TrackedObject(0, states, size.copy(), direction[0], appearance, scene.stamp_ns, scene.stamp_ns)

    def _start(self, scene: Scene, used_regions: set[int]) -> None:
        """Start an object at each region that belongs to no object and is not next to one."""
        regions = scene.regions
        if regions is None:
            return
        for j in range(len(regions.centroids)):
            size, position_px, box = scene.sizes[j], regions.centroids[j], regions.boxes[j]
            if j in used_regions or size.min() < self._config.min_size_px:
                continue
            if regions.sharpness[j] < _SHARP:
                continue
            if any(o.is_next_to(box) for o in self.objects):
                continue
            shape = (_SHAPE_ERROR * size) ** 2 + _SHAPE_PX**2
            covariance = regions.covariances[j] + np.diag(shape)
            appearance = Appearance.cut(scene.image, regions.labels == j + 1, box, position_px)
            o = self._new(position_px, covariance, size, appearance, scene)
            o.pixel, o.pixel_covariance, o.region = position_px, covariance, j
            o.box = o.first_box = box
            self.objects.append(o)

    def _confirm(self, scene: Scene) -> None:
        """Confirm the objects that have moved: each gets a new number, or that of the coasting object it
        continues.
        """
        config = self._config
        for o in list(self.objects):
            if o.is_confirmed:
                o.status = (
                    ObjectTrackStatusT.TRACK_CONFIRMED if o.misses == 0 else ObjectTrackStatusT.TRACK_COASTING
                )
                continue
            if o.misses or o.size_px.min() < config.min_size_px:
                continue
            if not self._has_moved(o, scene):
                if o.hits >= EARLY_HITS and o.region >= 0:
                    self._resume(o, scene)
                continue
            old = coasting_predecessor(o, self.confirmed, scene, self._similarity)
            if old is None:
                o.number = self._next_number
                self._next_number += 1
            else:
                o.number, o.label, o.range, o.hits = old.number, old.label, old.range, old.hits + o.hits
                o.size_px = o.size_px if o.region < 0 else scene.sizes[o.region].copy()
                self.objects.remove(old)
            o.status = ObjectTrackStatusT.TRACK_CONFIRMED

    def _resume(self, new: TrackedObject, scene: Scene) -> None:
        """Correct a coasting object with the region of a new object that is a part of it coming into view."""
        old = coasting_predecessor(new, self.confirmed, scene, self._similarity, is_early=True)
        if old is None:
            return
        predicted_px = scene.observer.attitude.pixels(scene.camera, old.states.directions)[0]
        position_px = new.whole_middle(old.size_px, predicted_px)
        match = self._compare(old, new.pixel, 3.0, scene)
        self._correct(old, position_px, match, new.region, True, scene)
        if old.misses == 0:
            old.status = ObjectTrackStatusT.TRACK_CONFIRMED
            self.objects.remove(new)

    def _has_moved(self, o: TrackedObject, scene: Scene) -> bool:
        """Return whether an object has moved for long and steadily enough, and is no part of another one."""
        if o.hits < self._config.confirm_hits:
            return False
        least = max(self._config.confirm_path_px, 0.25 * float(o.size_px.min()))
        if self._path_px(o, scene) < least + o.parallax_rad * scene.camera.fx:
            return False
        age_s = (scene.stamp_ns - o.first_ns) * 1e-9
        return not self._is_companion(o, scene) and moves_steadily(o, age_s)

    def _is_companion(self, new: TrackedObject, scene: Scene) -> bool:
        """Return whether an object is a small part, or the shadow, of another one with the same motion."""
        for other in self.confirmed:
            if new.size_px.prod() > _COMPANION_AREA * other.size_px.prod():
                continue
            apart = float(np.linalg.norm(new.direction - other.direction)) * scene.camera.fx
            if other.misses:
                # The first part of a hidden object that comes into view.
                position, _ = across(other.states)
                sigma = float(np.sqrt(np.linalg.eigvalsh(position[0])[-1])) * scene.camera.fx
                if apart < float(other.size_px.max()) + 2.0 * sigma:
                    return True
                continue
            if apart > _COMPANION_DISTANCE * float(other.size_px.max()):
                continue
            velocity = np.cross(other.states.rates[0], other.direction)
            difference = np.cross(new.states.rates[0], new.direction) - velocity
            if np.linalg.norm(difference) < _COMPANION_MOTION * np.linalg.norm(velocity):
                return True
        return False

    def _remove_repeated(self, scene: Scene) -> None:
        """Remove the newer of two objects with the same position and motion; the lower number remains."""
        for new in sorted(self.confirmed, key=lambda o: -o.number):
            for old in self.confirmed:
                if old.number >= new.number or (old.misses and new.misses):
                    continue
                distance_px = float(np.linalg.norm(new.direction - old.direction)) * scene.camera.fx
                ratio = float(np.abs(np.log(new.size_px / old.size_px)).max())
                if distance_px > _SAME * float(old.size_px.max()) or ratio > np.log(_REPEATS_SIZE):
                    continue
                if motion_distance(new.states, old.states) > _REPEATS:
                    continue
                kept_object, removed_object = (new, old) if old.misses else (old, new)
                kept_object.number, kept_object.label = old.number, old.label or new.label
                if old.misses:
                    kept_object.range = old.range
                self.objects.remove(removed_object)
                break

    def _came_to_rest(self, o: TrackedObject, scene: Scene) -> bool:
        """Return whether an object at rest has moved less than its size: it is a remainder of another one."""
        if o.is_designated or o.hits % _REST_HITS or o.misses:
            return False
        moved_px = float(np.linalg.norm(o.direction - o.checked)) * scene.camera.fx
        o.checked = o.direction.copy()
        size = float(o.size_px.max())
        return o.hits > _REST_HITS and moved_px < max(0.1 * size, 2.0) and self._path_px(o, scene) < size

    def _end(self, scene: Scene) -> list[TrackedObject]:
        """Remove unconfirmed objects that are missed or at rest, and lost ones; return the lost ones."""
        lost, remaining = [], []
        for o in self.objects:
            if not o.is_confirmed:
                if o.misses <= _MAX_MISSES and o.hits <= _MAX_AGE:
                    remaining.append(o)
                elif np.isfinite(o.box).all():
                    self._resting.append(o.box)
                continue
            position, _ = across(o.states)
            sigma = float(np.sqrt(np.linalg.eigvalsh(position[0])[-1]))
            coasting_s = (scene.stamp_ns - o.seen_ns) * 1e-9
            if self._came_to_rest(o, scene):
                self._resting.append(o.box)
                continue
            is_brief = o.hits < _BRIEF and o.misses > 2 * o.hits and not o.is_designated
            if is_brief or coasting_s > self._config.lost_s or sigma > self._config.lost_rad:
                o.status = ObjectTrackStatusT.TRACK_LOST
                lost.append(o)
            else:
                remaining.append(o)
        self.objects = remaining
        return lost
