# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Diagram of both trajectories from above and the error along the path, as one SVG."""

from __future__ import annotations

import numpy as np

from cdff_dev.compare.diagrams import plan_and_errors
from cdff_dev.compare.trajectory.compare import Comparison


def draw(comparison: Comparison) -> str:
    """Return an SVG: the two widest axes of the reference on the left, position errors on the right."""
    first, second = sorted(np.argsort(np.ptp(comparison.reference.positions_m, axis=0))[-2:])
    tracks = {"reference": comparison.reference, "estimate": comparison.estimate}
    plan = {name: track.positions_m[:, [first, second]] for name, track in tracks.items()}
    errors = np.column_stack([comparison.reference.distances_m, comparison.position_errors_m])
    return plan_and_errors(plan, ("xyz"[first], "xyz"[second]), {"estimate": errors})
