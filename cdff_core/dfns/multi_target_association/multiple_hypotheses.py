# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Association with multiple hypotheses for each object."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.bearing_tracking.motion import across, motion_significance, states_at_rest, tangents
from cdff_core.dfns.multi_target_association.hypotheses import (
    Hypotheses,
    Sources,
    best_assignment,
    extend_with_sources,
    is_repeated,
    joined_hypotheses,
    new_hypotheses,
    no_hypotheses,
    prune,
)
from cdff_core.dfns.multi_target_association.interface import Inputs, Interface, Outputs
from cdff_core.dfns.multi_target_association.resting_sources import KNOWN, REPEATED, RestingSources

TENTATIVE, CONFIRMED, COASTING, LOST = range(4)
UNDECIDED, MOVING, RESTING, DEFECT = range(4)
#: Smallest number of false sources that an image is assumed to have.
_MIN_FALSE = 3.0
#: A moving object is further from its start than the distance of sources that can be separated, by this
#: number of standard deviations of the difference of two sources: the centroid of stars that cannot be
#: separated moves by up to that distance.
_PATH_SIGMAS = 4.0
#: A confirmed object with at least this number of sources coasts; with fewer it ends after twice as many
#: images without a source as it had sources.
_ESTABLISHED = 10
#: Largest number of sources of a new object that may continue a coasting one.
_FRESH = 12
#: Sum of the evidence that excludes a defect for an object that rests in the sensor.
_NO_DEFECT = -15.0


class MultipleHypothesesConfig(DfnConfig):
    """Parameters of MultipleHypotheses."""

    max_rate_rad_s: float = Field(
        3e-3,
        gt=0.0,
        le=1.0,
        description="Largest angular rate of a new object, rad/s: two standard deviations",
    )
    noise_rad2_s3: float = Field(
        1e-14, ge=0.0, le=1.0, description="Spectral density of the angular acceleration, rad²/s³"
    )
    acceleration_rad_s2: float = Field(
        1e-7,
        ge=0.0,
        le=1.0,
        description="Angular acceleration of an object without sources, rad/s²: in a low orbit a tenth of"
        " the square of the mean motion",
    )
    detection_probability: float = Field(
        0.9, gt=0.1, lt=1.0, description="Probability that an object in an image is a source"
    )
    gate: float = Field(
        20.0, ge=4.0, le=100.0, description="Largest squared normalised innovation of a source"
    )
    confirm_score: float = Field(
        20.0,
        ge=1.0,
        le=200.0,
        description="Score from which an object is confirmed: the negative logarithm of the"
        " probability that false sources reach it",
    )
    confirm_hits: int = Field(
        4, ge=3, le=100, description="Number of sources from which an object is confirmed"
    )
    significance: float = Field(
        50.0, ge=5.0, le=1e4, description="Squared rate in standard deviations from which an object moves"
    )
    max_misses: int = Field(
        2, ge=1, le=100, description="Images without a source after which a tentative object ends"
    )
    max_hypotheses: int = Field(5, ge=1, le=100, description="Number of hypotheses kept for each object")
    score_width: float = Field(
        10.0, ge=1.0, le=100.0, description="Difference to the best score from which a hypothesis is removed"
    )
    max_false: float = Field(
        0.05,
        gt=0.0,
        le=10.0,
        description="Expected number of false sources in the gate of a confirmed object above which no source"
        " is taken; a new object with the predicted motion continues it instead",
    )
    lost_rad: float = Field(
        0.3,
        gt=1e-4,
        le=3.2,
        description="Standard deviation of the direction from which an object is lost, rad",
    )
    lost_s: float = Field(
        7200.0, gt=0.0, le=1e7, description="Time without a source after which an object is lost, s"
    )


@dataclass(slots=True)
class _Object:
    """A confirmed object: its public number, and the time of its last source, nanoseconds."""

    number: int
    seen_ns: int
    score: float = 0.0


