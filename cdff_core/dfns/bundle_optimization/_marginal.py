# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Marginalisation of dropped cameras and of the points they observed to a prior on the remaining cameras.

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


def marginalised(problem: BundleProblem, dropped: IntArray, loss: int, scale: float) -> BundleProblem:
    """Return the problem without the dropped cameras and their points; their observations become a prior.

    The linearisation point is the problem's estimate; lenses are treated as known. Raises InputError if a
    camera does not exist or none remains.
    """
    missing = np.setdiff1d(dropped, problem.cameras.ids)
    gone = np.isin(problem.cameras.ids, dropped)
    if missing.size or gone.all() or not gone.any():
        raise InputError(
            f"dropped {dropped.tolist()}: expected ids of cameras of the problem, and at least one "
            "remaining camera"
        )
    seen = problem.observations
    lost = np.zeros(len(problem.points.ids), bool)
    lost[seen.points[gone[seen.cameras]]] = True
    theirs = lost[seen.points]
    part = replace(problem, observations=_only(seen, theirs))
    system = System.of(part, 0, loss, scale)
    at = System.first(part)
    r, weights, *_ = system.residuals(at)
    S, b, _, _ = system.reduced(system.normal(at, r, weights), 0.0)
    S = np.tril(S) + np.tril(S, -1).T
    away, stay = (system.pose_column[rows & (system.pose_column >= 0)] for rows in (gone, ~gone))
    out, keep = ((c[:, None] + np.arange(POSE)).reshape(-1) for c in (away, stay))
    gain = np.linalg.pinv(S[np.ix_(out, out)], rcond=1e-13, hermitian=True) if len(out) else np.zeros((0, 0))
    H = S[np.ix_(keep, keep)] - S[np.ix_(keep, out)] @ gain @ S[np.ix_(out, keep)]
    gradient = b[keep] - S[np.ix_(keep, out)] @ gain @ b[out]
    stays = ~gone & (system.pose_column >= 0)
    H, gradient = _without_motions(H, gradient, Gauge.of(system, at), at.c[stays])
    cameras = problem.cameras
    prior = BundlePrior(cameras.ids[stays], cameras.poses[stays], H.reshape(-1), gradient)
    return _without(problem, gone, lost, theirs, prior)


def _without_motions(
    H: FloatArray, gradient: FloatArray, gauge: Gauge, c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Remove information about unconstrained motions of the whole problem, which is rounding noise."""
    if not len(c):
        return H, gradient
    scale = scales(H)
    Q = np.linalg.qr(scale[:, None] * (pose_derivatives(c - gauge.centre) @ gauge.free.T))[0]
    P = np.eye(len(H)) - (Q / scale[:, None]) @ (Q * scale[:, None]).T
    H = P.T @ H @ P
    return 0.5 * (H + H.T), P.T @ gradient


def _only(seen: BundleObservations, mask: BoolArray) -> BundleObservations:
    return BundleObservations(seen.cameras[mask], seen.points[mask], seen.pixels[mask])


def _without(
    problem: BundleProblem,
    gone: BoolArray,
    lost: BoolArray,
    theirs: BoolArray,
    prior: BundlePrior,
) -> BundleProblem:
    c, p, seen = problem.cameras, problem.points, _only(problem.observations, ~theirs)
    camera_row, point_row = np.cumsum(~gone) - 1, np.cumsum(~lost) - 1
    return BundleProblem(
        problem.metadata,
        BundleCameras(c.ids[~gone], c.stamps[~gone], c.poses[~gone], c.lenses[~gone], c.fixed[~gone]),
        problem.lenses,
        BundlePoints(p.ids[~lost], p.positions[~lost], p.fixed[~lost]),
        BundleObservations(
            camera_row[seen.cameras].astype(np.uint32), point_row[seen.points].astype(np.uint32), seen.pixels
        ),
        prior,
    )
