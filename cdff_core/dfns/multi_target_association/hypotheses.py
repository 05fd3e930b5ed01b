# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hypotheses of all objects as columns: predicted, extended by sources, pruned."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_core.bearing_tracking.motion import (
    BearingStates,
    across,
    join_states,
    predict_states,
    states_at_rest,
    update_states,
)

#: Number of images after which a decision between hypotheses is final.
DEPTH = 4


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """One row per hypothesis; an object has one or more.

    Attributes
    ----------
    objects : ndarray of int64 (h,)
        Number of the object.
    states : BearingStates
        State under the hypothesis.
    scores : ndarray (h,)
        Logarithm of the likelihood ratio to false sources.
    sources : ndarray of int64 (h,)
        Source of the newest image; -1 for none.
    hits, misses : ndarray of int64 (h,)
        Number of sources, and of images since the last one.
    evidence : ndarray (h,)
        Sum of the evidence of a defect of the sensor.
    low_px, high_px : ndarray (h, 2)
        Smallest and largest column and row of the sources.
    starts : ndarray (h, 3)
        Direction of the first source.
    history : ndarray of int64 (h, DEPTH)
        Sources of the previous images, the oldest first.
    """

    objects: IntArray
    states: BearingStates
    scores: FloatArray
    sources: IntArray
    hits: IntArray
    misses: IntArray
    evidence: FloatArray
    low_px: FloatArray
    high_px: FloatArray
    starts: FloatArray
    history: IntArray

    def __len__(self) -> int:
        return len(self.objects)

    def selected(self, indices: IntArray | BoolArray) -> Hypotheses:
        """Return the chosen hypotheses."""
        columns: dict[str, Any] = {
            f.name: value.selected(indices) if isinstance(value, BearingStates) else value[indices]
            for f in fields(self)
            for value in [getattr(self, f.name)]
        }
        return Hypotheses(**columns)

    def predicted(self, interval_s: float, noise_rad2_s3: float, acceleration_rad_s2: float) -> Hypotheses:
        """Return the hypotheses at a later time.

        A constant unknown acceleration moves the direction of an object without sources by half of it times
        the squared time; a spectral density that grows by ``3 a^2 t`` has the same variance, ``a^2 t^4 / 4``.
        """
        unseen_s = self.misses * interval_s
        noise = np.asarray(noise_rad2_s3 + 3.0 * acceleration_rad_s2**2 * unseen_s, np.float64)
        return replace(self, states=predict_states(self.states, interval_s, noise))


def joined_hypotheses(parts: list[Hypotheses]) -> Hypotheses:
    """Return the rows of several tables."""
    columns: dict[str, Any] = {
        f.name: join_states([getattr(p, f.name) for p in parts])
        if f.name == "states"
        else np.concatenate([getattr(p, f.name) for p in parts])
        for f in fields(Hypotheses)
    }
    return Hypotheses(**columns)


def new_hypotheses(
    objects: IntArray,
    states: BearingStates,
    sources: IntArray,
    pixels: FloatArray,
    evidence: FloatArray,
    hits: int = 1,
) -> Hypotheses:
    """Return one hypothesis for each new object."""
    n = len(objects)
    return Hypotheses(
        objects=objects,
        states=states,
        scores=np.zeros(n),
        sources=sources,
        hits=np.full(n, hits, np.int64),
        misses=np.zeros(n, np.int64),
        evidence=evidence,
        low_px=pixels,
        high_px=pixels,
        starts=states.directions,
        history=np.full((n, DEPTH), -1, np.int64),
    )


