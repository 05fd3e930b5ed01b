# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaps of the path: after consecutive refused pairs it continues with a prediction."""

from __future__ import annotations

#: Number of consecutive refused pairs after which a keyframe is made at the predicted pose.
_MAX_REFUSED = 2


class Gaps:
    """Count the refused stereo pairs in a row, and the gaps that a prediction bridges.

    Attributes
    ----------
    count : int
        Gaps bridged by a prediction.
    is_open : bool
        True from a gap to the next located pair.
    """

    def __init__(self) -> None:
        self.count = 0
        self.is_open = False
        self._refused = 0

    def refuse(self) -> bool:
        """Count a refused pair; return whether the gap is to be bridged."""
        self._refused += 1
        return self._refused >= _MAX_REFUSED

    def bridge(self) -> None:
        """Count a gap, which stays open until a pair is located."""
        self.count, self.is_open, self._refused = self.count + 1, True, 0

    def close(self) -> None:
        """End a gap, and reset the count of refused pairs."""
        self.is_open, self._refused = False, 0
