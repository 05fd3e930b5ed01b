# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range of one object over time: a filter of its logarithm with constant rate."""

from __future__ import annotations

import numpy as np

#: Standard deviation of the rate, 1/s, and time constant with which it decays to zero, since objects change
#: direction.
_RATE_SIGMA, _RATE_MEMORY_S = 0.005, 20.0
#: Spectral density of the change of the rate, with which its standard deviation is constant, 1/s³.
_NOISE = 2.0 * _RATE_SIGMA**2 / _RATE_MEMORY_S
#: Innovation, in standard deviations, above which a measurement is refused, and number of successive refused
#: measurements with which the filter starts again.
_GATE, _REPLACE = 4.0, 5
#: Relative standard deviation from which a range is not observable.
_UNOBSERVABLE = 0.5


class RangeFilter:
    """Kalman filter of the logarithm of a range."""

    def __init__(self) -> None:
        self._x = np.zeros(2)
        self._P: np.ndarray | None = None
        self._stamp_ns = 0
        self._systematic = 0.0
        self._contradictions = 0

    def predict(self, stamp_ns: int) -> None:
        """Predict the state at a later time."""
        if self._P is None:
            return
        dt = (stamp_ns - self._stamp_ns) * 1e-9
        rate_decay = np.exp(-dt / _RATE_MEMORY_S)
        F = np.array([[1.0, _RATE_MEMORY_S * (1.0 - rate_decay)], [0.0, rate_decay]])
        self._x = F @ self._x
        self._P = F @ self._P @ F.T + _NOISE * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self._stamp_ns = stamp_ns

    def update(self, stamp_ns: int, range_m: float, sigma_m: float, systematic: float) -> None:
        """Add a measurement; its standard deviation must be below half of the range.

        ``systematic`` is a relative error of all measurements. A measurement that contradicts
        the range is not used; the fifth in succession replaces it.
        """
        z, variance = float(np.log(range_m)), (sigma_m / range_m) ** 2
        self.predict(stamp_ns)
        if self._P is not None:
            S = self._P[0, 0] + variance
            tolerance = _GATE * np.sqrt(S + systematic**2 + self._systematic**2)
            self._contradictions = self._contradictions + 1 if abs(z - self._x[0]) > tolerance else 0
            if 0 < self._contradictions < _REPLACE:
                return
        self._systematic = systematic
        if self._P is None or self._contradictions:
            self._x, self._P = np.array([z, 0.0]), np.diag([variance, _RATE_SIGMA**2])
            self._stamp_ns, self._contradictions = stamp_ns, 0
            return
        gain = self._P[:, 0] / S
        self._x = self._x + gain * (z - self._x[0])
        # Joseph's form for the measurement [1, 0].
        A = np.eye(2) - np.outer(gain, [1.0, 0.0])
        self._P = A @ self._P @ A.T + np.outer(gain, gain) * variance

    @property
    def value(self) -> tuple[float, float]:
        """Range and standard deviation, metres; NaN while not observable."""
        if self._P is None or not self._P[0, 0] < _UNOBSERVABLE**2:
            return float("nan"), float("nan")
        range_m = float(np.exp(self._x[0]))
        return range_m, range_m * float(np.sqrt(self._P[0, 0] + self._systematic**2))
