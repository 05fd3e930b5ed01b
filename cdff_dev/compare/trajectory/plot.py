# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Diagram of two trajectories, seen from above, and of the error along the path."""

from __future__ import annotations

import numpy as np

from cdff_dev.compare.diagrams import plan_and_errors
from cdff_dev.compare.trajectory.compare import Comparison


def draw(comparison: Comparison) -> str:
    """Return an SVG: on the left both paths in the two axes of largest extent, on the right the errors."""
    x_axis, y_axis = sorted(np.argsort(np.ptp(comparison.reference.positions_m, axis=0))[-2:])
    tracks = {"reference": comparison.reference, "estimate": comparison.estimate}
    plan = {name: track.positions_m[:, [x_axis, y_axis]] for name, track in tracks.items()}
    errors = np.column_stack([comparison.reference.distances_m, comparison.position_errors_m])
    return plan_and_errors(plan, ("xyz"[x_axis], "xyz"[y_axis]), {"estimate": errors})
