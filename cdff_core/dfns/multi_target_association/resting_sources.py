# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map of the sources at rest: stars below the limit of the catalogue, learnt from the images."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_core.bearing_tracking.motion import BearingStates, tangents

#: Number of sightings above which a source starts no object, and above which it is known to be at rest.
REPEATED, KNOWN = 2, 6
#: Numbers of images without a sighting after which a source is removed: before and after it is known, and if
#: it moves.
_FORGET_NEW, _FORGET_KNOWN, _FORGET_MOVING = 4, 20_000, 4
#: Least number of sightings and least squared rate, in squared standard deviations, of a moving source.
_MIN_SIGHTINGS, _MIN_SIGNIFICANCE = 8, 60.0
#: Squared rate, in squared standard deviations, above which the position at the end of the fitted line is
#: used instead of the mean.
_MIN_FOLLOWED = 25.0
#: Largest distance of a source from its prediction, standard deviations, and largest number of sources.
_GATE_SIGMAS = 4.0
_MAX_SOURCES = 20_000


class RestingSources:
    """Positions of sources over time: a line through all sightings of each one, whose slope shows slow
    motion.
    """

    def __init__(self) -> None:
        self._origin = np.zeros((0, 3))
        self._tangents = np.zeros((0, 2, 3))
        #: Sums over the sightings: 1, t, t t, x, y, t x, t y, x x + y y, evidence of a defect.
        self._sums = np.zeros((0, 9))
        self._first_s = np.zeros(0)
        self._variance = np.zeros(0)  # of one sighting, square radians
        self._unseen = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self._origin)

    def positions(self, time_s: float) -> FloatArray:
        """Return the direction of each source (n, 3): the mean, or the end of the line of a moving one."""
        place = self._sums[:, 3:5] / self._sums[:, :1]
        slope, moving = self._lines()
        lag = (time_s - self._first_s - self._sums[:, 1] / self._sums[:, 0])[moving]
        place[moving] += slope[moving] * lag[:, None]
        v = self._origin + np.einsum("ni,nij->nj", place, self._tangents)
        return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))

    def _lines(self) -> tuple[FloatArray, BoolArray]:
        """Return the slope (n, 2) of the line of each source, and whether the source follows its line."""
        n, t, tt, x, y, tx, ty = self._sums[:, :7].T
        spread = tt - t * t / n
        slope = np.column_stack([tx - t * x / n, ty - t * y / n]) / np.maximum(spread, 1e-12)[:, None]
        significance = (slope**2).sum(axis=1) * spread / self._variance
        return slope, (n >= _MIN_SIGHTINGS) & (significance > _MIN_FOLLOWED)

    def matched(self, directions: FloatArray, variances: FloatArray, time_s: float) -> IntArray:
        """Return the source (n,) nearest to each measured direction within its error, or -1."""
        result = np.full(len(directions), -1, np.int64)
        if len(self) == 0 or len(directions) == 0:
            return result
        distances, nearest = cKDTree(self.positions(time_s)).query(directions)
        gate = _GATE_SIGMAS * np.sqrt(variances + self._variance[nearest])
        inside = np.flatnonzero(distances < gate)
        order = inside[np.argsort(distances[inside], kind="stable")]
        _, first = np.unique(nearest[order], return_index=True)
        rows = order[first]
        result[rows] = nearest[rows]
        return result

    def sightings(self, indices: IntArray) -> IntArray:
        """Return how often the sources (n,) of ``matched`` were seen before; 0 for none."""
        counts = np.zeros(len(indices), np.int64)
        valid = indices >= 0
        counts[valid] = self._sums[indices[valid], 0].astype(np.int64)
        return counts

    def update(
        self,
        indices: IntArray,
        directions: FloatArray,
        variances: FloatArray,
        evidence: FloatArray,
        time_s: float,
    ) -> None:
        """Add sightings (n,) of matched sources, new sources where the index is -1; remove unseen ones."""
        is_matched = indices >= 0
        entries = indices[is_matched]
        offset = np.einsum(
            "nij,nj->ni", self._tangents[entries], directions[is_matched] - self._origin[entries]
        )
        t = time_s - self._first_s[entries]
        self._sums[entries] += _sums(t, offset, evidence[is_matched])
        self._unseen += 1
        self._unseen[entries] = 0
        limit = np.where(self._sums[:, 0] > REPEATED, _FORGET_KNOWN, _FORGET_NEW)
        limit[self._lines()[1]] = _FORGET_MOVING  # the error of a line grows beyond its sightings
        is_kept = self._unseen <= limit
        is_new = ~is_matched
        count = int(is_new.sum())
        self._origin = np.concatenate([self._origin[is_kept], directions[is_new]])
        self._tangents = np.concatenate([self._tangents[is_kept], tangents(directions[is_new])])
        sums = _sums(np.zeros(count), np.zeros((count, 2)), evidence[is_new])
        self._sums = np.concatenate([self._sums[is_kept], sums])
        self._first_s = np.concatenate([self._first_s[is_kept], np.full(count, time_s)])
        self._variance = np.concatenate([self._variance[is_kept], variances[is_new]])
        self._unseen = np.concatenate([self._unseen[is_kept], np.zeros(count, np.int64)])
        if len(self) > _MAX_SOURCES:
            self._remove(np.argsort(self._unseen, kind="stable")[_MAX_SOURCES:])

    def take_moving(self, time_s: float, min_path_rad: float) -> tuple[BearingStates, FloatArray]:
        """Remove the sources that move, and return their states and their evidence of a defect.

        The slope of the line must exceed its error; this error follows from the scatter of the sightings
        about the line, if the scatter is larger than the stated error. The path of the source must be longer
        than ``min_path_rad`` and six standard deviations of a sighting together.
        """
        n, t, tt, x, y, tx, ty, rr, evidence = self._sums.T
        spread = tt - t * t / n
        candidates = np.flatnonzero((n >= _MIN_SIGHTINGS) & (self._unseen == 0) & (spread > 0.0))
        if len(candidates) == 0:
            return BearingStates(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 6, 6))), np.zeros(0)
        n, t, tt, x, y, tx, ty, rr, evidence = self._sums[candidates].T
        spread = tt - t * t / n
        slope = np.column_stack([tx - t * x / n, ty - t * y / n]) / spread[:, None]
        scatter = rr - (x * x + y * y) / n - (slope**2).sum(axis=1) * spread
        variance = np.maximum(scatter / (2.0 * n - 4.0), self._variance[candidates])
        significance = (slope**2).sum(axis=1) * spread / variance
        length = np.linalg.norm(slope, axis=1) * np.sqrt(12.0 * spread / n)
        moving = (
            (significance > _MIN_SIGNIFICANCE)
            & (length > min_path_rad + 6.0 * np.sqrt(variance))
            & (evidence < 0.0)
        )
        moving_rows = candidates[moving]
        now = time_s - self._first_s[moving_rows]
        states = self._states(moving_rows, slope[moving], variance[moving], spread[moving], now)
        found_evidence = evidence[moving]
        self._remove(moving_rows)
        return states, found_evidence

    def _states(
        self,
        moving_rows: IntArray,
        slope: FloatArray,
        variance: FloatArray,
        spread: FloatArray,
        now: FloatArray,
    ) -> BearingStates:
        """Return the states of sources at a time, from their lines."""
        n, t = self._sums[moving_rows, 0], self._sums[moving_rows, 1]
        mean_t = t / n
        place = self._sums[moving_rows, 3:5] / n[:, None] + slope * (now - mean_t)[:, None]
        u = self._origin[moving_rows] + np.einsum("ni,nij->nj", place, self._tangents[moving_rows])
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        velocity = np.einsum("ni,nij->nj", slope, self._tangents[moving_rows])
        P = np.zeros((len(moving_rows), 6, 6))
        across = np.eye(3) - u[:, :, None] * u[:, None, :]
        lag = now - mean_t
        P[:, :3, :3] = across * (variance * (1.0 / n + lag**2 / spread))[:, None, None]
        P[:, :3, 3:] = P[:, 3:, :3] = across * (variance * lag / spread)[:, None, None]
        rate_scale = np.maximum(variance / spread, (slope**2).sum(axis=1) * 0.01)
        along = u[:, :, None] * u[:, None, :]
        P[:, 3:, 3:] = across * (variance / spread)[:, None, None] + along * rate_scale[:, None, None]
        return BearingStates(u, np.cross(u, velocity), P)

    def _remove(self, indices: IntArray) -> None:
        is_kept = np.ones(len(self), bool)
        is_kept[indices] = False
        for name in ("_origin", "_tangents", "_sums", "_first_s", "_variance", "_unseen"):
            setattr(self, name, getattr(self, name)[is_kept])


def _sums(t: FloatArray, offset: FloatArray, evidence: FloatArray) -> FloatArray:
    x, y = offset[:, 0], offset[:, 1]
    return np.column_stack([np.ones_like(t), t, t * t, x, y, t * x, t * y, x * x + y * y, evidence])
