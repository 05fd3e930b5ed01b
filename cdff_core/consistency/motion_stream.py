# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion that a sensor measures, as sums of small rotations and translations over time."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from cdff_common.geometry.se3 import FloatArray

#: Time for which a motion is stored, seconds, and number of entries by which the store may exceed that time.
_MEMORY_S, _BLOCK = 20.0, 256


class MotionStream:
    """Sums of the rotation vectors, and of the translations, of successive samples of a sensor in body axes.

    The difference of two sums is the motion between two times up to products of small rotations, which are
    negligible within a second.

    Attributes
    ----------
    has_translation : bool
        False for gyros and for sensors whose translations are too uncertain.
    """

    def __init__(self, *, has_translation: bool = False) -> None:
        self.has_translation = has_translation
        self._stamps_ns: list[int] = []
        self._sums: list[tuple[float, ...]] = []
        self._interruptions_ns: list[int] = []

    def __len__(self) -> int:
        """Return the number of samples in the memory."""
        return len(self._stamps_ns)

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest sample; None without samples."""
        return self._stamps_ns[-1] if self._stamps_ns else None

    @property
    def period_s(self) -> float:
        """Median interval of the samples, seconds; infinite with fewer than three."""
        if len(self._stamps_ns) < 3:
            return float("inf")
        return float(np.median(np.diff(np.array(self._stamps_ns[-50:])))) * 1e-9

    def add(self, stamp_ns: int, motion: tuple[float, ...], *, interrupted: bool = False) -> None:
        """Add the motion since the previous sample: rotation (3) in rad, then translation (3) in m.

        A sample that is not newer is ignored. ``interrupted`` marks a motion that is unknown.
        """
        if self._stamps_ns and stamp_ns <= self._stamps_ns[-1]:
            return
        last = self._sums[-1] if self._sums else (0.0,) * 6
        self._sums.append(tuple(a + b for a, b in zip(last, motion, strict=True)))
        self._stamps_ns.append(stamp_ns)
        if interrupted:
            self._interruptions_ns.append(stamp_ns)
        if len(self._stamps_ns) % _BLOCK == 0:
            first_retained = bisect_left(self._stamps_ns, stamp_ns - int(_MEMORY_S * 1e9))
            del self._stamps_ns[:first_retained], self._sums[:first_retained]
            self._interruptions_ns = [t for t in self._interruptions_ns if t >= self._stamps_ns[0]]

    def arrays(self, since_ns: int, origin_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the times (n,) after ``origin_ns`` in seconds, the sums (n, 6), and the interruptions.

        The last sample before ``since_ns`` is included.
        """
        first = max(bisect_left(self._stamps_ns, since_ns) - 1, 0)
        t_s = (np.array(self._stamps_ns[first:], dtype=np.int64) - origin_ns) * 1e-9
        breaks_s = (np.array(self._interruptions_ns, dtype=np.int64) - origin_ns) * 1e-9
        sums = np.array(self._sums[first:], dtype=np.float64).reshape(-1, 6)
        return np.asarray(t_s), sums, np.asarray(breaks_s)
