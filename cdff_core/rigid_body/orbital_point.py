# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A point at rest in the orbital axes (LVLH) of a spacecraft, seen from it in inertial axes.

Bodies that keep their position relative to a spacecraft move on circles in inertial axes. Relative to such a
point their motion is nearly straight.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_core.bearing_tracking.local_orbital import LocalOrbitalAxes

#: Number of stored states, and largest distance of a time from the nearest one, nanoseconds.
_MAX_STATES, _MAX_AGE_NS = 2000, 120_000_000_000


class OrbitalAxesHistory:
    """Orbital axes of a spacecraft at times near its measured states."""

    def __init__(self) -> None:
        self._states: deque[Sample] = deque(maxlen=_MAX_STATES)

    def give(self, sample: Sample) -> None:
        """Store a state of the spacecraft; raises InputError if it is not finite or not inertial."""
        state = sample.value
        values = np.concatenate([np.asarray(state.pos, float), np.asarray(state.velocity, float)])
        if not np.isfinite(values).all() or state.target_frame not in ("", "inertial"):
            raise InputError(
                f"navigation: state {values.tolist()} in frame {state.target_frame!r}, expected a finite one "
                "in 'inertial'"
            )
        if self._states and sample.stamp_ns <= self._states[-1].stamp_ns:
            raise InputError(
                f"navigation at {sample.stamp_ns} ns, expected after {self._states[-1].stamp_ns} ns"
            )
        self._states.append(sample)

    def at(self, stamps_ns: IntArray) -> list[LocalOrbitalAxes] | None:
        """Return the axes at times (n,); None if a time is far from all states.

        Raises
        ------
        DegenerateGeometryError
            If a state does not define the plane of an orbit.
        """
        if not self._states:
            return None
        known_ns = np.array([sample.stamp_ns for sample in self._states])
        rows = np.abs(stamps_ns[:, None] - known_ns).argmin(axis=1)
        if (np.abs(stamps_ns - known_ns[rows]) > _MAX_AGE_NS).any():
            return None
        return [
            LocalOrbitalAxes.of_state(
                self._states[row].value.pos,
                self._states[row].value.velocity,
                1e-9 * float(stamp_ns - known_ns[row]),
                0.0,
                0.0,
            )
            for stamp_ns, row in zip(stamps_ns, rows, strict=True)
        ]


def resting_motion(axes: list[LocalOrbitalAxes], position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return inertial positions (n, 3), m, and velocities (n, 3), m/s, of a position (3,) in the axes."""
    positions = np.array([a.rotation @ position_m for a in axes]).reshape(-1, 3)
    rates = np.array([a.rate for a in axes]).reshape(-1, 3)
    return positions, np.cross(rates, positions)
