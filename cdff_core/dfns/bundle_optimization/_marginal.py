# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Marginalisation of dropped cameras, and of the points they observed, to a prior on the remaining cameras.

Sibley, Matthies, Sukhatme (2010), Sliding window filter, doi:10.1002/rob.20360; Triggs et al. (2000) §6.1 for
the Schur complement.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.types import BundleCameras, BundleObservations, BundlePoints, BundlePrior, BundleProblem
from cdff_core.dfns.bundle_optimization._gauge import Gauge
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._motions import pose_derivatives
from cdff_core.dfns.bundle_optimization._prior import scales
from cdff_core.dfns.bundle_optimization._system import System


def marginalise(problem: BundleProblem, dropped: IntArray, loss: int, scale: float) -> BundleProblem:
    """Return the problem without the dropped cameras and the points they observed.

    All observations of these points and the previous prior are absorbed by the new prior. It is linearised at
    the poses of the problem; lenses are treated as known. Raises InputError if ``dropped`` is empty, contains
    a camera that does not exist, or contains all cameras.
    """
    missing = np.setdiff1d(dropped, problem.cameras.ids)
    is_dropped = np.isin(problem.cameras.ids, dropped)
    if missing.size or is_dropped.all() or not is_dropped.any():
        raise InputError(
            f"dropped {dropped.tolist()}: expected ids of cameras of the problem, and at least one "
            "remaining camera"
        )
    observations = problem.observations
    is_point_dropped = np.zeros(len(problem.points.ids), bool)
    is_point_dropped[observations.points[is_dropped[observations.cameras]]] = True
    is_absorbed = is_point_dropped[observations.points]
    absorbed = replace(problem, observations=_select(observations, is_absorbed))
    system = System.of(absorbed, 0, loss, scale)
    estimate = System.initial_estimate(absorbed)
    r, weights, *_ = system.residuals(estimate)
    S, b, _, _ = system.eliminate_points(system.normal(estimate, r, weights), 0.0)
    S = np.tril(S) + np.tril(S, -1).T
    is_prior_camera = ~is_dropped & (system.pose_column >= 0)
    dropped_columns = _pose_columns(system, is_dropped & (system.pose_column >= 0))
    keep = _pose_columns(system, is_prior_camera)
    dropped_inverse = np.linalg.pinv(S[np.ix_(dropped_columns, dropped_columns)], rcond=1e-13, hermitian=True)
    H = (
        S[np.ix_(keep, keep)]
        - S[np.ix_(keep, dropped_columns)] @ dropped_inverse @ S[np.ix_(dropped_columns, keep)]
    )
    gradient = b[keep] - S[np.ix_(keep, dropped_columns)] @ dropped_inverse @ b[dropped_columns]
    H, gradient = _remove_gauge_information(
        H, gradient, Gauge.of(system, estimate), estimate.c[is_prior_camera]
    )
    cameras = problem.cameras
    prior = BundlePrior(cameras.ids[is_prior_camera], cameras.poses[is_prior_camera], H.reshape(-1), gradient)
    return _remove(problem, is_dropped, is_point_dropped, is_absorbed, prior)


def _pose_columns(system: System, is_selected: BoolArray) -> IntArray:
    """Return the columns of the poses of the selected cameras, six for each."""
    return np.asarray((system.pose_column[is_selected, None] + np.arange(POSE)).reshape(-1))


def _remove_gauge_information(
    H: FloatArray, gradient: FloatArray, gauge: Gauge, c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return H and gradient without information about unconstrained motions, which is rounding noise.

    c ``(k, 3)`` are the positions of the cameras of H ``(6k, 6k)``.
    """
    if not len(c):
        return H, gradient
    scale = scales(H)
    Q = np.linalg.qr(scale[:, None] * (pose_derivatives(c - gauge.centre) @ gauge.free.T))[0]
    P = np.eye(len(H)) - (Q / scale[:, None]) @ (Q * scale[:, None]).T
    H = P.T @ H @ P
    return 0.5 * (H + H.T), P.T @ gradient


def _select(observations: BundleObservations, mask: BoolArray) -> BundleObservations:
    """Return the observations selected by a mask."""
    return BundleObservations(
        observations.cameras[mask], observations.points[mask], observations.pixels[mask]
    )


def _remove(
    problem: BundleProblem,
    is_dropped: BoolArray,
    is_point_dropped: BoolArray,
    is_absorbed: BoolArray,
    prior: BundlePrior,
) -> BundleProblem:
    """Return the problem with a new prior, without dropped cameras and points and absorbed observations."""
    c, p, observations = problem.cameras, problem.points, _select(problem.observations, ~is_absorbed)
    camera_row, point_row = np.cumsum(~is_dropped) - 1, np.cumsum(~is_point_dropped) - 1
    return BundleProblem(
        problem.metadata,
        BundleCameras(
            c.ids[~is_dropped],
            c.stamps[~is_dropped],
            c.poses[~is_dropped],
            c.lenses[~is_dropped],
            c.fixed[~is_dropped],
        ),
        problem.lenses,
        BundlePoints(p.ids[~is_point_dropped], p.positions[~is_point_dropped], p.fixed[~is_point_dropped]),
        BundleObservations(
            camera_row[observations.cameras].astype(np.uint32),
            point_row[observations.points].astype(np.uint32),
            observations.pixels,
        ),
        prior,
    )
