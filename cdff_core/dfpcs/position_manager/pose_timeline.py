# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Timeline of the robot's poses: interpolated, thinned with age, pinned on request."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import nearest_semidefinite, relative_jacobians
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import PoseTrajectory
from cdff_core.dfns.frame_interpolation.interface import FrameInterpolationInputs
from cdff_core.dfpcs.position_manager.estimate import TIMELINE_ERRORS, Estimate

_JITTER = 1e-14 * np.eye(9)
_BLOCK = np.ix_(TIMELINE_ERRORS, TIMELINE_ERRORS)


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """One estimate of the timeline."""

    stamp_ns: int
    pose: FloatArray  # (4, 4), ``T_site_base``
    covariance: FloatArray  # (9, 9), of pose and gyro bias
    cross_covariance: FloatArray  # (9, 9), covariance of its errors (rows) with those of the previous node
    #: True if nodes between the previous one and this one were removed, or no source measured in between.
    after_gap: bool = False

    @classmethod
    def from_estimate(cls, estimate: Estimate) -> Node:
        """Return the node with the errors of an estimate that the timeline stores."""
        cross = estimate.cross_covariance[TIMELINE_ERRORS]
        return cls(estimate.stamp_ns, estimate.pose, estimate.covariance[_BLOCK], cross)


@dataclass(frozen=True, slots=True, eq=False)
class _InterpolatedPose:
    """Pose between nodes ``first`` and ``first + 1``, at ``fraction`` of the time between them."""

    first: int
    fraction: float
    pose: UncertainTransform


