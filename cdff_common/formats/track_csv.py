# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks of objects as CSV: one state per row, with standard deviations of its groups and its status."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3

if TYPE_CHECKING:
    from cdff_common.types import ObjectTrack

#: Columns: time; pose of the object in the frame, metres; velocities, m/s and rad/s, in the frame; square
#: roots of the largest eigenvalues of the covariances of position, rotation vector, velocity and rate;
#: status.
COLUMNS = (
    "stamp_ns",
    *("x_m", "y_m", "z_m"),
    *("qx", "qy", "qz", "qw"),
    *("vx_mps", "vy_mps", "vz_mps", "wx_radps", "wy_radps", "wz_radps"),
    *("sigma_position_m", "sigma_attitude_rad", "sigma_velocity_mps", "sigma_rate_radps"),
    "status",
)


def write_track_csv(tracks: Sequence[ObjectTrack], statuses: Sequence[str] | None = None) -> bytes:
    """Return the states of tracks as CSV with a header.

    Parameters
    ----------
    tracks : sequence of ObjectTrack
        Written one after the other.
    statuses : sequence of str, optional
        One per track; by default the status of the track in words: TENTATIVE, CONFIRMED or LOST.

    Raises
    ------
    InputError
        If the numbers of tracks and statuses differ.
    """
    if statuses is None:
        statuses = [track.metadata.status.name.removeprefix("TRACK_") for track in tracks]
    if len(statuses) != len(tracks):
        raise InputError(f"{len(statuses)} statuses for {len(tracks)} tracks, expected equal numbers")
    lines = [",".join(COLUMNS)]
    for track, status in zip(tracks, statuses, strict=True):
        values = _values(track)
        for stamp_ns, row in zip(track.stamps_ns.tolist(), values.tolist(), strict=True):
            lines.append(f"{stamp_ns},{','.join(_number(value) for value in row)},{status}")
    return ("\n".join(lines) + "\n").encode()


def _values(track: ObjectTrack) -> NDArray[np.float64]:
    """Return the numbers of all states (n, 17), NaN where the track does not state them."""
    T, n = track.matrices, len(track.stamps_ns)
    quaternions = se3.quaternion_xyzw_from_matrix(T[:, :3, :3]) if n else np.zeros((0, 4))
    velocities = np.full((n, 6), np.nan) if track.velocities is None else track.velocities
    sigmas = [*_sigmas(track.covariances, n), *_sigmas(track.velocity_covariances, n)]
    return np.column_stack([T[:, :3, 3], quaternions, velocities, *sigmas])


def _sigmas(covariances: NDArray[np.float64] | None, n: int) -> tuple[NDArray[np.float64], ...]:
    """Return the largest standard deviations (n,) of the first and of the last three components."""
    if covariances is None:
        return np.full(n, np.nan), np.full(n, np.nan)
    blocks = covariances[:, :3, :3], covariances[:, 3:, 3:]
    return tuple(np.sqrt(_largest_variances(block)) for block in blocks)


def _largest_variances(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest eigenvalues (n,) of matrices (n, 3, 3); NaN for those that are not finite."""
    is_known = np.isfinite(blocks).all(axis=(1, 2))
    largest = np.full(len(blocks), np.nan)
    largest[is_known] = np.maximum(np.linalg.eigvalsh(blocks[is_known])[:, -1], 0.0)
    return largest


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.12g}"
