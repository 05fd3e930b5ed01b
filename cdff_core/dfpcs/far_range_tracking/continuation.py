# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which new object is a coasting one that comes into view again: motion, size and appearance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_core.bearing_tracking.motion import BearingStates, motion_significance, tangents
from cdff_core.dfpcs.far_range_tracking.scene import Scene
from cdff_core.dfpcs.far_range_tracking.tracked_object import TrackedObject

#: A new object continues a coasting one up to this squared normalised difference of motion, size and
#: appearance; standard deviations of the logarithm of the size and of 1 minus the correlation.
_CONTINUES, _SIZE_SIGMA, _SCORE_SIGMA = 30.0, 0.2, 0.25
#: The same before a new object is confirmed, and its least number of measurements.
_CONTINUES_EARLY, EARLY_HITS = 15.0, 3
#: Least squared velocity of a new object, in squared standard deviations, and largest difference between its
#: path and velocity times age, relative to the path: the path of a start from rest is half of that product.
_SIGNIFICANCE, _STEADY = 16.0, 1.5


def coasting_predecessor(
    new: TrackedObject,
    objects: Sequence[TrackedObject],
    scene: Scene,
    similarity: Callable[[TrackedObject, FloatArray, Scene], float],
    *,
    is_early: bool = False,
) -> TrackedObject | None:
    """Return the coasting object that a new one continues, or None.

    The velocity of a new object is wrong while it comes into view: ``is_early`` compares only position, size
    and appearance, and the choice must be unique. ``similarity`` returns the correlation of the appearance of
    an object with an image position.
    """
    # The stored size of an object that comes into view grows slowly.
    size_px = scene.sizes[new.region] if new.region >= 0 else new.size_px
    costs: list[tuple[float, TrackedObject]] = []
    for old in objects:
        if old.misses <= 1:
            continue
        ratio = float(np.abs(np.log(size_px / old.size_px)).max())
        cost = motion_distance(new.states, old.states, position_only=is_early) + (ratio / _SIZE_SIGMA) ** 2
        if cost < _CONTINUES:
            costs.append((cost + ((1.0 - similarity(old, new.pixel, scene)) / _SCORE_SIGMA) ** 2, old))
    costs.sort(key=lambda candidate: candidate[0])
    limit = _CONTINUES_EARLY if is_early else _CONTINUES
    is_unique = not is_early or len(costs) < 2 or costs[1][0] > 2.0 * limit
    return costs[0][1] if costs and costs[0][0] < limit and is_unique else None


def moves_steadily(o: TrackedObject, age_s: float) -> bool:
    """Return whether the velocity is significant and, times the age, agrees with the path of the object."""
    if float(motion_significance(o.states)[0]) < _SIGNIFICANCE:
        return False
    path = o.direction - o.start
    by_velocity = np.cross(o.states.rates[0], o.direction) * age_s
    return bool(np.linalg.norm(path - by_velocity) < _STEADY * np.linalg.norm(path))


def motion_distance(a: BearingStates, b: BearingStates, *, position_only: bool = False) -> float:
    """Return the squared difference of direction, and of velocity, of two states in standard deviations."""
    e = tangents(b.directions)[0]
    u, v = a.directions[0], b.directions[0]
    difference = np.concatenate([e @ (u - v), e @ (np.cross(a.rates[0], u) - np.cross(b.rates[0], v))])
    turn = np.cross(v, e)
    H = np.zeros((4, 6))
    H[:2, :3], H[2:, 3:] = turn, turn
    P = H @ (a.covariances[0] + b.covariances[0]) @ H.T + 1e-12 * np.eye(4)
    if position_only:
        difference, P = difference[:2], P[:2, :2]
    return float(difference @ np.linalg.solve(P, difference))
