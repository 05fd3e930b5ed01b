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
    joined,
    motion_significance,
    started,
    tangents,
)
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingInputs, AppearanceTrackingOutputs
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs
from cdff_core.dfns.track_association.interface import TrackAssociationInputs
from cdff_core.dfpcs.far_range_tracking.configuration import FarRangeTrackingConfig
from cdff_core.dfpcs.far_range_tracking.observer import Observer
from cdff_core.dfpcs.far_range_tracking.scene import Scene
from cdff_core.dfpcs.far_range_tracking.tracked_object import Appearance, TrackedObject

#: Reach of the search by appearance, standard deviations, and its bounds, pixels.
_REACH_SIGMAS, _REACH_PX = 3.0, (4.0, 30.0)
#: Correlation from which the appearance alone is a measurement, and the distance of the next best one.
_ALONE_SCORE, _DISTINCT = 0.8, 0.1
#: Least size for a measurement by appearance alone, pixels.
_ALONE_PX = 6.0
#: Error of the place of a region: of the shape, in sizes, and least, pixels.
_SHAPE_ERROR, _SHAPE_PX = 0.01, 0.15
#: Distance of region and appearance that agree, in sizes.
_AGREE = 0.3
#: Images with another size after which it is the new size.
_NEW_SIZE = 20
#: Missed images after which an unconfirmed object is removed; images after which it is if it does not move.
_MAX_MISSES, _MAX_AGE = 2, 40
#: Squared normalised difference of motion, ratio of sizes and correlation of an object that continues one.
_CONTINUES, _CONTINUES_SIZE, _CONTINUES_SCORE = 16.0, 1.6, 0.4
#: Least sharpness of a new object, 1/pixel: dust has less.
_SHARP = 0.12
#: Area, distance and difference of motion of a part or shadow of another object, relative to that object.
_COMPANION_AREA, _COMPANION_DISTANCE, _COMPANION_MOTION = 0.5, 4.0, 0.5
#: Measurements below which an object is lost after as many misses, times two.
_BRIEF = 10
#: Distance of two objects that are the same, in sizes.
_SAME = 0.35
#: Squared normalised innovation of a measurement that is not one of the object.
_CONTRADICTS = 30.0
#: Least squared velocity of a new object in standard deviations, and largest difference of its path from a
#: straight one, relative to the path: a start from rest is half as long.
_SIGNIFICANCE, _STEADY = 16.0, 1.5
#: Measurements between tests for rest.
_REST_HITS = 20
#: Images in which a new object may continue another.
_FRESH = 15


