# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Changes of frames and items between two worlds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

if TYPE_CHECKING:
    from cdff_common.world.world import World


@dataclass(frozen=True, slots=True, eq=False)
class FrameMotion:
    """Motion of a frame in its parent.

    Attributes
    ----------
    parent, child : str
    T_first_second : NDArray[np.float64], shape (4, 4)
        Pose at the second time in the axes of the first. Without covariance: the correlation of the errors
        at the two times is unknown.
    """

    parent: str
    child: str
    T_first_second: FloatArray

    @property
    def distance_m(self) -> float:
        """Distance between the two positions."""
        return float(np.linalg.norm(self.T_first_second[:3, 3]))

    @property
    def angle_rad(self) -> float:
        """Angle of the rotation between the two orientations."""
        return float(se3.rotation_angle(self.T_first_second[:3, :3]))


@dataclass(frozen=True, slots=True, eq=False)
class WorldDifference:
    """Changes from one world to another.

    Attributes
    ----------
    first_ns, second_ns : int
        Mission times of the two.
    motions : tuple of FrameMotion
        Frames with the same parent and another pose.
    frames_added, frames_removed : tuple of str
    reparented : tuple of str
        Frames with another parent.
    items_added, items_removed, items_changed : tuple of str
        Names of items; a changed item has another stamp.
    """

    first_ns: int
    second_ns: int
    motions: tuple[FrameMotion, ...]
    frames_added: tuple[str, ...]
    frames_removed: tuple[str, ...]
    reparented: tuple[str, ...]
    items_added: tuple[str, ...]
    items_removed: tuple[str, ...]
    items_changed: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "first_ns": self.first_ns,
            "second_ns": self.second_ns,
            "motions": [
                {
                    "parent": m.parent,
                    "child": m.child,
                    "distance_m": m.distance_m,
                    "angle_rad": m.angle_rad,
                    "T": m.T_first_second.tolist(),
                }
                for m in self.motions
            ],
            "frames": {
                "added": self.frames_added,
                "removed": self.frames_removed,
                "reparented": self.reparented,
            },
            "items": {
                "added": self.items_added,
                "removed": self.items_removed,
                "changed": self.items_changed,
            },
        }


def difference(first: World, second: World) -> WorldDifference:
    """Return the changes from ``first`` to ``second``."""
    before, after = ({edge.child: edge for edge in world.edges} for world in (first, second))
    common = sorted(before.keys() & after.keys())
    same = [name for name in common if before[name].parent == after[name].parent]
    relative = {
        name: se3.inverse(before[name].transform.matrix) @ after[name].transform.matrix for name in same
    }
    motions = [
        FrameMotion(after[name].parent, name, T)
        for name, T in relative.items()
        if not np.allclose(T, np.eye(4), rtol=0.0, atol=1e-12)
    ]
    stamps, new_stamps = ({item.name: item.stamp_ns for item in world.items} for world in (first, second))
    return WorldDifference(
        first.stamp_ns,
        second.stamp_ns,
        tuple(motions),
        _only_in(second.frames, first.frames),
        _only_in(first.frames, second.frames),
        tuple(name for name in common if name not in same),
        _only_in(new_stamps, stamps),
        _only_in(stamps, new_stamps),
        tuple(sorted(n for n in stamps.keys() & new_stamps.keys() if stamps[n] != new_stamps[n])),
    )


def _only_in(names: Any, others: Any) -> tuple[str, ...]:
    """Return the names that the others do not contain, in order."""
    return tuple(sorted(set(names) - set(others)))