def no_hypotheses() -> Hypotheses:
    """Return a table without rows."""
    none = np.zeros(0, np.int64)
    states = states_at_rest(np.zeros((0, 3)), np.zeros((0, 3, 3)), 1.0)
    return new_hypotheses(none, states, none, np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """Sources of an image that can belong to an object, see the ports of the DFN."""

    directions: FloatArray
    covariances: FloatArray
    pixels: FloatArray
    evidence: FloatArray
    indices: IntArray

    def __len__(self) -> int:
        return len(self.directions)


def extend_with_sources(
    hypotheses: Hypotheses,
    sources: Sources,
    *,
    log_density: float,
    log_detected: float,
    log_missed: FloatArray,
    gate: float,
    max_false: FloatArray,
) -> Hypotheses:
    """Return each hypothesis without a source, and with each source in its gate.

    Parameters
    ----------
    log_density : float
        Logarithm of the expected number of false sources per steradian.
    log_detected, log_missed : float, ndarray (h,)
        Logarithms of the probabilities of detection and of no detection.
    gate : float
        Largest squared normalised innovation.
    max_false : ndarray (h,)
        Largest expected number of false sources in a gate; a hypothesis with more takes no source.
    """
    without_source = replace(
        hypotheses,
        scores=hypotheses.scores + log_missed,
        sources=np.full(len(hypotheses), -1, np.int64),
        misses=hypotheses.misses + 1,
        history=_shift_history(hypotheses.history, hypotheses.sources),
    )
    if len(hypotheses) == 0 or len(sources) == 0:
        return without_source
    position, _ = across(hypotheses.states)
    area = np.pi * gate * np.sqrt(np.linalg.det(position))
    is_open = np.exp(log_density) * area < max_false
    variance = np.trace(position, axis1=1, axis2=2)
    noise = np.trace(sources.covariances, axis1=1, axis2=2)
    distance2 = 2.0 - 2.0 * np.clip(hypotheses.states.directions @ sources.directions.T, -1.0, 1.0)
    is_in_gate = (distance2 < gate * (variance[:, None] + noise)) & is_open[:, None]
    parents, source_rows = np.nonzero(is_in_gate)
    if len(parents) == 0:
        return without_source
    states, nis, log_det = update_states(
        hypotheses.states.selected(parents), sources.directions[source_rows], sources.covariances[source_rows]
    )
    inside = nis < gate
    parents, source_rows, states = parents[inside], source_rows[inside], states.selected(inside)
    gain = log_detected - log_density - np.log(2.0 * np.pi) - 0.5 * (log_det + nis)[inside]
    parent_hypotheses = hypotheses.selected(parents)
    extended = replace(
        parent_hypotheses,
        states=states,
        scores=parent_hypotheses.scores + gain,
        sources=sources.indices[source_rows],
        hits=parent_hypotheses.hits + 1,
        misses=np.zeros(len(parents), np.int64),
        evidence=parent_hypotheses.evidence + sources.evidence[source_rows],
        low_px=np.minimum(parent_hypotheses.low_px, sources.pixels[source_rows]),
        high_px=np.maximum(parent_hypotheses.high_px, sources.pixels[source_rows]),
        history=_shift_history(parent_hypotheses.history, parent_hypotheses.sources),
    )
    return joined_hypotheses([without_source, extended])


def best_assignment(hypotheses: Hypotheses, is_confirmed: BoolArray) -> IntArray:
    """Return the rows of the best set of hypotheses: one per object, each source used at most once.

    Confirmed objects choose first, so that a new object does not take their source.
    """
    first = np.flatnonzero(is_confirmed)
    best = first[_assign_sources(hypotheses.selected(first))]
    used_sources = hypotheses.sources[best]
    is_free = ~np.isin(hypotheses.sources, used_sources[used_sources >= 0])
    others = np.flatnonzero(~is_confirmed & is_free)
    return np.concatenate([best, others[_assign_sources(hypotheses.selected(others))]])


def _assign_sources(hypotheses: Hypotheses) -> IntArray:
    """Return the rows of the most probable assignment, in which each source has at most one object."""
    if len(hypotheses) == 0:
        return np.zeros(0, np.int64)
    objects, row_of_object = np.unique(hypotheses.objects, return_inverse=True)
    sources, column = np.unique(hypotheses.sources, return_inverse=True)
    # The best hypothesis of each object and source; each object may also have no source.
    value = np.full((len(objects), len(sources) + len(objects)), -np.inf)
    row = np.full(value.shape, -1, np.int64)
    target = np.where(hypotheses.sources < 0, len(sources) + row_of_object, column)
    order = np.argsort(hypotheses.scores, kind="stable")  # ascending: the best one is written last
    value[row_of_object[order], target[order]] = hypotheses.scores[order]
    row[row_of_object[order], target[order]] = order
    finite = np.isfinite(value)
    cost = np.where(finite, -value, 1e6 - float(value[finite].min()))
    rows, columns = linear_sum_assignment(cost)
    return np.asarray(row[rows, columns])


def prune(hypotheses: Hypotheses, best: IntArray, count: int, width: float) -> tuple[Hypotheses, IntArray]:
    """Return the hypotheses that are kept and the rows of the best ones among them.

    Kept are at most ``count`` per object whose score is within ``width`` of the best one, and whose oldest
    source is that of the best one.
    """
    if len(hypotheses) == 0:
        return hypotheses, best
    row_of = dict(zip(hypotheses.objects[best].tolist(), best.tolist(), strict=True))
    leader = np.array([row_of.get(o, -1) for o in hypotheses.objects.tolist()])
    is_kept = leader >= 0
    is_kept &= hypotheses.scores > hypotheses.scores[leader] - width
    is_kept &= hypotheses.history[:, 0] == hypotheses.history[leader, 0]
    order = np.lexsort((-hypotheses.scores, hypotheses.objects))
    order = order[is_kept[order]]
    objects = hypotheses.objects[order]
    starts = np.flatnonzero(np.r_[True, objects[1:] != objects[:-1]]) if len(objects) else np.zeros(0, int)
    rank = np.arange(len(order)) - np.repeat(starts, np.diff(np.r_[starts, len(order)]))
    is_best = np.isin(order, best)
    order = order[(rank < count) | is_best]
    position = {int(row): i for i, row in enumerate(order)}
    rows = np.array([position[int(b)] for b in best if int(b) in position], np.int64)
    return hypotheses.selected(order), rows


def _shift_history(history: IntArray, sources: IntArray) -> IntArray:
    return np.concatenate([history[:, 1:], sources[:, None]], axis=1)


def is_repeated(hypotheses: Hypotheses, best: IntArray) -> BoolArray:
    """Return which of the best hypotheses share their last sources with a better one of another object."""
    earlier_histories: set[tuple[int, ...]] = set()
    is_repetition = np.zeros(len(best), bool)
    for k in np.argsort(-hypotheses.scores[best], kind="stable"):
        row = best[k]
        recent = (*hypotheses.history[row, -2:].tolist(), int(hypotheses.sources[row]))
        if min(recent) < 0:
            continue
        is_repetition[k] = recent in earlier_histories
        earlier_histories.add(recent)
    return is_repetition
