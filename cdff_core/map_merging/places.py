# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What robots say of their maps, and what was found between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.types import PoseGraph

Float = NDArray[np.float64]


class Place(NamedTuple):
    """A key frame of a robot, by its time: ids of key frames may change with a restart, times do not."""

    robot: str
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class RobotMap:
    """A robot's map.

    Attributes
    ----------
    robot : str
    graph : PoseGraph
        Key frames in the map's frame, and what was measured between them.
    surveyed : UncertainTransform
        ``T_site_map`` as it was before anything was found: where the mission says the map began.
    anchor : UncertainTransform
        ``T_site_map`` as it is stated now.
    """

    robot: str
    graph: PoseGraph
    surveyed: UncertainTransform
    anchor: UncertainTransform

    @cached_property
    def places(self) -> dict[Place, Float]:
        """``T_map_place`` of each key frame."""
        v = self.graph.vertices
        return {Place(self.robot, int(t)): T for t, T in zip(v.stamps_ns, v.matrices, strict=True)}

    @property
    def root(self) -> int:
        """Row of the vertex that the map began with: the one that is held, else the first."""
        fixed = self.graph.vertices.fixed
        return int(np.argmax(fixed)) if len(fixed) else 0


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """A verified ``T_first_second`` of two robots' key frames."""

    first: Place
    second: Place
    T: UncertainTransform

    @property
    def ends(self) -> tuple[Place, Place]:
        """Both places."""
        return self.first, self.second