class ObjectTracks:
    """Tracked objects.

    Parameters
    ----------
    filter_seen, coast, match, associate : Dfn
        DFNs of the slots.
    """

    def __init__(
        self,
        filter_seen: Dfn[Any, Any, Any],
        coast: Dfn[Any, Any, Any],
        match: Dfn[Any, Any, Any],
        associate: Dfn[Any, Any, Any],
        config: FarRangeTrackingConfig,
    ) -> None:
        self._filter, self._coast, self._match = filter_seen, coast, match
        self._associate, self._config = associate, config
        self.objects: list[TrackedObject] = []
        self._next_number = 1
        self._stamp_ns: int | None = None
        self._observer: Observer | None = None
        self._resting: list[FloatArray] = []

    @property
    def confirmed(self) -> list[TrackedObject]:
        """Objects with a number."""
        return [o for o in self.objects if o.is_confirmed]

    def occupied(self, shape: tuple[int, ...]) -> BoolArray:
        """Return the pixels of the objects seen in the last image, which the background does not learn."""
        mask = np.zeros(shape, bool)
        for o in self.objects:
            if np.isfinite(o.pixel).all():
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

    def rotate(self, R: FloatArray) -> None:
        """Express all states in another frame, which has the axes ``R`` (3, 3) of the old one."""
        both = np.kron(np.eye(2), R)
        for o in self.objects:
            s = o.states
            o.states = BearingStates(s.directions @ R.T, s.rates @ R.T, both @ s.covariances @ both.T)
            o.start = R @ o.start

    def step(self, scene: Scene) -> list[TrackedObject]:
        """Continue all objects with an image; return those that are lost with it."""
        self._resting = []
        self._predict(scene)
        places, spreads = self._places(scene)
        matches = [
            self._by_appearance(o, p, s, scene) for o, p, s in zip(self.objects, places, spreads, strict=True)
        ]
        chosen, ambiguous = self._assigned(places, spreads, matches, scene)
        for i, o in enumerate(self.objects):
            self._correct(o, places[i], matches[i], int(chosen[i]), bool(ambiguous[i]), scene)
        self._confirm(scene)
        self._remove_repeated(scene)
        lost = self._end(scene)
        taken = {o.region for o in self.objects if o.region >= 0}
        self._start(scene, taken)
        self._stamp_ns, self._observer = scene.stamp_ns, scene.observer
        return lost

    def predicted(self, o: TrackedObject, stamp_ns: int) -> BearingStates:
        """Return the state of an object at a time after the last image."""
        dfn = self._filter if o.misses == 0 else self._coast
        interval = (stamp_ns - (self._stamp_ns or stamp_ns)) * 1e-9
        s = o.states
        found = dfn.process(
            BearingFilteringInputs(
                directions=s.directions, rates=s.rates, covariances=s.covariances, interval=interval
            )
        )
        return BearingStates(found.directions, found.rates, found.covariances)

    def designate(self, box: FloatArray, label: str, scene: Scene) -> TrackedObject | None:
        """Track the object in a box (4,): first and last column, first and last row; None at the border."""
        place = np.array([0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])])
        mask = np.zeros(scene.image.shape, bool)
        mask[int(box[2]) : int(np.ceil(box[3])) + 1, int(box[0]) : int(np.ceil(box[1])) + 1] = True
        appearance = Appearance.cut(scene.image, mask, box, place)
        if appearance is None:
            return None
        o = self._new(place, 0.25 * np.eye(2), appearance.size_px, appearance, scene)
        o.label, o.is_designated, o.number = label, True, self._next_number
        o.box, o.pixel, o.pixel_covariance = box, place, 0.25 * np.eye(2)
        o.status = ObjectTrackStatusT.TRACK_CONFIRMED
        self._next_number += 1
        self.objects.append(o)
        return o

    # -- steps

    def _predict(self, scene: Scene) -> None:
        if self._stamp_ns is None:
            return
        moved_m = np.zeros(3)
        before = self._observer
        if before is not None and before.position_m is not None and scene.observer.position_m is not None:
            moved_m = scene.observer.position_m - before.position_m
        for o in self.objects:
            o.states = self.predicted(o, scene.stamp_ns)
            o.range.predict(scene.stamp_ns)
            range_m, _ = o.range.value
            if np.isfinite(range_m) and moved_m.any():
                u = range_m * o.direction - moved_m
                o.states = BearingStates((u / np.linalg.norm(u))[None], o.states.rates, o.states.covariances)

    def _places(self, scene: Scene) -> tuple[FloatArray, FloatArray]:
        """Return expected pixels (m, 2) and their standard deviations (m,)."""
        if not self.objects:
            return np.zeros((0, 2)), np.zeros(0)
        states = joined([o.states for o in self.objects])
        pixels = scene.observer.attitude.pixels(scene.camera, states.directions)
        position, _ = across(states)
        noise = np.trace(scene.observer.attitude.covariance) / 3.0
        sigma = np.sqrt(0.5 * np.trace(position, axis1=1, axis2=2) + noise) * scene.camera.fx
        return pixels, sigma

    def _by_appearance(
        self, o: TrackedObject, place: FloatArray, sigma: float, scene: Scene
    ) -> AppearanceTrackingOutputs | None:
        if o.appearance is None or not np.isfinite(place).all():
            return None
        reach = float(np.clip(_REACH_SIGMAS * sigma + 1.0, *_REACH_PX))
        return self._compare(o, place, reach, scene)

    def _compare(
        self, o: TrackedObject, place: FloatArray, reach: float, scene: Scene
    ) -> AppearanceTrackingOutputs | None:
        """Return the best place of the appearance of an object near a place of the object."""
        a = o.appearance
        if a is None:
            return None
        ratio = float(np.sqrt(np.prod(o.size_px / a.size_px)))
        # Without regions the size is that of the best correlation.
        scales = ratio * (np.array([1.0, 0.95, 1.05]) if o.is_designated else np.ones(1))
        found: AppearanceTrackingOutputs = self._match.process(
            AppearanceTrackingInputs(
                image=scene.image,
                template=a.template,
                weights=a.weights,
                place=place - ratio * a.offset,
                reach=np.array([reach, reach]),
                scales=scales,
                noise=scene.noise,
            )
        )
        if not np.isfinite(found.place).all():
            return None
        return AppearanceTrackingOutputs(
            place=found.place + found.scale * a.offset,
            covariance=found.covariance,
            scale=found.scale,
            score=found.score,
            second=found.second,
        )

    def _assigned(
        self,
        places: FloatArray,
        spreads: FloatArray,
        matches: list[AppearanceTrackingOutputs | None],
        scene: Scene,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the region of each object (m,), and which are ambiguous (m,)."""
        regions = scene.regions
        m = len(self.objects)
        chosen, ambiguous = np.full(m, -1), np.zeros(m, bool)
        visible = np.flatnonzero(np.isfinite(places).all(axis=1))
        if regions is None or len(regions.centroids) == 0 or len(visible) == 0:
            return chosen, ambiguous
        objects = [self.objects[i] for i in visible]
        sizes = np.array([o.size_px for o in objects])
        slack = (0.1 * sizes) ** 2 + 0.25
        covariances = np.array([np.eye(2) * s**2 for s in spreads[visible]]) + np.einsum(
            "ni,ij->nij", slack, np.eye(2)
        )
        gap = np.linalg.norm(places[visible][:, None] - regions.centroids, axis=2)
        near = (
            gap < 5.0 * np.sqrt(np.trace(covariances, axis1=1, axis2=2))[:, None] + sizes.max(axis=1)[:, None]
        )
        similar = np.full(near.shape, np.nan)
        for i, o in enumerate(objects):
            if near[i].sum() > 1 or near[:, near[i]].sum() > 1 or o.misses > 0:
                for j in np.flatnonzero(near[i]):
                    found = self._compare(o, regions.centroids[j], 2.0 + 0.1 * float(sizes[i].max()), scene)
                    similar[i, j] = -1.0 if found is None else found.score
        found = self._associate.process(
            TrackAssociationInputs(
                places=places[visible],
                covariances=covariances,
                sizes=sizes,
                size_sigmas=np.array([0.2 + 0.8 / o.size_px.min() for o in objects]),
                regions=regions.centroids,
                region_covariances=regions.covariances,
                region_sizes=scene.sizes,
                similarities=similar,
            )
        )
        chosen[visible], ambiguous[visible] = found.chosen, found.is_ambiguous
        return chosen, ambiguous

    def _correct(
        self,
        o: TrackedObject,
        place: FloatArray,
        match: AppearanceTrackingOutputs | None,
        region: int,
        is_ambiguous: bool,
        scene: Scene,
    ) -> None:
        """Correct an object with its region, its appearance, both or none."""
        config = self._config
        o.region, o.is_whole, o.is_full_height = -1, False, False
        o.pixel, o.pixel_covariance, o.box = np.full(2, np.nan), np.full((2, 2), np.nan), np.full(4, np.nan)
        good = match is not None and match.score > config.min_score
        regions = scene.regions
        z: tuple[FloatArray, FloatArray] | None = None
        if o.is_designated and self._path_px(o, scene) < config.confirm_path_px:
            region = -1  # a landmark at rest is no moving region: one near it is an error of the registration
        if o.misses > _MAX_MISSES and region >= 0 and not o.is_similar_size(scene.sizes[region]):
            region = -1  # the part that appears first is not at the place of the object
        if region >= 0 and regions is not None:
            size = scene.sizes[region]
            whole = o.is_similar_size(size)
            centroid = regions.centroids[region]
            shape = (_SHAPE_ERROR * o.size_px) ** 2 + _SHAPE_PX**2
            by_region = (centroid, regions.covariances[region] + np.diag(shape))
            o.unlike = 0 if whole else o.unlike + 1
            o.is_full_height, o.box = o.is_similar_height(float(size[1])), regions.boxes[region]
            if whole or o.unlike >= _NEW_SIZE or not o.is_confirmed:
                z, middle = by_region, None
                agree = max(_AGREE * float(o.size_px.max()), 1.0)
                if good and match is not None and np.linalg.norm(match.place - centroid) < agree:
                    offset = np.zeros(2) if o.appearance is None else o.appearance.offset
                    middle = match.place - match.scale * offset
                    z = o.anchored(match.place, match.covariance, *by_region)
                o.region, o.is_whole = region, whole
                o.learn_centre(centroid)
                o.resize(size)
                if not is_ambiguous:
                    mask = regions.labels == region + 1
                    appearance = Appearance.cut(scene.image, mask, o.box, z[0])
                    o.adopt(appearance, middle, z[0])
                o.unlike = 0
            elif (visible := o.by_edges(o.box, place)) is not None:
                # Partly hidden: the edges in view give the place.
                z = (visible, regions.covariances[region] + (0.03 * o.size_px.max()) ** 2 * np.eye(2))
                o.region = region
            elif good and match is not None:
                # Merged with another region: the appearance gives the place.
                z = (match.place, match.covariance + (0.05 * o.size_px.max()) ** 2 * np.eye(2))
                o.region = region
        elif match is not None and self._is_distinct(o, match) and not self._is_taken(o, match.place):
            z = (match.place, match.covariance + (0.05 * o.size_px.max()) ** 2 * np.eye(2))
            if o.is_designated and o.appearance is not None:
                o.resize(o.appearance.size_px * match.scale)
        if z is None:
            self._miss(o)
            return
        if not self._update(o, *z, scene):
            self._miss(o)
            return
        o.score = match.score if good and match is not None else 0.8
        o.hits, o.misses, o.seen_ns = o.hits + 1, 0, scene.stamp_ns
        o.parallax_rad += scene.parallax_at(o.pixel) / scene.camera.fx

    @staticmethod
    def _miss(o: TrackedObject) -> None:
        o.misses += 1
        o.score *= 0.9
        o.region, o.is_whole = -1, False
        o.pixel, o.pixel_covariance, o.box = np.full(2, np.nan), np.full((2, 2), np.nan), np.full(4, np.nan)

    @staticmethod
    def _path_px(o: TrackedObject, scene: Scene) -> float:
        """Return the path of an object relative to the scene since its start, pixels."""
        return float(np.linalg.norm(o.direction - o.start)) * scene.camera.fx

    def _is_distinct(self, o: TrackedObject, match: AppearanceTrackingOutputs) -> bool:
        """Return True if the appearance alone is a measurement."""
        least = _ALONE_SCORE if o.misses == 0 else 0.5 * (1.0 + _ALONE_SCORE)
        large = bool((o.size_px >= _ALONE_PX).all())
        return large and match.score > least and match.score - match.second > _DISTINCT

    def _is_taken(self, o: TrackedObject, place: FloatArray) -> bool:
        """Return True if a place is in the region of another object."""
        return any(
            other is not o
            and np.isfinite(other.box).all()
            and other.box[0] <= place[0] <= other.box[1]
            and other.box[2] <= place[1] <= other.box[3]
            for other in self.confirmed
        )

    def _update(self, o: TrackedObject, pixel: FloatArray, covariance: FloatArray, scene: Scene) -> bool:
        """Correct the state with a place; return False if it contradicts the motion of a coasting object."""
        attitude = scene.observer.attitude
        direction = attitude.directions(scene.camera, pixel[None])
        dfn = self._filter.process(
            BearingFilteringInputs(
                directions=o.states.directions,
                rates=o.states.rates,
                covariances=o.states.covariances,
                interval=0.0,
                measured=direction,
                measured_covariances=attitude.covariances(scene.camera, covariance[None], direction),
            )
        )
        if o.misses > _MAX_MISSES and float(dfn.nis[0]) > _CONTRADICTS:
            return False
        o.states = BearingStates(dfn.directions, dfn.rates, dfn.covariances)
        o.pixel, o.pixel_covariance = pixel, covariance
        return True

    def _new(
        self,
        place: FloatArray,
        covariance: FloatArray,
        size: FloatArray,
        appearance: Appearance | None,
        scene: Scene,
    ) -> TrackedObject:
        attitude = scene.observer.attitude
        direction = attitude.directions(scene.camera, place[None])
        states = started(
            direction,
            attitude.covariances(scene.camera, covariance[None], direction),
            0.5 * self._config.max_rate_rad_s,
        )
        return TrackedObject(0, states, size.copy(), direction[0], appearance, scene.stamp_ns, scene.stamp_ns)

    def _start(self, scene: Scene, taken: set[int]) -> None:
        """Start objects at regions that no object has taken, and that are not next to one."""
        regions = scene.regions
        if regions is None:
            return
        for j in range(len(regions.centroids)):
            size, place, box = scene.sizes[j], regions.centroids[j], regions.boxes[j]
            if j in taken or size.min() < self._config.min_size_px:
                continue
            if regions.sharpness[j] < _SHARP:
                continue
            if any(_overlaps(o, box) for o in self.objects):
                continue
            shape = (_SHAPE_ERROR * size) ** 2 + _SHAPE_PX**2
            covariance = regions.covariances[j] + np.diag(shape)
            appearance = Appearance.cut(scene.image, regions.labels == j + 1, box, place)
            o = self._new(place, covariance, size, appearance, scene)
            o.pixel, o.pixel_covariance, o.box, o.region = place, covariance, box, j
            self.objects.append(o)

    def _confirm(self, scene: Scene) -> None:
        """Give a number to the objects that have moved; continue coasting ones."""
        config = self._config
        for o in list(self.objects):
            if o.is_confirmed:
                o.status = (
                    ObjectTrackStatusT.TRACK_CONFIRMED if o.misses == 0 else ObjectTrackStatusT.TRACK_COASTING
                )
                continue
            if o.hits < config.confirm_hits or o.misses or o.size_px.min() < config.min_size_px:
                continue
            path = self._path_px(o, scene)
            least = max(config.confirm_path_px, 0.25 * float(o.size_px.min()))
            if path < least + o.parallax_rad * scene.camera.fx:
                continue
            if self._is_companion(o, scene) or not _moves_steadily(o, (scene.stamp_ns - o.first_ns) * 1e-9):
                continue
            old = self._continued(o, scene)
            if old is None:
                o.number = self._next_number
                self._next_number += 1
            else:
                o.number, o.label, o.range, o.hits = old.number, old.label, old.range, old.hits + o.hits
                self.objects.remove(old)
            o.status = ObjectTrackStatusT.TRACK_CONFIRMED

    def _is_companion(self, new: TrackedObject, scene: Scene) -> bool:
        """Return True if an object is a small part, or the shadow, of another one with the same motion."""
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

    def _continued(self, new: TrackedObject, scene: Scene) -> TrackedObject | None:
        """Return the coasting object that a new one continues, or None."""
        best: tuple[float, TrackedObject] | None = None
        for old in self.confirmed:
            if old.misses <= 1:
                continue
            ratio = float(np.abs(np.log(new.size_px / old.size_px)).max())
            distance = _motion_distance(new.states, old.states)
            found = self._compare(old, new.pixel, 3.0, scene)
            score = -1.0 if found is None else found.score
            if distance > _CONTINUES or ratio > np.log(_CONTINUES_SIZE) or score < _CONTINUES_SCORE:
                continue
            cost = distance + (ratio / 0.2) ** 2 + ((1.0 - score) / 0.25) ** 2
            if best is None or cost < best[0]:
                best = (cost, old)
        return None if best is None else best[1]

    def _remove_repeated(self, scene: Scene) -> None:
        """Remove the newer one of two objects with one place and motion; the lower number remains."""
        for new in sorted(self.confirmed, key=lambda o: -o.number):
            for old in self.confirmed:
                if old.number >= new.number or (old.misses and new.misses):
                    continue
                apart = float(np.linalg.norm(new.direction - old.direction)) * scene.camera.fx
                ratio = float(np.abs(np.log(new.size_px / old.size_px)).max())
                if apart > _SAME * float(old.size_px.max()) or ratio > np.log(_CONTINUES_SIZE):
                    continue
                if _motion_distance(new.states, old.states) > _CONTINUES:
                    continue
                seen, other = (new, old) if old.misses else (old, new)
                seen.number, seen.label = old.number, old.label or new.label
                if old.misses:
                    seen.range = old.range
                self.objects.remove(other)
                break

    def _came_to_rest(self, o: TrackedObject, scene: Scene) -> bool:
        """Return True for an object at rest that has moved less than its size: a remainder of another one."""
        if o.is_designated or o.hits % _REST_HITS or o.misses:
            return False
        moved = float(np.linalg.norm(o.direction - o.checked)) * scene.camera.fx
        o.checked = o.direction.copy()
        size = float(o.size_px.max())
        return o.hits > _REST_HITS and moved < max(0.1 * size, 2.0) and self._path_px(o, scene) < size

    def _end(self, scene: Scene) -> list[TrackedObject]:
        """Remove unconfirmed objects that are missed or at rest, and lost ones; return the lost ones."""
        lost, kept = [], []
        for o in self.objects:
            if not o.is_confirmed:
                if o.misses <= _MAX_MISSES and o.hits <= _MAX_AGE:
                    kept.append(o)
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
                kept.append(o)
        self.objects = kept
        return lost


def _overlaps(o: TrackedObject, box: FloatArray) -> bool:
    """Return True if an object seen in this image is in, or next to, a box."""
    if not np.isfinite(o.pixel).all():
        return False
    half = 0.5 * o.size_px + 2.0
    low, high = o.pixel - half, o.pixel + half
    return bool(box[0] < high[0] and box[1] > low[0] and box[2] < high[1] and box[3] > low[1])


def _moves_steadily(o: TrackedObject, age_s: float) -> bool:
    """Return True if the velocity is significant, and its path is that of the object."""
    if float(motion_significance(o.states)[0]) < _SIGNIFICANCE:
        return False
    path = o.direction - o.start
    by_velocity = np.cross(o.states.rates[0], o.direction) * age_s
    return bool(np.linalg.norm(path - by_velocity) < _STEADY * np.linalg.norm(path))


def _motion_distance(a: BearingStates, b: BearingStates) -> float:
    """Return the squared difference of direction and velocity of two states in standard deviations."""
    e = tangents(b.directions)[0]
    u, v = a.directions[0], b.directions[0]
    difference = np.concatenate([e @ (u - v), e @ (np.cross(a.rates[0], u) - np.cross(b.rates[0], v))])
    turn = np.cross(v, e)
    H = np.zeros((4, 6))
    H[:2, :3], H[2:, 3:] = turn, turn
    P = H @ (a.covariances[0] + b.covariances[0]) @ H.T + 1e-12 * np.eye(4)
    return float(difference @ np.linalg.solve(P, difference))
