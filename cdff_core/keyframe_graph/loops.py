# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loops between keyframes, and their comparison with the graph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
from cdff_core.keyframe_graph.graph import KeyframeGraph

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A verified loop: ``T_old_new`` of two keyframes."""

    old: int
    new: int
    T: UncertainTransform

    @property
    def distance_m(self) -> float:
        """Distance between both keyframes."""
        return float(np.linalg.norm(self.T.matrix[:3, 3]))


@dataclass(frozen=True, slots=True)
class DriftLimits:
    """Largest drift over the length of a loop: a constant part and a part per metre."""

    translation_m: float
    translation_ratio: float
    rotation_rad: float
    rotation_rad_per_m: float

    def translation(self, length_m: float) -> float:
        """Return the largest drift of the position over a length, metres."""
        return self.translation_m + self.translation_ratio * length_m

    def rotation(self, length_m: float) -> float:
        """Return the largest drift of the rotation over a length, radians."""
        return self.rotation_rad + self.rotation_rad_per_m * length_m

    def explain(
        self, keyframes: KeyframeGraph[Any], old: int, key: int, T_old_key: Float, length_m: float
    ) -> bool:
        """Return whether drift over the length of the loop explains its difference from the graph."""
        T_old_key_graph = se3.inverse(keyframes.poses[old]) @ keyframes.poses[key]
        difference_m = float(np.linalg.norm((T_old_key_graph - T_old_key)[:3, 3]))
        R_difference = (T_old_key @ se3.inverse(keyframes.poses[key]) @ keyframes.poses[old])[:3, :3]
        is_near = difference_m <= self.translation(length_m)
        return is_near and float(se3.rotation_angle(R_difference)) <= self.rotation(length_m)
