# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of an estimated trajectory with a reference: match by time, align, compute errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_dev.compare.trajectory import errors
from cdff_dev.compare.trajectory.alignment import Mode, apply_alignment, associate, orientation_alignment
from cdff_dev.compare.trajectory.track import Float, Track


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Errors of one trajectory against another.

    Attributes
    ----------
    estimate, reference : Track
        Matched row by row; the estimate is aligned.
    position_errors_m : ndarray, shape (n,)
    results : dict
        The output of ``cdff eval trajectory --json``.
    """

    estimate: Track
    reference: Track
    position_errors_m: Float
    results: dict[str, Any]


def compare(
    estimate: Track,
    reference: Track,
    *,
    align: Mode = "se3",
    max_difference_s: float = 0.01,
    delta: float = 1.0,
    delta_unit: str = "frames",
    all_pairs: bool = False,
    segments_m: Sequence[float] | None = None,
) -> Comparison:
    """Compare two trajectories.

    Parameters
    ----------
    estimate, reference : Track
    align : str
        See ``alignment.apply_alignment``. Relative errors and drift depend only on its scale. The NEES is
        that of poses relative to the first one (``origin``), without alignment for ``none``.
    max_difference_s : float
        Largest difference of matched stamps.
    delta, delta_unit, all_pairs
        Pairs of poses for relative errors, along the path of the estimate; see ``errors.pairs_apart``.
    segments_m : sequence of float, optional
        Segment lengths for the drift, along the path of the reference; by default
        ``errors.default_segments_m``.

    Raises
    ------
    InputError
        If no poses match in time, or none are ``delta`` apart.
    DegenerateGeometryError
        If the positions do not determine the alignment.
    """
    n_estimate, n_reference = len(estimate), len(reference)
    est, ref = associate(estimate, reference, max_difference_s)
    dropped = {"estimate": estimate.dropped, "reference": reference.dropped}
    # A fit to the positions distributes the errors over all poses, while covariances refer to the start.
    nees_mode: Mode = "none" if align == "none" else "origin"
    nees = errors.consistency(apply_alignment(est, ref, nees_mode)[0], ref)
    est, T_alignment, scale = apply_alignment(est, ref, align)
    metres, degrees = errors.absolute(est, ref)
    R = orientation_alignment(est, ref)
    own_degrees = errors.rotation_errors_deg(R @ est.matrices[:, :3, :3], ref.matrices[:, :3, :3])
    pairs = errors.pairs_apart(est, delta, delta_unit, all_pairs=all_pairs)
    relative_metres, relative_degrees = errors.relative(est, ref, pairs)
    path_length_m = float(ref.distances_m[-1])
    lengths = tuple(errors.default_segments_m(ref) if segments_m is None else segments_m)
    results = {
        "estimate": estimate.name,
        "reference": reference.name,
        "poses": {"estimate": n_estimate, "reference": n_reference, "compared": len(est)},
        "dropped": dropped,
        "path_length_m": path_length_m,
        "duration_s": float(ref.stamps_ns[-1] - ref.stamps_ns[0]) * 1e-9,
        "alignment": {
            "mode": align,
            "T": T_alignment.tolist(),
            "scale": scale,
            "orientations_deg": float(np.degrees(se3.rotation_angle(R))),
        },
        "ate": {
            "translation_m": errors.statistics(metres),
            "rotation_deg": errors.statistics(degrees),
            "rotation_aligned_deg": errors.statistics(own_degrees),
            "rmse_by_axis_m": dict(zip("xyz", _axis_rmse_m(est, ref), strict=True)),
            "rmse_percent_of_path": 100.0 * errors.statistics(metres)["rmse"] / path_length_m
            if path_length_m > 0
            else None,
        },
        "rpe": {
            "delta": delta,
            "unit": delta_unit,
            "all_pairs": all_pairs,
            "translation_m": errors.statistics(relative_metres),
            "rotation_deg": errors.statistics(relative_degrees),
        },
        "drift": errors.drift(est, ref, lengths),
        "nees": None if nees is None else {"alignment": nees_mode, **nees},
    }
    return Comparison(est, ref, metres, results)


def _axis_rmse_m(estimate: Track, reference: Track) -> list[float]:
    """Return the RMS of the position errors along the axes of the reference."""
    differences_m = estimate.positions_m - reference.positions_m
    rmse_m: list[float] = np.sqrt(np.mean(differences_m**2, axis=0)).tolist()
    return rmse_m
