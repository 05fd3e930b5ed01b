# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Path of the servicer relative to the client: segments with and without thrust, at any time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.kepler import EllipticOrbit, relative_orbit, relative_states, transfer
from cdff_dev.simulate.orbit.scenario import Circle, Drift, Hold, Line, OrbitScenario, Transfer

#: Function of times (n,) to positions (n, 3), axes of the path.
Positions = Callable[[FloatArray], FloatArray]


class RelativePath:
    """Positions of the servicer relative to the client.

    The axes are LVLH axes of the client, or inertial axes if the client is a small body.

    Parameters
    ----------
    scenario : OrbitScenario
    reference : EllipticOrbit or None
        Orbit of the client; None if it is a small body.

    Raises
    ------
    ConfigurationError
        If a segment is impossible, with its index.
    """

    def __init__(self, scenario: OrbitScenario, reference: EllipticOrbit | None) -> None:
        self._reference, self._mu = reference, scenario.mu_m3_s2
        self._starts_s: list[float] = []
        self._segments: list[Positions] = []
        position_m, start_s = np.array(scenario.servicer.start_m, dtype=float), 0.0
        for i, segment in enumerate(scenario.servicer.path):
            try:
                positions = self._segment(segment, position_m, start_s)
                end_m = positions(np.array([start_s + segment.duration_s]))[0]
            except InputError as error:
                raise ConfigurationError(f"servicer.path.{i}: {error}") from error
            self._starts_s.append(start_s)
            self._segments.append(positions)
            position_m, start_s = end_m, start_s + segment.duration_s

    def positions_m(self, t_s: FloatArray) -> FloatArray:
        """Return the positions (n, 3) at times (n,); before and after the path, its ends are extended."""
        index = np.clip(np.searchsorted(self._starts_s, t_s, side="right") - 1, 0, None)
        result = np.empty((len(t_s), 3))
        for i in np.unique(index):
            result[index == i] = self._segments[i](t_s[index == i])
        return result

    def append(self, segment: Line | Hold, start_s: float) -> None:
        """Continue the path with a segment from the position at ``start_s``, after the last segment began."""
        if start_s < self._starts_s[-1]:
            raise InputError(f"start_s={start_s:g}: expected at least {self._starts_s[-1]:g}")
        positions = self._segment(segment, self.positions_m(np.array([start_s]))[0], start_s)
        self._starts_s.append(start_s)
        self._segments.append(positions)

    def remove_last(self) -> None:
        """Remove the segment that was appended last."""
        self._starts_s.pop()
        self._segments.pop()

    def _segment(
        self, segment: Hold | Line | Transfer | Drift | Circle, start_m: FloatArray, start_s: float
    ) -> Positions:
        """Return the positions of a segment of the path from its start."""
        end_s = start_s + segment.duration_s
        if isinstance(segment, Hold):
            return _hold(segment, start_m, start_s)
        if isinstance(segment, Line):
            return _line(np.array(segment.to_m), start_m, start_s, segment.duration_s)
        if isinstance(segment, Circle):
            return _circle(segment, start_m, start_s)
        if isinstance(segment, Transfer):
            assert self._reference is not None  # checked by the scenario
            orbit = transfer(self._reference, start_m, segment.to_m, start_s, end_s)
            return self._relative(orbit)
        if self._reference is None:
            small = EllipticOrbit(start_m, segment.velocity_m_s, self._mu, start_s)
            return lambda t_s: small.states(t_s)[0]
        return self._relative(relative_orbit(self._reference, start_m, segment.velocity_m_s, start_s))

    def _relative(self, orbit: EllipticOrbit) -> Positions:
        assert self._reference is not None  # checked by the callers
        reference = self._reference
        return lambda t_s: relative_states(reference, orbit, t_s)[0]


def _hold(segment: Hold, start_m: FloatArray, start_s: float) -> Positions:
    """Return positions that deviate along each axis with a different period, from zero at the start."""
    frequency = 2.0 * np.pi / (segment.period_s * np.array([1.0, 0.83, 1.21]))
    return lambda t_s: start_m + segment.deadband_m * np.sin(np.outer(t_s - start_s, frequency))


def _line(to_m: FloatArray, start_m: FloatArray, start_s: float, duration_s: float) -> Positions:
    """Return positions on a line with a polynomial of degree 5: no velocity and acceleration at its ends."""

    def positions(t_s: FloatArray) -> FloatArray:
        u = np.clip((t_s - start_s) / duration_s, 0.0, 1.0)
        return np.asarray(start_m + np.outer(u**3 * (10.0 - 15.0 * u + 6.0 * u**2), to_m - start_m))

    return positions


def _circle(segment: Circle, start_m: FloatArray, start_s: float) -> Positions:
    """Return positions about an axis, whose speed rises and falls smoothly at the ends."""
    axis = np.array(segment.axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise InputError("axis [0, 0, 0]: expected a direction")
    axis /= length
    ramp_s = min(0.1 * segment.period_s, 0.5 * segment.duration_s)
    total = segment.duration_s

    def angle(t_s: FloatArray) -> FloatArray:
        t = np.clip(t_s - start_s, 0.0, total)
        # Integral of a speed with raised-cosine ramps.
        rise, fall = np.minimum(t, ramp_s), np.maximum(t - (total - ramp_s), 0.0)
        k = math.pi / ramp_s
        travelled = 0.5 * (rise - np.sin(k * rise) / k) + np.maximum(t - ramp_s, 0.0)
        travelled -= 0.5 * (fall - np.sin(k * fall) / k)
        return np.asarray(2.0 * np.pi * travelled / segment.period_s)

    return lambda t_s: np.einsum("nij,j->ni", se3.exp_so3(np.outer(angle(t_s), axis)), start_m)
