# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a lidar in the frame of a camera, from a board that both see [1]_.

The plane of the board in the camera must agree with the plane of the panel in the scan. Several surfaces of a
scan can have the size of the panel: the start is the pose with which most scans agree, among those by the
normals and centres of two scans. A guess is not needed.

References
----------
.. [1] Zhang, Q., Pless, R. (2004). Extrinsic calibration of a camera and laser range finder. IROS.
  doi:10.1109/IROS.2004.1389752
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_core.calibration.board_poses import BoardPose
from cdff_core.calibration.panels import Panel
from cdff_core.calibration.relative_pose import RelativePose, undetermined_directions

#: Least number of scans.
LEAST_SCANS = 4
#: Largest differences of a panel that agrees with the start: of the centres, as a part of the diagonal of the
#: panel, and of the normals, radians.
_CENTRE_PART, _ANGLE = 0.35, np.deg2rad(8.0)
#: Smallest angle between the normals of the two scans of a start solution.
_LEAST_ANGLE = np.deg2rad(10.0)
#: Largest number of start solutions.
_STARTS = 4000
#: Scans whose residual is above this number of standard deviations contradict the others.
_GATE = 5.0
_HUBER = 1.5
_ITERATIONS = 40
#: Smallest standard deviations of the distance (m) and of the slopes of a plane.
_FLOORS = np.array([2e-4, 2e-4, 2e-4])
_PRIOR = np.diag([1e-2] * 3 + [1.0 / np.pi**2] * 3)


def camera_lidar_calibration(
    boards: Sequence[BoardPose],
    panels: Sequence[Sequence[Panel]],
    *,
    centre_m: FloatArray,
    diagonal_m: float,
    seed: int = 1,
) -> RelativePose:
    """Return the pose ``T_camera_lidar``.

    Parameters
    ----------
    boards : sequence of BoardPose
        Pose of the board in each of the n images.
    panels : sequence of sequences of Panel
        Surfaces of the size of the panel in the scan at the time of each image.
    centre_m : ndarray, shape (3,)
        Centre of the panel in the frame of the board.
    diagonal_m : float
        Diagonal of the panel.
    seed : int
        Of the start solutions.

    Raises
    ------
    InputError
        If the numbers of images and scans differ.
    DegenerateGeometryError
        If fewer than ``LEAST_SCANS`` scans have a panel or agree with each other.
    """
    if len(boards) != len(panels):
        raise InputError(f"{len(boards)} images and {len(panels)} scans: expected equal numbers")
    seen = [k for k, own in enumerate(panels) if own]
    if len(seen) < LEAST_SCANS:
        raise DegenerateGeometryError(
            f"a panel of this size was detected in {len(seen)} of {len(panels)} scans, expected at least "
            f"{LEAST_SCANS}; check --panel, keep other surfaces away from the board, and move it closer",
            ("panel",),
        )
    normals, centres = _planes(boards, centre_m)
    start, chosen = _start(normals, centres, panels, seen, diagonal_m, seed)
    if len(chosen) < LEAST_SCANS:
        raise DegenerateGeometryError(
            f"{len(chosen)} of {len(seen)} scans agree with each other, expected at least {LEAST_SCANS}; "
            "check that scans and images have the same time, and the size of the board",
            ("panel",),
        )
    rows = np.array(sorted(chosen))
    own = [chosen[int(k)] for k in rows]
    T, covariance, distances, rms = _adjusted(start, normals[rows], centres[rows], own, boards, rows)
    is_used = np.atleast_1d((distances < _GATE).all(axis=1))
    if not is_used.all() and is_used.sum() >= LEAST_SCANS:
        rows, own = rows[is_used], [p for p, used in zip(own, is_used, strict=True) if used]
        T, covariance, _, rms = _adjusted(T, normals[rows], centres[rows], own, boards, rows)
    dropped = len(seen) - len(rows)
    return RelativePose(
        UncertainTransform(se3.normalise_transform(T), covariance),
        undetermined_directions(covariance),
        tuple(_sentences(normals[rows], covariance, dropped, len(panels) - len(seen))),
        len(rows),
        dropped,
        {
            "rms_m": float(rms[0]),
            "rms_deg": float(np.rad2deg(rms[1])),
            "panel_rms_m": float(np.median([panel.rms_m for panel in own])),
            "points_per_panel": float(np.median([panel.points for panel in own])),
        },
    )