class MultipleHypotheses(Interface[MultipleHypothesesConfig]):
    """Track-oriented multiple hypotheses [1]_: each object keeps several possible series of sources, with
    their
    likelihood ratios as scores [2]_; decisions are final after some images.

    Sources at rest in the sky are removed first, by a map that is learnt from the images; a source that
    moves slowly
    leaves the map by the slope of its positions. In front of a star, an object takes no source.

    References
    ----------
    .. [1] Blackman, S. S. (2004). Multiple hypothesis tracking for multiple target tracking. IEEE
       Aerospace and
      Electronic Systems Magazine 19(1). doi:10.1109/MAES.2004.1263228
    .. [2] Bar-Shalom, Y., Blackman, S. S., Fitzgerald, R. J. (2007). Dimensionless score function for
       multiple
      hypothesis tracking. IEEE Transactions on Aerospace and Electronic Systems 43(1).
      doi:10.1109/TAES.2007.357141
    """

    def setup(self) -> None:
        """Clear all objects."""
        self._resting = RestingSources()
        self._hypotheses = no_hypotheses()
        self._objects: dict[int, _Object] = {}
        self._next_object, self._next_number = 0, 1
        self._stamp_ns: int | None = None
        self._start_ns = 0

    def process(self, inputs: Inputs) -> Outputs:
        """Associate the sources of one image.

        Raises
        ------
        InputError
            If the image is not later than the previous one.
        """
        if self._stamp_ns is not None and inputs.stamp <= self._stamp_ns:
            raise InputError(f"stamp={inputs.stamp}: expected later than the previous one, {self._stamp_ns}")
        if self._stamp_ns is None:
            self._start_ns = inputs.stamp
        interval_s = 0.0 if self._stamp_ns is None else (inputs.stamp - self._stamp_ns) * 1e-9
        self._stamp_ns = inputs.stamp
        time_s = (inputs.stamp - self._start_ns) * 1e-9
        predicted = self._hypotheses.predicted(
            interval_s, self.config.noise_rad2_s3, self.config.acceleration_rad_s2
        )

        variances = 0.5 * np.trace(inputs.covariances, axis1=1, axis2=2)
        at_rest = self._resting.matched(inputs.directions, variances, time_s)
        sightings = self._resting.sightings(at_rest)
        is_known = sightings >= KNOWN
        obstacles = np.concatenate([inputs.stars, inputs.directions[is_known]])
        candidates = self._candidates(inputs, is_known)
        self._hypotheses = self._extend_hypotheses(predicted, candidates, obstacles, inputs)
        best = self._without_repetitions(self._prune_hypotheses())
        self._confirm(best, inputs.stamp, inputs.blend_angle, variances)
        used = self._used_sources(best)
        self._learn_resting(inputs, at_rest, variances, used, time_s)
        best = self._add_slow(best, time_s, inputs.stamp, inputs.blend_angle)
        best = self._continue_coasting(best, inputs.stamp)
        is_new = inputs.can_start & (sightings < REPEATED)
        best = self._start(best, candidates, is_new[candidates.indices], used)
        return self._outputs(best, inputs.stamp)

    def _candidates(self, inputs: Inputs, is_known: BoolArray) -> Sources:
        """Return the sources that are neither at rest nor near a star."""
        is_candidate = ~is_known
        obstacles = np.concatenate([inputs.stars, inputs.directions[is_known]])
        if len(obstacles) and is_candidate.any():
            distances, _ = cKDTree(obstacles).query(inputs.directions)
            is_candidate &= distances > inputs.blend_angle
        indices = np.flatnonzero(is_candidate)
        return Sources(
            inputs.directions[indices],
            inputs.covariances[indices],
            inputs.pixels[indices],
            inputs.defect_evidence[indices],
            indices,
        )

    def _extend_hypotheses(
        self, predicted: Hypotheses, candidates: Sources, obstacles: FloatArray, inputs: Inputs
    ) -> Hypotheses:
        """Return the hypotheses extended with each source in the gate, and with none."""
        density = max(float(inputs.can_start[candidates.indices].sum()), _MIN_FALSE) / inputs.solid_angle
        missed = np.full(len(predicted), np.log(1.0 - self.config.detection_probability))
        is_confirmed = self._is_confirmed(predicted)
        # The score of a confirmed object does not decrease while it is dark or hidden.
        hidden = is_confirmed | inputs.is_dark
        if len(obstacles) and len(predicted):
            position, _ = across(predicted.states)
            reach = inputs.blend_angle + 2.0 * np.sqrt(np.trace(position, axis1=1, axis2=2))
            distances, _ = cKDTree(obstacles).query(predicted.states.directions)
            hidden |= distances < reach
        missed[hidden] = np.log(0.5)
        return extend_with_sources(
            predicted,
            candidates,
            log_density=float(np.log(density)),
            log_detected=float(np.log(self.config.detection_probability)),
            log_missed=missed,
            gate=self.config.gate,
            max_false=np.where(is_confirmed, self.config.max_false, np.inf),
        )

    def _prune_hypotheses(self) -> IntArray:
        """Remove unlikely hypotheses and ended objects; return the rows of the best hypotheses."""
        h = self._hypotheses
        is_confirmed = self._is_confirmed(h)
        best = best_assignment(h, is_confirmed)
        is_confirmed = is_confirmed[best]
        is_ended = ~is_confirmed & ((h.misses[best] > self.config.max_misses) | (h.evidence[best] > 20.0))
        is_ended |= is_repeated(h, best) & ~is_confirmed
        best = best[~is_ended]
        self._hypotheses, best = prune(h, best, self.config.max_hypotheses, self.config.score_width)
        return best

    def _without_repetitions(self, best: IntArray) -> IntArray:
        """Remove objects with the direction and motion of a confirmed object, which keeps the better of both
        states.

        ``best`` contains the rows of the best hypotheses; return their rows after the removal.

        Two objects whose sources cannot be distinguished are one object.
        """
        h = self._hypotheses.selected(best)
        is_confirmed = self._is_confirmed(h)
        candidates = np.flatnonzero(is_confirmed | (h.hits >= 3))
        removed = np.zeros(len(best), bool)
        # A coasting object is not removed: a new object may continue it, see _continue_coasting.
        for i in np.flatnonzero(is_confirmed & (h.misses <= self.config.max_misses)):
            nearby_hypotheses = candidates[
                np.linalg.norm(h.states.directions[candidates] - h.states.directions[i], axis=1) < 0.01
            ]
            for j in nearby_hypotheses:
                if (
                    j == i
                    or removed[i]
                    or removed[j]
                    or _motion_distance(h, int(i), int(j)) > self.config.gate
                ):
                    continue
                first, second = int(h.objects[i]), int(h.objects[j])
                if not is_confirmed[j]:
                    removed[j] = True
                    continue
                loser, winner = (j, i) if h.scores[i] >= h.scores[j] else (i, j)
                numbers = (self._objects[first].number, self._objects[second].number)
                self._objects[int(h.objects[winner])].number = min(numbers)
                del self._objects[int(h.objects[loser])]
                removed[loser] = True
        if not removed.any():
            return best
        is_kept = ~np.isin(self._hypotheses.objects, h.objects[removed])
        new_row = np.cumsum(is_kept) - 1
        self._hypotheses = self._hypotheses.selected(is_kept)
        return np.asarray(new_row[best[~removed]])

    def _confirm(self, best: IntArray, stamp_ns: int, blend_angle: float, variances: FloatArray) -> None:
        """Confirm objects whose score and motion exclude chance; note the time of the sources of all."""
        h = self._hypotheses.selected(best)
        significance = motion_significance(h.states) if len(h) else np.zeros(0)
        pixel_path = np.linalg.norm(h.high_px - h.low_px, axis=1)
        # An object at rest in the image could be a defect of the sensor; only its shape excludes a defect.
        is_point = (pixel_path > 1.0) | (h.evidence < _NO_DEFECT)
        path = np.linalg.norm(h.states.directions - h.starts, axis=1)
        variance = variances[h.sources] if len(variances) else np.zeros(len(h))
        is_new = (
            (path > blend_angle + _PATH_SIGMAS * np.sqrt(2.0 * variance))
            & (h.scores > self.config.confirm_score)
            & (h.hits >= self.config.confirm_hits)
            & (h.sources >= 0)
            & (significance > self.config.significance)
            & (h.evidence < 0.0)
            & is_point
        )
        for i in np.flatnonzero(is_new):
            key = int(h.objects[i])
            if key not in self._objects:
                self._objects[key] = _Object(self._next_number, stamp_ns)
                self._next_number += 1
        for i in np.flatnonzero(h.sources >= 0):
            if (confirmed_object := self._objects.get(int(h.objects[i]))) is not None:
                confirmed_object.seen_ns = stamp_ns
                confirmed_object.score = float(h.scores[i])

    def _used_sources(self, best: IntArray) -> IntArray:
        """Return the sources of confirmed objects."""
        h = self._hypotheses.selected(best)
        return h.sources[self._is_confirmed(h) & (h.sources >= 0)]

    def _learn_resting(
        self, inputs: Inputs, at_rest: IntArray, variances: FloatArray, used: IntArray, time_s: float
    ) -> None:
        """Add the sources that no confirmed object has taken to the map of sources at rest."""
        learn = inputs.can_start.copy()
        learn[used] = False
        self._resting.update(
            at_rest[learn],
            inputs.directions[learn],
            variances[learn],
            inputs.defect_evidence[learn],
            time_s,
        )

    def _add_slow(self, best: IntArray, time_s: float, stamp_ns: int, blend_angle: float) -> IntArray:
        """Confirm the sources of the map that have moved."""
        states, evidence = self._resting.take_moving(time_s, blend_angle)
        if len(states) == 0:
            return best
        objects = self._new_objects(len(states))
        none = np.full(len(states), -1, np.int64)
        rows = new_hypotheses(objects, states, none, np.zeros((len(states), 2)), evidence, hits=8)
        rows = replace(rows, scores=np.full(len(states), self.config.confirm_score))
        for key in objects.tolist():
            self._objects[key] = _Object(self._next_number, stamp_ns, self.config.confirm_score)
            self._next_number += 1
        return self._append(best, rows)

    def _continue_coasting(self, best: IntArray, stamp_ns: int) -> IntArray:
        """Let new confirmed objects continue coasting ones with the same motion, the nearest first."""
        h = self._hypotheses.selected(best)
        confirmed = [
            (i, confirmed_object)
            for i, key in enumerate(h.objects.tolist())
            if (confirmed_object := self._objects.get(key)) is not None
        ]
        fresh = [
            i
            for i, confirmed_object in confirmed
            if confirmed_object.seen_ns == stamp_ns and h.hits[i] <= _FRESH
        ]
        coasting = [
            i
            for i, confirmed_object in confirmed
            if confirmed_object.seen_ns < stamp_ns and h.misses[i] > self.config.max_misses
        ]
        pairs = sorted(
            (distance, i, j)
            for i in fresh
            for j in coasting
            if self._objects[int(h.objects[i])].number > self._objects[int(h.objects[j])].number
            for distance in [_motion_distance(h, i, j)]
            if distance < 2.0 * self.config.gate
        )
        removed: list[int] = []
        objects = self._hypotheses.objects.copy()
        for _, i, j in pairs:
            if best[i] in removed or best[j] in removed or int(h.objects[j]) not in self._objects:
                continue
            coasting_id, new_id = int(h.objects[j]), int(h.objects[i])
            # The new object, with its own state, takes the number of the old one.
            self._objects[new_id].number = self._objects[coasting_id].number
            del self._objects[coasting_id]
            removed.append(int(best[j]))
        if not removed:
            return best
        gone = np.isin(objects, objects[removed])
        position = np.cumsum(~gone) - 1
        self._hypotheses = self._hypotheses.selected(~gone)
        return position[best[~gone[best]]]

    def _start(self, best: IntArray, candidates: Sources, is_new: BoolArray, used: IntArray) -> IntArray:
        """Start an object at each source that may start one and that no established object has taken."""
        h = self._hypotheses.selected(best)
        used_sources = np.concatenate([used, h.sources[(h.sources >= 0) & (h.hits >= 3)]])
        is_free = is_new & ~np.isin(candidates.indices, used_sources)
        if not is_free.any():
            return best
        states = states_at_rest(
            candidates.directions[is_free], candidates.covariances[is_free], 0.5 * self.config.max_rate_rad_s
        )
        rows = new_hypotheses(
            self._new_objects(int(is_free.sum())),
            states,
            candidates.indices[is_free],
            candidates.pixels[is_free],
            candidates.evidence[is_free],
        )
        return self._append(best, rows)

    def _outputs(self, best: IntArray, stamp_ns: int) -> Outputs:
        """Return the objects with at least three sources; remove the lost ones."""
        h = self._hypotheses.selected(best)
        shown = np.array(
            [int(k) in self._objects or n >= 3 for k, n in zip(h.objects, h.hits, strict=True)], dtype=bool
        )
        h = h.selected(shown)
        position, _ = across(h.states) if len(h) else (np.zeros((0, 2, 2)), None)
        sigma = np.sqrt(np.linalg.eigvalsh(position)[:, -1]) if len(h) else np.zeros(0)
        ids = np.full(len(h), -1, np.int64)
        states, classes = np.zeros(len(h), np.int64), np.zeros(len(h), np.int64)
        counts = np.array([(self._hypotheses.objects == k).sum() for k in h.objects], np.int64)
        for i, key in enumerate(h.objects.tolist()):
            confirmed_object = self._objects.get(key)
            if confirmed_object is None:
                continue
            ids[i], classes[i] = confirmed_object.number, MOVING
            states[i] = CONFIRMED if confirmed_object.seen_ns == stamp_ns else COASTING
            is_brief = h.hits[i] < _ESTABLISHED and h.misses[i] > 2 * h.hits[i]
            if (
                is_brief
                or sigma[i] > self.config.lost_rad
                or (stamp_ns - confirmed_object.seen_ns) * 1e-9 > self.config.lost_s
            ):
                states[i] = LOST
                del self._objects[key]
                is_of_other = self._hypotheses.objects != key  # keys of the objects of all hypotheses
                self._hypotheses = self._hypotheses.selected(is_of_other)
        return Outputs(
            ids=ids,
            states=states,
            classes=classes,
            sources=h.sources,
            object_directions=h.states.directions,
            rates=h.states.rates,
            object_covariances=h.states.covariances,
            scores=h.scores,
            hypotheses=counts,
        )

    def _is_confirmed(self, h: Hypotheses) -> BoolArray:
        return np.array([key in self._objects for key in h.objects.tolist()], dtype=bool)

    def _new_objects(self, count: int) -> IntArray:
        """Return unused keys (count,) for new objects."""
        first = self._next_object
        self._next_object += count
        return np.arange(first, first + count, dtype=np.int64)

    def _append(self, best: IntArray, rows: Hypotheses) -> IntArray:
        """Add rows and return the rows of the best hypotheses with them."""
        first = len(self._hypotheses)
        self._hypotheses = joined_hypotheses([self._hypotheses, rows])
        return np.concatenate([best, np.arange(first, first + len(rows))])


def _motion_distance(h: Hypotheses, i: int, j: int) -> float:
    """Return the squared difference of direction and rate of two objects in standard deviations."""
    e = tangents(h.states.directions[[j]])[0]
    u = h.states.directions
    velocity = np.cross(h.states.rates, u)
    difference = np.concatenate([e @ (u[i] - u[j]), e @ (velocity[i] - velocity[j])])
    turn = np.cross(u[j], e)
    H = np.zeros((4, 6))
    H[:2, :3], H[2:, 3:] = turn, turn
    P = H @ (h.states.covariances[i] + h.states.covariances[j]) @ H.T
    return float(difference @ np.linalg.solve(P, difference))
