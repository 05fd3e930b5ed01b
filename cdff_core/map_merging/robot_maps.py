# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of robots and loop closures between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.types import PoseGraph

Float = NDArray[np.float64]


class KeyframeId(NamedTuple):
    """A keyframe of a robot, identified by its time, since its id may change with a restart."""

    robot: str
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class RobotMap:
    """The map of a robot."""

    robot: str
    graph: PoseGraph  # keyframes in the map frame, and the measurements between them
    #: ``T_site_map`` before merging: from the profile of the mission, or set over HTTP.
    survey: UncertainTransform
    anchor: UncertainTransform  # ``T_site_map`` as currently published

    @cached_property
    def keyframes(self) -> dict[KeyframeId, Float]:
        """``T_map_keyframe`` of each keyframe."""
        v = self.graph.vertices
        return {KeyframeId(self.robot, int(t)): T for t, T in zip(v.stamps_ns, v.matrices, strict=True)}

    @property
    def root(self) -> int:
        """Row of the fixed vertex in the graph; of the first vertex if none is fixed."""
        fixed = self.graph.vertices.fixed
        return int(np.argmax(fixed)) if len(fixed) else 0


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """A verified loop closure ``T_first_second`` between keyframes of two robots."""

    first: KeyframeId
    second: KeyframeId
    T: UncertainTransform

    @property
    def ends(self) -> tuple[KeyframeId, KeyframeId]:
        """Both keyframes."""
        return self.first, self.second
