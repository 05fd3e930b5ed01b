# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo pairs of two cameras: their names and stamps."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from cdff_core.imaging.pair_rectifier import PAIR_TOLERANCE_NS

#: Words in the names of left cameras, and those in the names of the right ones.
_SIDES = (("left", "right"), ("cam0", "cam1"), ("camera0", "camera1"), ("infra1", "infra2"), ("l", "r"))


def counterpart(left: str) -> tuple[str, str] | None:
    """Return the name of the right camera and the common part of both names; None if it is no left camera.

    Those of ``/front/left/image`` are ``/front/right/image`` and ``/front//image``.
    """
    for left_word, right_word in _SIDES:
        pattern = re.compile(rf"(?<![a-z0-9]){left_word}(?![a-z0-9])", re.IGNORECASE)
        if pattern.search(left):

            def with_case(match: re.Match[str], word: str = right_word) -> str:
                return word.capitalize() if match[0][0].isupper() else word

            return pattern.sub(with_case, left), pattern.sub("", left)
    return None


def matched_stamps(left_ns: NDArray[np.int64], right_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of the left and right images of each pair, shape (n, 2), in the order of left ones.

    Two images are a pair if each is the nearest of its camera to the other, within ``PAIR_TOLERANCE_NS``.
    """
    if not len(left_ns) or not len(right_ns):
        return np.zeros((0, 2), np.int64)
    right_of_left, left_of_right = _nearest(left_ns, right_ns), _nearest(right_ns, left_ns)
    left = np.arange(len(left_ns))
    is_mutual = left_of_right[right_of_left] == left
    is_near = np.abs(left_ns - right_ns[right_of_left]) <= PAIR_TOLERANCE_NS
    chosen = left[is_mutual & is_near]
    return np.stack([chosen, right_of_left[chosen]], axis=1)


def _nearest(stamps_ns: NDArray[np.int64], others_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return, for each stamp, the index of the nearest of the other stamps; of equally near ones the
    first.
    """
    order = np.argsort(others_ns, kind="stable")
    ascending = others_ns[order]
    after = np.searchsorted(ascending, stamps_ns).clip(0, len(ascending) - 1)
    before = (after - 1).clip(0)
    is_before = np.abs(stamps_ns - ascending[before]) <= np.abs(ascending[after] - stamps_ns)
    nearest = np.where(is_before, before, after)
    return np.asarray(order[np.searchsorted(ascending, ascending[nearest])], np.int64)
