# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The comparison of an estimate with a reference: associate, align, count errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cdff_dev.trajectory import errors
from cdff_dev.trajectory.alignment import Mode, aligned, associated
from cdff_dev.trajectory.track import Float, Track


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What was found.

    Attributes
    ----------
    estimate, reference : Track
        Row by row, the estimate aligned.
    position_errors_m : ndarray, shape (n,)
    figures : dict
        As ``cdff eval trajectory --json`` prints it.
    """

    estimate: Track
    reference: Track
    position_errors_m: Float
    figures: dict[str, Any]


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
        See ``alignment.aligned``. Relative errors and drift do not depend on it, unless it scales.
    max_difference_s : float
        Stamps that belong together.
    delta, delta_unit, all_pairs
        Pairs of relative errors, by the estimate's way; see ``errors.pairs_apart``.
    segments_m : sequence of float, optional
        Lengths of the drift, by the reference's way; see ``errors.segments_for``.

    Raises
    ------
    InputError
        If no poses belong together, or none are delta apart.
    DegenerateGeometryError
        If the positions do not say how to align.
    """
    n_estimate, n_reference = len(estimate), len(reference)
    est, ref = associated(estimate, reference, max_difference_s)
    est, motion, scale = aligned(est, ref, align)
    metres, degrees = errors.absolute(est, ref)
    pairs = errors.pairs_apart(est, delta, delta_unit, all_pairs=all_pairs)
    step_metres, step_degrees = errors.relative(est, ref, pairs)
    way_m = float(ref.distances_m[-1])
    lengths = tuple(errors.segments_for(ref) if segments_m is None else segments_m)
    figures = {
        "estimate": estimate.name,
        "reference": reference.name,
        "poses": {"estimate": n_estimate, "reference": n_reference, "compared": len(est)},
        "way_m": way_m,
        "duration_s": float(ref.stamps_ns[-1] - ref.stamps_ns[0]) * 1e-9,
        "alignment": {"mode": align, "T": motion.tolist(), "scale": scale},
        "ate": {
            "translation_m": errors.statistics(metres),
            "rotation_deg": errors.statistics(degrees),
            "rmse_percent_of_way": 100.0 * errors.statistics(metres)["rmse"] / way_m if way_m > 0 else None,
        },
        "rpe": {
            "delta": delta,
            "unit": delta_unit,
            "all_pairs": all_pairs,
            "translation_m": errors.statistics(step_metres),
            "rotation_deg": errors.statistics(step_degrees),
        },
        "drift": errors.drift(est, ref, lengths),
        "nees": errors.consistency(est, ref),
    }
    return Comparison(est, ref, metres, figures)
