# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Results of a comparison of trajectories as text."""

from __future__ import annotations

from typing import Any

#: Difference of the alignments of positions and orientations that is stated, degrees.
_NOTED_DEG = 0.1
#: Angle from which the trajectories are probably those of different frames, such as a camera and the base.
_FRAMES_DEG = 20.0
_COLUMNS = ("rmse", "mean", "median", "std", "min", "max")


def table(results: dict[str, Any]) -> str:
    """Return the results as text for a terminal."""
    poses, rpe = results["poses"], results["rpe"]
    distance = f"{rpe['delta']:g} {rpe['unit']}" + (", all pairs" if rpe["all_pairs"] else "")
    lines = [
        f"{poses['compared']} poses compared ({poses['estimate']} estimated, {poses['reference']} of the "
        f"reference), {results['path_length_m']:.3f} m, {results['duration_s']:.3f} s, aligned: "
        f"{results['alignment']['mode']}",
        *(
            f"{count} poses of the {name} are dropped: their stamps are repeated or not in order"
            for name, count in results["dropped"].items()
            if count
        ),
        "",
        f"{'':24}" + "".join(f"{name:>12}" for name in _COLUMNS),
        _row("ATE m", results["ate"]["translation_m"]),
        _row("ATE deg", results["ate"]["rotation_deg"]),
        _row("ATE deg, own alignment", results["ate"]["rotation_aligned_deg"]),
        _row(f"RPE m ({distance})", rpe["translation_m"]),
        _row(f"RPE deg ({distance})", rpe["rotation_deg"]),
    ]
    if (turn := orientation_note(results)) is not None:
        lines.append(turn)
    axes = results["ate"]["rmse_by_axis_m"]
    lines.append(f"{'RMSE of x, y, z, m':24}" + "".join(f"{axes[axis]:12.6f}" for axis in "xyz"))
    if results["drift"]["segments"]:
        lines += ["", f"{'segment m':>12}{'count':>8}{'drift %':>12}{'deg/m':>12}"]
        lines += [
            f"{s['length_m']:12g}{s['count']:8d}"
            f"{s['translation_percent']:12.4f}{s['rotation_deg_per_m']:12.6f}"
            for s in results["drift"]["segments"]
        ]
        drift = results["drift"]
        lines.append(
            f"{'all':>12}{'':8}{drift['translation_percent']:12.4f}{drift['rotation_deg_per_m']:12.6f}"
        )
    nees = results["nees"]
    if nees and nees["count"]:
        low, high = nees["band_95"]
        of_start = " relative to the first one" if nees["alignment"] == "origin" else ""
        values = f"mean {nees['mean']:.3f}, median {nees['median']:.3f}"
        lines += [
            "",
            f"NEES of {nees['count']} poses{of_start}: {values} (expected: "
            f"6; 95 % interval of the mean for independent errors: {low:.3f} to {high:.3f}); "
            f"{100 * nees['inside_95']:.1f} % of the poses are inside the 95 % interval of a single pose",
        ]
    return "\n".join(lines)


def orientation_note(results: dict[str, Any]) -> str | None:
    """Return the angle between the alignments of positions and orientations; None if small or not aligned."""
    angle_deg = results["alignment"]["orientations_deg"]
    if results["alignment"]["mode"] not in ("se3", "sim3", "yaw") or angle_deg < _NOTED_DEG:
        return None
    return (
        f"the rotation that aligns the positions differs by {angle_deg:.2f} deg from that which aligns the "
        "orientations: ATE deg contains it, own alignment does not"
        + (
            "; if REF has the poses of another frame of the robot: --ref-frame"
            if angle_deg > _FRAMES_DEG
            else ""
        )
    )


def _row(name: str, statistics: dict[str, Any]) -> str:
    return f"{name:24}" + "".join(f"{statistics[column]:12.6f}" for column in _COLUMNS)
