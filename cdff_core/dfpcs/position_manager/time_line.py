# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The robot's poses over time: interpolated, thinned with age, pinned where somebody needs a time again."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.frame_interpolation._interface import FrameInterpolationInputs
from cdff_core.dfpcs.position_manager.estimate import LINE, Estimate

_JITTER = 1e-14 * np.eye(9)
_SQUARE = np.ix_(LINE, LINE)


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """One estimate of the time line.

    Attributes
    ----------
    pose : array, shape (4, 4)
        ``T_site_base``.
    covariance : array, shape (9, 9)
        Of pose and gyro bias.
    link : array, shape (9, 9)
        Covariance of its errors (rows) with those of the node before.
    broken : bool
        Whether the time between it and the node before was forgotten, or nobody spoke in it.
    """

    stamp_ns: int
    pose: FloatArray
    covariance: FloatArray
    link: FloatArray
    broken: bool = False

    @classmethod
    def of(cls, estimate: Estimate) -> Node:
        """What the time line keeps of an estimate."""
        return cls(estimate.stamp_ns, estimate.pose, estimate.covariance[_SQUARE], estimate.since[LINE])


@dataclass(frozen=True, slots=True, eq=False)
class _Between:
    """A pose as the mean of those of nodes ``first`` and ``first + 1``, ``share`` of it the second's."""

    first: int
    share: float
    pose: UncertainTransform


class TimeLine:
    """Nodes in rising order of time.

    Errors of neighbouring nodes are linked, and those of any two by the links between them (a Markov chain): so motions
    between two times do not get the error of where they began.

    Parameters
    ----------
    blind_ns : int
        Where estimates are farther apart, nothing is known of the time in between.
    """

    def __init__(self, interpolation: Dfn[Any, Any, Any], blind_ns: int) -> None:
        self.nodes: list[Node] = []
        self.stamps_ns: list[int] = []
        #: Times that stay, nanoseconds.
        self.pins: set[int] = set()
        self._interpolation, self._blind_ns = interpolation, blind_ns

    def append(self, estimate: Estimate) -> None:
        """Add the newest estimate, or replace the one of the same time."""
        if self.stamps_ns and self.stamps_ns[-1] == estimate.stamp_ns:
            self.nodes[-1] = replace(Node.of(estimate), broken=self.nodes[-1].broken)
            return
        node = Node.of(estimate)
        if self.stamps_ns and estimate.stamp_ns - self.stamps_ns[-1] > self._blind_ns:
            node = replace(node, broken=True)
        self.nodes.append(node)
        self.stamps_ns.append(estimate.stamp_ns)

    def cut(self, stamp_ns: int) -> None:
        """Drop what is after a time."""
        k = bisect_right(self.stamps_ns, stamp_ns)
        del self.nodes[k:], self.stamps_ns[k:]

    def at(self, stamp_ns: int, ahead: Estimate | None = None) -> UncertainTransform:
        """``T_site_base`` at a time; ``ahead``: an estimate of a later one, made for this question.

        Raises
        ------
        ExtrapolationError
            If the time is outside the line, or was forgotten.
        """
        return self._between(self._with(ahead), stamp_ns).pose

    def motion(self, begin_ns: int, end_ns: int, ahead: Estimate | None = None) -> UncertainTransform:
        """``T_base(begin)_base(end)`` with the covariance of the motion alone; raises ExtrapolationError."""
        nodes = self._with(ahead)
        if begin_ns > end_ns:
            return self.motion(end_ns, begin_ns, ahead).inverse()
        a, b = self._between(nodes, begin_ns), self._between(nodes, end_ns)
        Rt = a.pose.matrix[:3, :3].T
        d = b.pose.matrix[:3, 3] - a.pose.matrix[:3, 3]
        T = se3.transform(Rt @ b.pose.matrix[:3, :3], Rt @ d)
        if begin_ns == end_ns:
            return UncertainTransform(np.eye(4), np.zeros((6, 6)))
        Ga, Gb = np.zeros((6, 6)), np.kron(np.eye(2), Rt)
        Ga[:3, :3] = Ga[3:, 3:] = -Rt
        Ga[:3, 3:] = Rt @ se3.skew(d)
        X = Gb @ _cross(nodes, a, b) @ Ga.T
        Ca, Cb = np.asarray(a.pose.covariance), np.asarray(b.pose.covariance)
        return UncertainTransform(T, _positive(Ga @ Ca @ Ga.T + Gb @ Cb @ Gb.T + X + X.T))

    def thin(self, before_ns: int, period_ns: int, forget_before_ns: int) -> None:
        """Keep one node a period before a time and none before another, but the first and those around pins."""
        kept: list[Node] = self.nodes[:1]
        needed = self._needed()
        for k in range(1, len(self.nodes)):
            last, node = kept[-1], self.nodes[k]
            if node.stamp_ns >= before_ns or k in needed or k == len(self.nodes) - 1:
                kept.append(node)
            elif node.stamp_ns < forget_before_ns:
                self.nodes[k + 1] = _past(last, node, self.nodes[k + 1], broken=True)
            elif node.stamp_ns - last.stamp_ns < period_ns and self.stamps_ns[k + 1] - last.stamp_ns <= period_ns:
                self.nodes[k + 1] = _past(last, node, self.nodes[k + 1], broken=node.broken)
            else:
                kept.append(node)
        self.nodes = kept
        self.stamps_ns = [node.stamp_ns for node in kept]

    def _needed(self) -> set[int]:
        """Indices of the nodes on either side of each pin."""
        needed = set()
        for pin in self.pins:
            k = bisect_right(self.stamps_ns, pin)
            needed |= {k - 1} if k and self.stamps_ns[k - 1] == pin else {k - 1, k}
        return needed

    def _with(self, ahead: Estimate | None) -> list[Node]:
        return self.nodes if ahead is None else [*self.nodes, Node.of(ahead)]

    def _between(self, nodes: list[Node], stamp_ns: int) -> _Between:
        if not nodes:
            raise ExtrapolationError("site to base: no pose is known yet")
        k = bisect_left(self.stamps_ns, stamp_ns)
        if k < len(nodes) and nodes[k].stamp_ns == stamp_ns:
            return _Between(k, 0.0, UncertainTransform(nodes[k].pose, nodes[k].covariance[:6, :6]))
        if k == 0 or k == len(nodes):
            first, last = nodes[0].stamp_ns, nodes[-1].stamp_ns
            outside = max(first - stamp_ns, stamp_ns - last) / 1e9
            raise ExtrapolationError(
                f"site to base at t={stamp_ns}: known from {first} to {last}, {outside:.3f} s outside; ask inside that "
                "span"
            )
        a, b = nodes[k - 1], nodes[k]
        if b.broken:
            raise ExtrapolationError(
                f"site to base at t={stamp_ns}: forgotten, or never known, from {a.stamp_ns} to {b.stamp_ns}; pin a "
                "time to keep it"
            )
        out = self._interpolation.process(
            FrameInterpolationInputs(
                a.pose,
                b.pose,
                np.array([a.stamp_ns, b.stamp_ns]),
                np.asarray(stamp_ns),
                a.covariance[:6, :6],
                b.covariance[:6, :6],
                b.link[:6, :6],
            )
        )
        return _Between(k - 1, float(out.fraction), UncertainTransform(out.pose, _positive(out.covariance)))