def _planes(boards: Sequence[BoardPose], centre_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normals towards the camera and centres of the panels in the frame of the camera, ``(n, 3)``."""
    T = np.array([board.T_camera_board for board in boards])
    centres = T[:, :3, :3] @ centre_m + T[:, :3, 3]
    normals = T[:, :3, 2]
    signs = np.where(np.einsum("ni,ni->n", normals, centres) > 0.0, -1.0, 1.0)
    return normals * signs[:, None], centres


def _start(
    normals: FloatArray,
    centres: FloatArray,
    panels: Sequence[Sequence[Panel]],
    seen: Sequence[int],
    diagonal_m: float,
    seed: int,
) -> tuple[FloatArray, dict[int, Panel]]:
    """Return the pose with which most scans agree, and the panel of each of these scans."""
    rng = np.random.default_rng(seed)
    best: tuple[int, float] = (-1, np.inf)
    result: tuple[FloatArray, dict[int, Panel]] = (np.eye(4), {})
    for _ in range(_STARTS):
        i, j = (int(k) for k in rng.choice(seen, 2, replace=False))
        if abs(normals[i] @ normals[j]) > np.cos(_LEAST_ANGLE):
            continue
        a, b = (panels[k][int(rng.integers(len(panels[k])))] for k in (i, j))
        between = np.arccos(np.clip(a.normal @ b.normal, -1.0, 1.0))
        expected = np.arccos(np.clip(normals[i] @ normals[j], -1.0, 1.0))
        length_m, expected_m = (
            np.linalg.norm(a.centre_m - b.centre_m),
            np.linalg.norm(centres[i] - centres[j]),
        )
        if abs(between - expected) > _ANGLE or abs(length_m - expected_m) > 2.0 * _CENTRE_PART * diagonal_m:
            continue
        T = _aligned([a, b], normals[[i, j]], centres[[i, j]], diagonal_m)
        chosen, error = _agreeing(T, normals, centres, panels, seen, diagonal_m)
        if (len(chosen), -error) > (best[0], -best[1]):
            best = (len(chosen), error)
            rows = sorted(chosen)
            if len(rows) >= LEAST_SCANS:
                T = _aligned([chosen[k] for k in rows], normals[rows], centres[rows], diagonal_m)
                again, _ = _agreeing(T, normals, centres, panels, seen, diagonal_m)
                chosen = again if len(again) >= len(chosen) else chosen
            result = (T, chosen)
            if len(chosen) == len(seen):
                break
    return result


def _aligned(own: Sequence[Panel], normals: FloatArray, centres: FloatArray, diagonal_m: float) -> FloatArray:
    """Return the pose that aligns normals and centres."""
    left = np.array([panel.centre_m for panel in own])
    right = centres
    a = np.concatenate([(left - left.mean(axis=0)) / diagonal_m, [2.0 * panel.normal for panel in own]])
    b = np.concatenate([(right - right.mean(axis=0)) / diagonal_m, 2.0 * normals])
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return se3.transform(R, right.mean(axis=0) - R @ left.mean(axis=0))


def _agreeing(
    T: FloatArray,
    normals: FloatArray,
    centres: FloatArray,
    panels: Sequence[Sequence[Panel]],
    seen: Sequence[int],
    diagonal_m: float,
) -> tuple[dict[int, Panel], float]:
    """Return the panels that agree with a pose and the mean of their errors as parts of the limits."""
    chosen: dict[int, Panel] = {}
    total = 0.0
    for k in seen:
        errors = []
        for panel in panels[k]:
            angle = np.arccos(np.clip((T[:3, :3] @ panel.normal) @ normals[k], -1.0, 1.0))
            distance_m = np.linalg.norm(T[:3, :3] @ panel.centre_m + T[:3, 3] - centres[k])
            errors.append(max(angle / _ANGLE, distance_m / (_CENTRE_PART * diagonal_m)))
        if min(errors) < 1.0:
            chosen[k] = panels[k][int(np.argmin(errors))]
            total += min(errors)
    return chosen, total / max(len(chosen), 1)


def _adjusted(
    T: FloatArray,
    normals: FloatArray,
    centres: FloatArray,
    own: Sequence[Panel],
    boards: Sequence[BoardPose],
    rows: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the pose, its covariance, normalised residuals ``(n, 3)`` and the RMS of both kinds ``(2,)``.

    The residuals of a scan are the distance of the panel's centre from the plane of the board, and the slopes
    of the panel relative to this plane along its two axes.
    """
    c = np.array([panel.centre_m for panel in own])
    np.array([panel.normal for panel in own])
    axes = np.array([panel.axes for panel in own])
    spread = np.array([panel.covariance for panel in own])
    for k, board in enumerate(int(row) for row in rows):
        J = _by_board(normals[k], centres[k], T, axes[k], boards[board].T_camera_board[:3, 3])
        spread[k] = spread[k] + J @ boards[board].covariance @ J.T
    scale = np.ones(2)
    for _ in range(_ITERATIONS):
        R = T[:3, :3]
        turned = c @ R.T
        r = np.column_stack(
            [
                np.einsum("ni,ni->n", normals, turned + T[:3, 3] - centres),
                *(np.einsum("ni,ni->n", normals, axes[:, m] @ R.T) for m in range(2)),
            ]
        )
        J = np.zeros((len(c), 3, 6))
        J[:, 0, :3] = normals
        J[:, 0, 3:] = np.cross(turned, normals)
        for m in range(2):
            J[:, 1 + m, 3:] = np.cross(axes[:, m] @ R.T, normals)
        base = np.sqrt(np.einsum("nii->ni", spread))
        parts = np.abs(r) / base
        scale = np.maximum(1.0, 1.4826 * np.array([np.median(parts[:, 0]), np.median(parts[:, 1:])]))
        sigma = np.maximum(base * scale[[0, 1, 1]], _FLOORS)
        z = np.abs(r) / sigma
        w = np.minimum(1.0, _HUBER / np.maximum(z, 1e-12)) / sigma**2
        H = np.einsum("nai,na,naj->ij", J, w, J)
        step = np.linalg.solve(H + 1e-4 * _PRIOR, -np.einsum("nai,na,na->i", J, w, r))
        T = se3.transform(se3.exp_so3(step[3:]) @ R, T[:3, 3] + step[:3])
        if float(np.abs(step).max()) < 1e-9:
            break
    freedom = max(3 * len(c) - 6, 1)
    # The scales are estimated from few scans: the covariance is that of Student's distribution.
    chi2 = float((w * r**2).sum()) / freedom
    covariance = np.linalg.inv(H + _PRIOR) * max(1.0, chi2) * (freedom + 2.0) / freedom
    rms = np.sqrt([np.mean(r[:, 0] ** 2), np.mean(r[:, 1:] ** 2)])
    return T, covariance, z, rms


def _by_board(
    normal: FloatArray, centre: FloatArray, T: FloatArray, axes: FloatArray, origin: FloatArray
) -> FloatArray:
    """Return the derivatives ``(3, 6)`` of the residuals by the error of the pose of the board."""
    J = np.zeros((3, 6))
    J[0, :3] = -normal
    J[0, 3:] = -np.cross(centre - origin, normal)
    for m in range(2):
        J[1 + m, 3:] = np.cross(normal, T[:3, :3] @ axes[m])
    return J


def _sentences(normals: FloatArray, covariance: FloatArray, dropped: int, unseen: int) -> list[str]:
    sentences = []
    missing = undetermined_directions(covariance)
    if missing:
        values = np.linalg.svd(normals, compute_uv=False)
        advice = (
            "tilt the board more, about both axes" if values[2] < 0.25 * values[0] else "take more images"
        )
        sentences.append(f"{', '.join(missing)} not determined: {advice}")
    if dropped:
        sentences.append(
            f"{dropped} scans contradict the others: check that scans and images have the same time, and "
            "keep other surfaces away from the board"
        )
    if unseen:
        sentences.append(f"no panel of this size in {unseen} scans: move the board closer to the lidar")
    return sentences or ["good: all directions are determined"]
