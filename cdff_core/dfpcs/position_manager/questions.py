# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Any frame in any other, each at its own time."""

from __future__ import annotations

from collections.abc import Callable

from cdff_common.geometry import UncertainTransform
from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.frames import RobotFrames
from cdff_core.dfpcs.position_manager.time_line import TimeLine


class Questions:
    """Joins the site's tree and the robot's over the time line.

    Parameters
    ----------
    ahead : callable
        An estimate for a time just beyond the line; None for one inside it.
    """

    def __init__(self, frames: RobotFrames, line: TimeLine, ahead: Callable[[int], Estimate | None]) -> None:
        self._frames, self._line, self._ahead = frames, line, ahead

    def at(self, t_ns: int) -> UncertainTransform:
        """``T_site_base``."""
        return self._line.at(t_ns, self._ahead(t_ns))

    def transform(
        self, parent: str, parent_t_ns: int, child: str, child_t_ns: int, start: UncertainTransform
    ) -> UncertainTransform:
        """``T_parent(t1)_child(t2)``; ``start`` is ``T_odom_base`` where the line begins.

        Raises
        ------
        FrameNotFoundError
            If a frame is unknown.
        ExtrapolationError
            If a time lies outside the time line.
        """
        f = self._frames
        parent_moves, child_moves = f.moves(parent), f.moves(child)
        if not parent_moves and not child_moves:
            return f.fixed(parent, child)
        if not parent_moves:
            T_base_child = f.on_robot(f.base, child, child_t_ns)
            if parent == f.odom:
                # The anchor's error is in every pose of the line, and not in how the robot moved since it stood there.
                return start @ self._motion(self._line.stamps_ns[:1], child_t_ns) @ T_base_child
            return f.fixed(parent, "site") @ self.at(child_t_ns) @ T_base_child
        if not child_moves:
            return self.transform(child, child_t_ns, parent, parent_t_ns, start).inverse()
        if parent_t_ns == child_t_ns:
            return f.on_robot(parent, child, child_t_ns)
        T_parent_base = f.on_robot(parent, f.base, parent_t_ns)
        return T_parent_base @ self._motion([parent_t_ns], child_t_ns) @ f.on_robot(f.base, child, child_t_ns)

    def _motion(self, begin_ns: list[int], end_ns: int) -> UncertainTransform:
        if not begin_ns:
            return self.at(end_ns)  # which says that no pose is known
        later = self._ahead(max(begin_ns[0], end_ns))
        return self._line.motion(begin_ns[0], end_ns, later)
