# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaussian hypotheses of the pose of the robot's map on the orbital model, fused over a traverse.

References
----------
.. [1] Reid, D. (1979). An algorithm for tracking multiple targets. IEEE Transactions on Automatic
   Control 24(6). doi:10.1109/TAC.1979.1102177
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfns.raster_matching.interface import RasterMatchingOutputs

#: 99.9 % quantile of chi2 with 4 degrees of freedom.
_CHI2_GATE = 18.47
_MAX_HYPOTHESES = 16


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One pose of the map on the orbital model [1]_."""

    transform: FloatArray  # (4, 4), ``T_orbital_map``: translation and rotation about z
    covariance: FloatArray  # (4, 4), of x, y, z at ``point`` and of yaw, in the orbital model's frame
    point: FloatArray  # (3,), in the map's frame
    log_weight: float = 0.0
    matches: int = 0  # number of segments that agree with it
    explained: float = 0.0  # fraction of the relief that the last segment's match explains; 0 without a match
    correlation: float = 0.0  # correlation of the gradients at the last segment's match; 0 without a match

    @property
    def position(self) -> FloatArray:
        """Position (3,) of ``point`` in the orbital model's frame."""
        return np.asarray(self.transform[:3, :3] @ self.point + self.transform[:3, 3])

    @property
    def yaw_rad(self) -> float:
        """Rotation about z."""
        return float(np.arctan2(self.transform[1, 0], self.transform[0, 0]))

    @property
    def sigma_m(self) -> float:
        """Largest horizontal standard deviation."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    def at(self, point: FloatArray, drift: FloatArray) -> Hypothesis:
        """Return the hypothesis at another point of the map, with the variances (4,) of the drift added."""
        arm = self.transform[:3, :3] @ (point - self.point)
        J = np.eye(4)
        J[0, 3], J[1, 3] = -arm[1], arm[0]
        return replace(self, point=point, covariance=J @ self.covariance @ J.T + np.diag(drift))

    def in_frame(self, T_new_old: FloatArray) -> Hypothesis:
        """Return the hypothesis after a change of the map's frame."""
        point = T_new_old[:3, :3] @ self.point + T_new_old[:3, 3]
        return replace(self, transform=self.transform @ se3.inverse(T_new_old), point=point)

    def updated(self, candidates: RasterMatchingOutputs, index: int) -> Hypothesis | None:
        """Return this hypothesis updated (Kalman) with a candidate matched at ``point``; None if they
        contradict each other.
        """
        candidate = replace(self, transform=candidates.transforms[index])
        yaw_rad = (candidate.yaw_rad - self.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        innovation = np.append(candidate.position - self.position, yaw_rad)
        noise = candidates.covariances[index]
        S = self.covariance + noise
        squared_mahalanobis = float(innovation @ np.linalg.solve(S, innovation))
        if squared_mahalanobis > _CHI2_GATE:
            return None
        gain = np.linalg.solve(S, self.covariance).T
        I_minus_gain = np.eye(4) - gain
        correction = gain @ innovation
        R = se3.exp_so3(np.array([0.0, 0.0, correction[3]])) @ self.transform[:3, :3]
        t = self.position + correction[:3] - R @ self.point
        return replace(
            self,
            transform=se3.transform(R, t),
            covariance=I_minus_gain @ self.covariance @ I_minus_gain.T + gain @ noise @ gain.T,
            log_weight=self.log_weight
            + (float(candidates.log_likelihoods[index]) - 0.5 * squared_mahalanobis),
            matches=self.matches + 1,
            explained=float(candidates.explained[index]),
            correlation=float(candidates.correlations[index]),
        )


def fuse(
    prior: Sequence[Hypothesis], candidates: RasterMatchingOutputs, separation_m: float
) -> tuple[Hypothesis, ...]:
    """Update every hypothesis by every compatible candidate and by none; return the most probable first.

    If no candidate is correct, the likelihood is that of a plane with noise. Of hypotheses within
    ``separation_m`` of one another only the most probable is returned.
    """
    hypotheses: list[Hypothesis] = []
    for hypothesis in prior:
        hypotheses.append(replace(hypothesis, explained=0.0, correlation=0.0))
        updated = (hypothesis.updated(candidates, index) for index in range(len(candidates.transforms)))
        hypotheses += [h for h in updated if h is not None]
    return _prune(hypotheses, separation_m)


def _prune(hypotheses: Iterable[Hypothesis], separation_m: float) -> tuple[Hypothesis, ...]:
    """Return the most probable hypotheses at separate positions, weights relative to the first."""
    distinct: list[Hypothesis] = []
    for h in sorted(hypotheses, key=lambda h: -h.log_weight):
        if all(np.hypot(*(h.position - o.position)[:2]) > separation_m for o in distinct if o.matches):
            distinct.append(h)
    best = distinct[0].log_weight
    return tuple(replace(h, log_weight=h.log_weight - best) for h in distinct[:_MAX_HYPOTHESES])


def probability(hypotheses: Sequence[Hypothesis]) -> float:
    """Return the probability of the first hypothesis among all."""
    weights = np.exp([h.log_weight - hypotheses[0].log_weight for h in hypotheses])
    return float(1.0 / weights.sum())
