# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Summary of an estimation in words."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def summary_text(summary: Mapping[str, Any], out: Path) -> str:
    """Return numbers of poses, path, errors and the names of the files."""
    statuses = ", ".join(f"{count} {status}" for status, count in sorted(summary["statuses"].items()))
    lines = [
        f"{summary['dfpc']}: {summary['poses']} poses ({statuses}), path {summary['path_length_m']:.2f} m in "
        f"{summary['duration_s']:.1f} s, {summary['cpu_s']:.1f} s CPU"
    ]
    if summary["reasons"]:
        named = sorted(summary["reasons"].items(), key=lambda item: (-item[1], item[0]))
        lines.append("reasons: " + ", ".join(f"{name} ({count})" for name, count in named[:5]))
    if summary["stamps_backwards"]:
        lines.append(
            f"the stamps go backwards {summary['stamps_backwards']} times: the samples are in the order of "
            "their stamps; cdff log info shows the jumps of the clock"
        )
    truth = summary["truth"]
    if isinstance(truth, Mapping):
        lines.append(_truth_line(truth))
        if (frames := truth["frames"])["truth"] != frames["estimate"]:
            lines.append(
                f"the true poses are of {frames['truth']}, the estimates of {frames['estimate']}; "
                "the log does not state the pose of one in the other, which is part of the errors; a profile "
                "does (--profile FILE)"
            )
    else:
        lines.append(f"no comparison: {truth}")
    if (dem := summary.get("dem")) is not None:
        lines.append(_elevation_line(dem))
    if (points := summary.get("map")) is not None:
        refused = f", {points['refused_pairs']} refused" if points["refused_pairs"] else ""
        lines.append(
            f"map: {points['points']} points in voxels of {points['voxel_m']:.2g} m, from "
            f"{points['pairs']} pairs{refused}"
        )
    lines.append(f"written to {out}: {', '.join(sorted(path.name for path in out.iterdir()))}")
    return "\n".join(lines)


def _truth_line(results: Mapping[str, Any]) -> str:
    """Return the line with the errors against the true poses."""
    ate_m = results["ate"]["translation_m"]["rmse"]
    share = 100.0 * ate_m / max(results["path_length_m"], 1e-9)
    rotation_deg = results["ate"]["rotation_aligned_deg"]["rmse"]
    return (
        f"against the true poses (positions and orientations aligned): RMSE {ate_m:.3f} m, {share:.2f} % of "
        f"{results['path_length_m']:.1f} m, and {rotation_deg:.2f}°, {results['poses']['compared']} poses "
        "compared"
    )


def _elevation_line(dem: Mapping[str, Any]) -> str:
    width_m, height_m = dem["size_m"]
    low_m, high_m = dem["height_range_m"] or (0.0, 0.0)
    return (
        f"elevation map: {width_m:.1f} x {height_m:.1f} m in cells of {dem['resolution_m']:g} m, "
        f"{dem['observed_cells']} observed, heights {low_m:.2f} to {high_m:.2f} m, {dem['patches']} patches"
    )