def _past(before: Node, gone: Node, after: Node, *, broken: bool) -> Node:
    """``after`` linked to the node before ``gone``."""
    link = after.link @ np.linalg.solve(gone.covariance + _JITTER, gone.link)
    return replace(after, link=link, broken=after.broken or broken)


def _cross(nodes: list[Node], a: _Between, b: _Between) -> FloatArray:
    """Covariance (6, 6) of the errors of ``b`` (rows) with those of ``a``, which is not later."""
    out = np.zeros((9, 9))
    for share_a, i in ((1.0 - a.share, a.first), (a.share, a.first + 1)):
        for share_b, j in ((1.0 - b.share, b.first), (b.share, b.first + 1)):
            if share_a * share_b > 0.0:
                out += share_a * share_b * (_linked(nodes, i, j) if i <= j else _linked(nodes, j, i).T)
    return out[:6, :6]


def _linked(nodes: list[Node], i: int, j: int) -> FloatArray:
    """Covariance (9, 9) of the errors of node j (rows) with those of node i, which is not later."""
    out = nodes[i].covariance
    for before, node in zip(nodes[i:j], nodes[i + 1 : j + 1], strict=True):
        out = node.link @ np.linalg.solve(before.covariance + _JITTER, out)
    return out


def _positive(C: FloatArray) -> FloatArray:
    """Symmetric, and without what rounding made negative."""
    values, vectors = np.linalg.eigh(0.5 * (C + C.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)
