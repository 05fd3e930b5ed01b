# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figure of two trajectories, seen along the axis of smallest extent, and of the errors by axis."""

from __future__ import annotations

from typing import Any

from cdff_common.plots import new_figure
from cdff_common.plots.drawing import draw_path, widest_plane
from cdff_dev.compare.trajectory.compare import Comparison

#: Names of the alignments of the estimate, in words.
ALIGNMENTS = {
    "se3": "aligned by rotation and translation",
    "yaw": "aligned by heading and translation",
    "sim3": "aligned by rotation, translation and scale",
    "origin": "first poses coincide",
    "none": "not aligned",
}


def draw(comparison: Comparison) -> Any:
    """Return a ``matplotlib.figure.Figure``: both paths, and the position errors by axis with their norm."""
    reference, estimate = comparison.reference, comparison.estimate
    alignment = comparison.results["alignment"]
    title = ALIGNMENTS[alignment["mode"]]
    title += f" ({alignment['scale']:.4f})" if alignment["mode"] == "sim3" else ""
    figure = new_figure(10.4, 4.4)
    figure.suptitle(f"estimate {title}; {len(estimate)} poses compared", fontsize=10)
    paths, errors = figure.subplots(1, 2)
    plane = widest_plane(reference.positions_m)
    draw_path(paths, reference.positions_m, plane, "gray", "reference")
    draw_path(paths, estimate.positions_m, plane, "C3", "estimate")
    paths.legend(fontsize=8)
    differences_m = estimate.positions_m - reference.positions_m
    for axis, name in enumerate("xyz"):
        errors.plot(reference.distances_m, differences_m[:, axis], lw=1.0, label=name)
    errors.plot(reference.distances_m, comparison.position_errors_m, color="black", lw=1.3, label="distance")
    errors.set(xlabel="path length, m", ylabel="position error, m")
    errors.grid(alpha=0.3)
    errors.legend(fontsize=8)
    return figure
