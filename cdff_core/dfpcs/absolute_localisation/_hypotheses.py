# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaussian hypotheses of where a map lies on another, fused over the segments of a traverse.

References
----------
.. [1] Reid, D. (1979). An algorithm for tracking multiple targets. IEEE Transactions on Automatic Control 24(6).
   doi:10.1109/TAC.1979.1102177
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_core.dfns.raster_matching._interface import RasterMatchingOutputs

Float = NDArray[np.float64]

#: 99.9 % of chi2 with 4 degrees of freedom.
_GATE = 18.47
_MOST = 16


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One place of the map.

    Attributes
    ----------
    transform : Float, shape (4, 4)
        T_orbital_map: a shift, a turn about z, a height.
    covariance : Float, shape (4, 4)
        Of x, y, z and yaw at ``point``, errors in the orbital model's frame.
    point : Float, shape (3,)
        In the map's frame.
    log_weight : float
    matches : int
        Segments that agree with it.
    explained, correlation : float
        Of the last match, 0 without.
    """

    transform: Float
    covariance: Float
    point: Float
    log_weight: float = 0.0
    matches: int = 0
    explained: float = 0.0
    correlation: float = 0.0

    @property
    def place(self) -> Float:
        """The point in the orbital model's frame ``(3,)``."""
        return np.asarray(self.transform[:3, :3] @ self.point + self.transform[:3, 3])

    @property
    def yaw_rad(self) -> float:
        """Turn about z."""
        return float(np.arctan2(self.transform[1, 0], self.transform[0, 0]))

    @property
    def sigma_m(self) -> float:
        """Largest horizontal standard deviation."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    def at(self, point: Float, drift: Float) -> Hypothesis:
        """The same at another point of the map, less certain by the variances ``(4,)`` of the drift on the way."""
        arm = self.transform[:3, :3] @ (point - self.point)
        J = np.eye(4)
        J[0, 3], J[1, 3] = -arm[1], arm[0]
        return replace(self, point=point, covariance=J @ self.covariance @ J.T + np.diag(drift))

    def after(self, frame: Float) -> Hypothesis:
        """The same where the map's frame became another, ``frame`` = T_new_old."""
        point = frame[:3, :3] @ self.point + frame[:3, 3]
        return replace(self, transform=self.transform @ se3.inverse(frame), point=point)

    def joined(self, found: RasterMatchingOutputs, index: int) -> Hypothesis | None:
        """With a candidate matched at ``point``, by Kalman's update; None where it contradicts this one."""
        other = replace(self, transform=found.transforms[index])
        turn = (other.yaw_rad - self.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        innovation = np.append(other.place - self.place, turn)
        S = self.covariance + found.covariances[index]
        distance = float(innovation @ np.linalg.solve(S, innovation))
        if distance > _GATE:
            return None
        gain = np.linalg.solve(S, self.covariance).T
        left = np.eye(4) - gain
        covariance = left @ self.covariance @ left.T + gain @ found.covariances[index] @ gain.T
        moved = gain @ innovation
        R = se3.exp_so3(np.array([0.0, 0.0, moved[3]])) @ self.transform[:3, :3]
        t = self.place + moved[:3] - R @ self.point
        likelihood = float(found.log_likelihoods[index]) - 0.5 * distance
        return replace(
            self, transform=se3.transform(R, t), covariance=covariance, log_weight=self.log_weight + likelihood,
            matches=self.matches + 1, explained=float(found.explained[index]),
            correlation=float(found.correlations[index]),
        )  # fmt: skip


def fused(prior: Sequence[Hypothesis], found: RasterMatchingOutputs, apart_m: float) -> tuple[Hypothesis, ...]:
    """Every hypothesis with every candidate that agrees, and without any; likeliest first.

    That no candidate is right is as likely as the template being a plane with noise. Of hypotheses within ``apart_m``
    of one another the likeliest stays.
    """
    made: list[Hypothesis] = []
    for hypothesis in prior:
        made.append(replace(hypothesis, explained=0.0, correlation=0.0))
        joined = (hypothesis.joined(found, index) for index in range(len(found.transforms)))
        made += [one for one in joined if one is not None]
    return kept(made, apart_m)


def kept(hypotheses: Iterable[Hypothesis], apart_m: float) -> tuple[Hypothesis, ...]:
    """The likeliest, each at a place of its own, weights about the first's."""
    chosen: list[Hypothesis] = []
    for one in sorted(hypotheses, key=lambda h: -h.log_weight):
        if all(np.hypot(*(one.place - other.place)[:2]) > apart_m for other in chosen if other.matches):
            chosen.append(one)
    best = chosen[0].log_weight
    return tuple(replace(one, log_weight=one.log_weight - best) for one in chosen[:_MOST])


def probability(hypotheses: Sequence[Hypothesis]) -> float:
    """Of the first, among all."""
    weights = np.exp([h.log_weight - hypotheses[0].log_weight for h in hypotheses])
    return float(1.0 / weights.sum())