class PoseTimeline:
    """Nodes in ascending order of time, without interpolation over silences longer than ``max_silence_ns``.

    The errors of successive nodes are correlated; the correlation of any two nodes follows from those of the
    nodes between them (a Markov chain). The covariance of a motion therefore does not contain the error of
    its start.
    """

    def __init__(self, interpolation: Dfn[Any, Any, Any], max_silence_ns: int) -> None:
        self.nodes: list[Node] = []
        self.stamps_ns: list[int] = []
        #: Times that are never removed, nanoseconds.
        self.pins: set[int] = set()
        self._interpolation, self._max_silence_ns = interpolation, max_silence_ns

    def restore(self, nodes: list[Node], pins: set[int]) -> None:
        """Set nodes and pins of an earlier run."""
        self.nodes, self.stamps_ns, self.pins = nodes, [node.stamp_ns for node in nodes], pins

    def append(self, estimate: Estimate) -> None:
        """Add the newest estimate; it replaces an estimate of the same time."""
        node = Node.from_estimate(estimate)
        if self.stamps_ns and self.stamps_ns[-1] == estimate.stamp_ns:
            self.nodes[-1] = replace(node, after_gap=self.nodes[-1].after_gap)
            return
        is_gap = bool(self.stamps_ns) and estimate.stamp_ns - self.stamps_ns[-1] > self._max_silence_ns
        self.nodes.append(replace(node, after_gap=is_gap))
        self.stamps_ns.append(estimate.stamp_ns)

    def remove_after(self, stamp_ns: int) -> None:
        """Remove all nodes after a time."""
        k = bisect_right(self.stamps_ns, stamp_ns)
        del self.nodes[k:], self.stamps_ns[k:]

    def pose_at(self, stamp_ns: int, prediction: Estimate | None = None) -> UncertainTransform:
        """Return ``T_site_base`` at a time; ``prediction`` is an estimate beyond the newest node.

        Raises ExtrapolationError if the time is outside the timeline or was removed.
        """
        return self._interpolate(self._nodes_with(prediction), stamp_ns).pose

    def motion(self, start_ns: int, end_ns: int, prediction: Estimate | None = None) -> UncertainTransform:
        """Return ``T_base(start)_base(end)`` and its covariance; raises ExtrapolationError."""
        nodes = self._nodes_with(prediction)
        if start_ns > end_ns:
            return self.motion(end_ns, start_ns, prediction).inverse()
        a, b = self._interpolate(nodes, start_ns), self._interpolate(nodes, end_ns)
        if start_ns == end_ns:
            return UncertainTransform.identity()
        T = se3.inverse(a.pose.matrix) @ b.pose.matrix
        Ja, Jb = relative_jacobians(a.pose.matrix, b.pose.matrix)
        X = Jb @ _cross_covariance(nodes, a, b) @ Ja.T
        Ca, Cb = np.asarray(a.pose.covariance), np.asarray(b.pose.covariance)
        return UncertainTransform(T, nearest_semidefinite(Ja @ Ca @ Ja.T + Jb @ Cb @ Jb.T + X + X.T))

    def thin(self, dense_ns: int, period_ns: int, oldest_ns: int) -> None:
        """Thin nodes before ``dense_ns`` to one per period; remove those before ``oldest_ns``.

        The first node, the newest node and those around pinned times are kept.
        """
        remaining: list[Node] = self.nodes[:1]
        pinned = self._pinned_nodes()
        for k in range(1, len(self.nodes)):
            last, node = remaining[-1], self.nodes[k]
            if node.stamp_ns >= dense_ns or k in pinned or k == len(self.nodes) - 1:
                remaining.append(node)
            elif node.stamp_ns < oldest_ns:
                self.nodes[k + 1] = _bypass(node, self.nodes[k + 1], after_gap=True)
            elif (
                node.stamp_ns - last.stamp_ns < period_ns
                and self.stamps_ns[k + 1] - last.stamp_ns <= period_ns
            ):
                self.nodes[k + 1] = _bypass(node, self.nodes[k + 1], after_gap=node.after_gap)
            else:
                remaining.append(node)
        self.nodes = remaining
        self.stamps_ns = [node.stamp_ns for node in remaining]

    def trajectory(self, t0_ns: int, t1_ns: int, base: str, producer: str) -> PoseTrajectory:
        """Return ``T_site_base`` between two times (-1: unbounded); raises ExtrapolationError if empty."""
        nodes = [
            n for n in self.nodes if (t0_ns < 0 or n.stamp_ns >= t0_ns) and (t1_ns < 0 or n.stamp_ns <= t1_ns)
        ]
        if not nodes:
            raise ExtrapolationError(f"trajectory from {t0_ns} to {t1_ns}: it contains no estimate")
        poses = [UncertainTransform(n.pose, n.covariance[:6, :6]) for n in nodes]
        return to_trajectory([n.stamp_ns // 1000 * 1000 for n in nodes], poses, base, producer)

    def _pinned_nodes(self) -> set[int]:
        """Return the indices of the nodes on either side of each pin."""
        pinned = set()
        for pin in self.pins:
            k = bisect_right(self.stamps_ns, pin)
            pinned |= {k - 1} if k and self.stamps_ns[k - 1] == pin else {k - 1, k}
        return pinned

    def _nodes_with(self, prediction: Estimate | None) -> list[Node]:
        return self.nodes if prediction is None else [*self.nodes, Node.from_estimate(prediction)]

    def _interpolate(self, nodes: list[Node], stamp_ns: int) -> _InterpolatedPose:
        """Return the pose at a time between two nodes; raises ExtrapolationError outside or in a gap."""
        if not nodes:
            raise ExtrapolationError("site to base: no pose is known yet")
        k = bisect_left(self.stamps_ns, stamp_ns)
        if k < len(nodes) and nodes[k].stamp_ns == stamp_ns:
            pose = UncertainTransform(nodes[k].pose, nodes[k].covariance[:6, :6])
            return _InterpolatedPose(k, 0.0, pose)
        if k == 0 or k == len(nodes):
            first, last = nodes[0].stamp_ns, nodes[-1].stamp_ns
            outside = max(first - stamp_ns, stamp_ns - last) / 1e9
            raise ExtrapolationError(
                f"site to base at t={stamp_ns}: {outside:.3f} s outside the known span from {first} to "
                f"{last}; request a time inside it"
            )
        a, b = nodes[k - 1], nodes[k]
        if b.after_gap:
            raise ExtrapolationError(
                f"site to base at t={stamp_ns}: removed or never known from {a.stamp_ns} to {b.stamp_ns}; "
                "pin a time to keep it"
            )
        out = self._interpolation.process(
            FrameInterpolationInputs(
                first=a.pose,
                second=b.pose,
                interval_ns=np.array([a.stamp_ns, b.stamp_ns]),
                time_ns=stamp_ns,
                first_covariance=a.covariance[:6, :6],
                second_covariance=b.covariance[:6, :6],
                cross_covariance=b.cross_covariance[:6, :6],
            )
        )
        pose = UncertainTransform(out.pose, nearest_semidefinite(out.covariance))
        return _InterpolatedPose(k - 1, out.fraction, pose)


def to_trajectory(
    stamps_ns: Sequence[int], poses: Sequence[UncertainTransform], base: str, producer: str
) -> PoseTrajectory:
    """Return poses ``T_site_base`` as a trajectory."""
    return PoseTrajectory.from_arrays(
        np.array(stamps_ns, dtype=np.int64),
        np.array([p.matrix for p in poses]).reshape(-1, 4, 4),
        np.array([p.covariance for p in poses]).reshape(-1, 6, 6),
        parent="site",
        child=base,
        producer=producer,
    )


def _bypass(removed: Node, node: Node, *, after_gap: bool) -> Node:
    """Return the node after ``removed``, correlated with the node before ``removed``."""
    gain = np.linalg.solve(removed.covariance + _JITTER, removed.cross_covariance)
    return replace(node, cross_covariance=node.cross_covariance @ gain, after_gap=node.after_gap or after_gap)


def _cross_covariance(nodes: list[Node], a: _InterpolatedPose, b: _InterpolatedPose) -> FloatArray:
    """Return the cross-covariance (6, 6) of the errors of ``b`` (rows) and of the earlier ``a`` (columns)."""
    out = np.zeros((9, 9))
    for weight_a, i in ((1.0 - a.fraction, a.first), (a.fraction, a.first + 1)):
        for weight_b, j in ((1.0 - b.fraction, b.first), (b.fraction, b.first + 1)):
            if weight_a * weight_b > 0.0:
                C = _chain_covariance(nodes, i, j) if i <= j else _chain_covariance(nodes, j, i).T
                out += weight_a * weight_b * C
    return out[:6, :6]


def _chain_covariance(nodes: list[Node], i: int, j: int) -> FloatArray:
    """Return the cross-covariance (9, 9) of the errors of node j (rows)
    and of the earlier node i (columns).
    """
    out = nodes[i].covariance
    for previous, node in zip(nodes[i:j], nodes[i + 1 : j + 1], strict=True):
        out = node.cross_covariance @ np.linalg.solve(previous.covariance + _JITTER, out)
    return out
