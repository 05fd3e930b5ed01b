# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of an estimated track whose rows are matched with those of a reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_dev.compare.registration.rates import nees_band
from cdff_dev.compare.trajectory.track import Float, Track

#: Tolerance of the distance between two poses if all pairs are used, as a fraction of ``delta``.
PAIR_TOLERANCE = 0.1
#: KITTI uses every tenth pose as the start of a segment.
_SEGMENT_STEP = 10
#: Lengths of the segments of the KITTI odometry benchmark, and those for shorter paths of rovers.
_KITTI_SEGMENTS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
_ROVER_SEGMENTS_M = (5.0, 10.0, 20.0, 50.0, 100.0)


def statistics(values: Float) -> dict[str, Any]:
    """Return count, RMS, mean, median, standard deviation, minimum, maximum and sum of squares."""
    return {
        "count": len(values),
        "rmse": float(np.sqrt(np.mean(values**2))),
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "std": float(values.std()),
        "min": float(values.min()),
        "max": float(values.max()),
        "sse": float(np.sum(values**2)),
    }


def absolute(estimate: Track, reference: Track) -> tuple[Float, Float]:
    """Return distances ``(n,)`` in metres and angles ``(n,)`` in degrees between the poses of each row."""
    E = se3.inverse(reference.matrices) @ estimate.matrices
    return np.linalg.norm(E[:, :3, 3], axis=1), np.degrees(se3.rotation_angle(E[:, :3, :3]))


def rotation_errors_deg(estimate: Float, reference: Float) -> Float:
    """Return the angles ``(n,)`` in degrees between rotations ``(n, 3, 3)`` of each row."""
    return np.asarray(np.degrees(se3.rotation_angle(np.swapaxes(reference, 1, 2) @ estimate)))


def relative(estimate: Track, reference: Track, pairs: NDArray[np.int64]) -> tuple[Float, Float]:
    """Return the errors of the motion between the rows of each pair ``(k, 2)``, metres and degrees.

    Sturm et al. (2012), doi:10.1109/IROS.2012.6385773.
    """
    first, second = pairs[:, 0], pairs[:, 1]
    true = se3.inverse(reference.matrices[first]) @ reference.matrices[second]
    estimated = se3.inverse(estimate.matrices[first]) @ estimate.matrices[second]
    E = se3.inverse(true) @ estimated
    return np.linalg.norm(E[:, :3, 3], axis=1), np.degrees(se3.rotation_angle(E[:, :3, :3]))


def pairs_apart(track: Track, delta: float, unit: str, *, all_pairs: bool) -> NDArray[np.int64]:
    """Return pairs of rows ``(k, 2)`` that are ``delta`` frames or metres of the track's path apart.

    Without ``all_pairs``, each pair starts at the end of the previous one. With it, pairs may overlap, and
    those in metres are within ``PAIR_TOLERANCE`` of ``delta``.

    Raises
    ------
    InputError
        If ``delta`` is not positive, or not a whole number of frames, or there is no such pair.
    """
    if not delta > 0 or (unit == "frames" and delta != int(delta)):
        raise InputError(f"delta={delta:g} {unit}: expected a value above 0, and a whole number of frames")
    n = len(track)
    if unit == "frames":
        first = np.arange(0, n - int(delta), 1 if all_pairs else int(delta))
        pairs = np.column_stack([first, first + int(delta)])
    elif all_pairs:
        pairs = _all_pairs(track.distances_m, delta)
    else:
        rows = [0]
        distances_m = track.distances_m
        while (after := int(np.searchsorted(distances_m - distances_m[rows[-1]], delta))) < n:
            rows.append(after)
        pairs = np.column_stack([rows[:-1], rows[1:]])
    if not len(pairs):
        raise InputError(
            f"delta={delta:g} {unit}: no two of {n} poses over {track.distances_m[-1]:.3g} m are so far apart"
        )
    return pairs.astype(np.int64)


