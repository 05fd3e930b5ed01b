# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a detected body that one scan did not separate, and the choice between them by later scans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.model_pose_refinement.interface import ModelPoseRefinementInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.scan_detection import are_equivalent, surface_ports


@dataclass(frozen=True, slots=True, eq=False)
class PoseAlternatives:
    """Poses that explain the scan of a detection nearly as well as the pose of the track.

    Attributes
    ----------
    T_body_alternative : ndarray, shape (n, 4, 4)
        Relative to the pose of the track, constant in time.
    excess : ndarray, shape (n,)
        Sum of the differences of -2 log likelihood to the track over the scans since the detection.
    """

    T_body_alternative: FloatArray
    excess: FloatArray

    @classmethod
    def none(cls) -> PoseAlternatives:
        """Return no alternatives."""
        return cls(np.zeros((0, 4, 4)), np.zeros(0))

    @classmethod
    def of(cls, model: ModelPreparationOutputs, poses: Iterable[FloatArray]) -> PoseAlternatives:
        """Return the alternatives to the first of several poses (4, 4), without those that the symmetry of
        the model makes equivalent.
        """
        first, *others = poses
        distinct: list[FloatArray] = []
        for T in others:
            if not any(are_equivalent(model, T, known) for known in (first, *distinct)):
                distinct.append(T)
        relative = np.array([se3.inverse(first) @ T for T in distinct]).reshape(-1, 4, 4)
        return cls(relative, np.zeros(len(relative)))

    def __len__(self) -> int:
        return len(self.excess)

    def compared(
        self,
        refine: Dfn[Any, Any, Any],
        model: ModelPreparationOutputs,
        T_sensor_body: FloatArray,
        points_m: FloatArray,
        sigma_m: float,
        ambiguity: float,
    ) -> PoseAlternatives:
        """Return the alternatives that remain after another scan; those with an excess above ``ambiguity``
        are excluded.

        Parameters
        ----------
        refine : Dfn
            ModelPoseRefinement.
        T_sensor_body : ndarray, shape (4, 4)
            Pose of the track at the scan.
        points_m : ndarray, shape (n, 3)
            Points of the body.
        """
        poses = np.concatenate([T_sensor_body[None], T_sensor_body @ self.T_body_alternative])
        costs = np.array([_cost(refine, model, T, points_m, sigma_m) for T in poses])
        excess = self.excess + costs[1:] - costs[0]
        remains = excess <= ambiguity
        return PoseAlternatives(self.T_body_alternative[remains], excess[remains])

    def best(self, ambiguity: float) -> int | None:
        """Return the row of the alternative that explains the scans better than the track by more than
        ``ambiguity``; None without one.
        """
        if not len(self) or self.excess.min() >= -ambiguity:
            return None
        return int(self.excess.argmin())

    def replaced(self, row: int) -> PoseAlternatives:
        """Return the alternatives to the pose of a row, which becomes that of the track."""
        chosen = self.T_body_alternative[row]
        poses = np.concatenate([np.eye(4)[None], np.delete(self.T_body_alternative, row, axis=0)])
        excess = np.append(0.0, np.delete(self.excess, row)) - self.excess[row]
        return PoseAlternatives(np.asarray(se3.inverse(chosen) @ poses), excess)


def _cost(
    refine: Dfn[Any, Any, Any],
    model: ModelPreparationOutputs,
    T_sensor_body: FloatArray,
    points_m: FloatArray,
    sigma_m: float,
) -> float:
    """Return -2 log likelihood of a scan at the best pose near a pose."""
    refined = refine.process(
        ModelPoseRefinementInputs(
            scan=points_m,
            poses=T_sensor_body[None],
            drawn_vertices=model.drawn_vertices,
            drawn_triangles=model.drawn_triangles,
            centre_m=model.centre_m,
            sigma_m=sigma_m,
            sigma_is_upper_bound=False,
            **surface_ports(model),
        )
    )
    return float(refined.costs[0])
