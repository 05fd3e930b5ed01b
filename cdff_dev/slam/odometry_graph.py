# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graph of a trajectory without loop closures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import ODOMETRY
from cdff_dev.compare.trajectory.track import Track

#: Least standard deviation of a motion, metres and radians: that of a pose at rest is 0, without an inverse.
_LEAST_SIGMA = 1e-3


def odometry_graph(track: Track, frame: str) -> PoseGraph:
    """Return the poses relative to the first one as vertices, and the motions between them as edges.

    The covariance of a motion is the growth of that of the pose: ``Jc (C_c - J1 C_b J1^T) Jc^T`` with
    ``J1 = compose_jacobians(T_a_b, T_b_c)[0]`` and ``Jc = relative_jacobians(T_a_b, T_a_c)[1]``, which is
    exact for independent motions, plus (1 mm, 1 mrad)². Unknown covariances count as 0.
    """
    T = se3.inverse(track.matrices[0]) @ track.matrices
    motions = se3.inverse(T[:-1]) @ T[1:]
    n = len(T)
    is_fixed = np.arange(n) == 0
    return PoseGraph.from_arrays(
        np.arange(n),
        track.stamps_ns,
        T,
        np.column_stack([np.arange(n - 1), np.arange(1, n)]),
        motions,
        _information(track, motions),
        np.full(n - 1, ODOMETRY),
        frame=frame,
        fixed=is_fixed,
    )


def _information(track: Track, motions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the information (n, 6, 6) of motions from the growth of the covariance of the poses."""
    if track.covariances is None or not len(motions):
        growth = np.zeros((len(motions), 6, 6))
    else:
        known = np.nan_to_num(track.covariances)
        J1, _ = cov.compose_jacobians(track.matrices[:-1], motions)
        _, Jc = cov.relative_jacobians(track.matrices[:-1], track.matrices[1:])
        added = known[1:] - J1 @ known[:-1] @ np.swapaxes(J1, 1, 2)
        growth = np.array([cov.nearest_semidefinite(c) for c in Jc @ added @ np.swapaxes(Jc, 1, 2)])
    return cov.information_from_covariance(growth, _LEAST_SIGMA)