def _all_pairs(distances_m: Float, delta_m: float) -> NDArray[np.int64]:
    """Return pairs of each row with the later row whose distance along the path is nearest to ``delta_m``."""
    n = len(distances_m)
    first = np.arange(n - 1)
    after = np.clip(np.searchsorted(distances_m, distances_m[first] + delta_m), first + 1, n - 1)
    before = np.maximum(after - 1, first + 1)
    error_after_m = np.abs(distances_m[after] - distances_m[first] - delta_m)
    error_before_m = np.abs(distances_m[before] - distances_m[first] - delta_m)
    second = np.where(error_after_m < error_before_m, after, before)
    # Of consecutive poses at the same position only the first is used.
    second = np.maximum(np.searchsorted(distances_m, distances_m[second]), first + 1)
    selected = np.minimum(error_after_m, error_before_m) <= PAIR_TOLERANCE * delta_m
    return np.column_stack([first[selected], second[selected]])


def default_segments_m(reference: Track) -> tuple[float, ...]:
    """Return the segment lengths of KITTI if the path is longer than 100 m, otherwise shorter lengths."""
    return _KITTI_SEGMENTS_M if reference.distances_m[-1] > _KITTI_SEGMENTS_M[0] else _ROVER_SEGMENTS_M


def drift(estimate: Track, reference: Track, lengths_m: Sequence[float]) -> dict[str, Any]:
    """Return the mean errors of segments relative to their length, for each length and over all.

    The metric of KITTI odometry, Geiger et al. (2012), doi:10.1109/CVPR.2012.6248074: a segment starts at
    every tenth pose and ends at the first pose at which its length is exceeded on the path of the reference.
    """
    distances_m = reference.distances_m
    starts = np.arange(0, len(reference), _SEGMENT_STEP)
    rows, all_percent, all_deg = [], [], []
    for length_m in lengths_m:
        if not length_m > 0:
            raise InputError(f"segment of {length_m:g} m: expected a length above 0")
        ends = np.searchsorted(distances_m, distances_m[starts] + length_m, side="right")
        inside = ends < len(reference)
        if not inside.any():
            continue
        metres, degrees = relative(estimate, reference, np.column_stack([starts[inside], ends[inside]]))
        all_percent.append(100.0 * metres / length_m)
        all_deg.append(degrees / length_m)
        rows.append(
            {
                "length_m": float(length_m),
                "count": int(inside.sum()),
                "translation_percent": float(all_percent[-1].mean()),
                "rotation_deg_per_m": float(all_deg[-1].mean()),
            }
        )
    if not rows:
        return {"segments": []}
    return {
        "segments": rows,
        "translation_percent": float(np.concatenate(all_percent).mean()),
        "rotation_deg_per_m": float(np.concatenate(all_deg).mean()),
    }


def consistency(estimate: Track, reference: Track) -> dict[str, Any] | None:
    """Compare the NEES of the poses with its chi-squared distribution; None without covariances.

    Bar-Shalom et al. (2001), doi:10.1002/0471221279, ch. 5.4. ``band_95`` is the two-sided interval of the
    mean of ``count`` independent errors. The errors of one trajectory are correlated, so that the mean of one
    run can be outside the band although the covariances are consistent. ``inside_95`` is the fraction of
    poses inside the interval of a single error; ``unknown`` counts poses without a covariance.
    """
    if estimate.covariances is None:
        return None
    errors = np.array([pose_error(t, e) for t, e in zip(reference.matrices, estimate.matrices, strict=True)])
    scale = np.sqrt(np.maximum(np.diagonal(estimate.covariances, axis1=1, axis2=2), 0.0))
    has_covariance = np.asarray(np.all(np.isfinite(scale) & (scale > 0.0), axis=1))
    if not has_covariance.any():
        return {"count": 0, "unknown": len(has_covariance)}
    # Errors are divided by their standard deviations: metres and radians together are badly conditioned.
    units = scale[has_covariance]
    C = estimate.covariances[has_covariance] / (units[:, :, None] * units[:, None, :])
    x = errors[has_covariance] / units
    nees = np.einsum("ni,ni->n", x, np.linalg.solve(C + 1e-12 * np.eye(6), x[..., None])[..., 0])
    n = len(nees)
    low, high = nees_band(1)
    return {
        "count": n,
        "unknown": int((~has_covariance).sum()),
        "expected": 6.0,
        "mean": float(nees.mean()),
        "median": float(np.median(nees)),
        "band_95": list(nees_band(n)),
        "inside_95": float(np.mean((nees >= low) & (nees <= high))),
        "mean_sigma_m": float(units[:, :3].mean()),
        "mean_sigma_deg": float(np.degrees(units[:, 3:]).mean()),
    }
