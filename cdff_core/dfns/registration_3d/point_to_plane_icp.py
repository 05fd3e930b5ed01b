# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane ICP with a robust kernel and an annealed gate."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_common.geometry.robust import median_sigma
from cdff_core.dfns.registration_3d import _kernels, _surface
from cdff_core.dfns.registration_3d.interface import Inputs, Interface, Outputs

#: Minimum gate in robust standard deviations of the residuals.
_GATE_PER_SCALE = 6.0
#: Factor on the gate per iteration.
_ANNEALING = 0.8


class PointToPlaneIcpConfig(_surface.RegistrationConfig):
    """Parameters of PointToPlaneIcp."""

    first_distance_m: float | None = Field(
        None,
        gt=0,
        description="Initial gate on the distance of a pair; absent: from the clouds and the guess",
    )
    gate_spacings: float = Field(2.5, ge=1, le=50, description="Final gate in the target's point spacings")
    first_radii: float = Field(
        0.2, ge=0, le=2, description="Minimum initial gate in radii of the target (RMS)"
    )
    kernel: Literal["tukey", "huber", "cauchy", "geman_mcclure", "none"] = Field(
        "tukey", description="Robust kernel of the residuals"
    )
    kernel_scales: float = Field(
        3.0, ge=0.5, le=10, description="Width of the kernel in robust standard deviations"
    )
    kernel_gates: float = Field(
        0.2, ge=0, le=1, description="Minimum width of the kernel as a fraction of the gate"
    )
    max_iterations: int = Field(60, ge=1, le=1000, description="Maximum number of iterations")
    neighbours: int = Field(
        12,
        ge=4,
        le=200,
        description="Number of neighbours for the normal of a point if normals are not given",
    )


class PointToPlaneIcp(Interface[PointToPlaneIcpConfig]):
    """Alternate the search for nearest neighbours with one Gauss-Newton step on the distances to the target's
    planes.

    Notes
    -----
    Chen and Medioni (1992), doi:10.1016/0262-8856(92)90066-C. Residuals are weighted by a robust kernel whose
    width follows the median absolute deviation of each iteration; the gate on pair distances shrinks
    geometrically from one that covers the guess to a few point spacings. Babin et al. (2019),
    arXiv:1810.01474, compare the kernels.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        corners = np.array([[x, y, 0.1 * x * y] for x in range(6) for y in range(6)], dtype=np.float64)
        self.process(Inputs(source=corners, target=corners + 0.01))

    def process(self, inputs: Inputs) -> Outputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs remain."""
        cfg = self.config
        source, target, T = _surface.prepare_clouds(inputs, cfg, min_target=cfg.neighbours)
        tree = kd_tree(target)
        normals = _surface.tree_normals(tree, cfg.neighbours, inputs.target_normals)
        spacing_m = spacing(tree)
        final_gate_m = cfg.max_distance_m or cfg.gate_spacings * spacing_m
        tolerance_m = cfg.tolerance_m or 1e-3 * spacing_m
        gate_m = max(final_gate_m, cfg.first_distance_m or 0.0)
        if cfg.first_distance_m is None:
            moved = se3.transform_points(T, source)
            gate_m = max(gate_m, _surface.initial_gate_m(tree, moved, cfg.first_radii))
        row, moved = np.full(len(source), -1), np.empty_like(source)
        converged, length = False, 1.0
        steps: list[FloatArray] = []
        while len(steps) < cfg.max_iterations and not converged:
            count = _kernels.pair(tree, source, T, gate_m, row, moved)
            if count < _surface.MIN_PAIRS:
                raise _surface.too_few_pairs_error(count, len(source), gate_m)
            distances_m = _kernels.plane_distances(tree.points, normals, row, moved)
            scale_m = max(median_sigma(distances_m), 1e-9)
            # The kernel is wide while the gate is wide: otherwise rings on the ground that match each other
            # would outweigh the structures of the scene.
            width_m = max(cfg.kernel_scales * scale_m, cfg.kernel_gates * gate_m)
            centre, radius_m = _kernels.centre_and_radius(row, moved)
            kernel = _kernels.KERNELS[cfg.kernel]
            H, g = _kernels.plane_equations(
                tree.points, normals, row, moved, centre, radius_m, width_m, kernel
            )
            is_final_gate = gate_m <= final_gate_m or gate_m <= _GATE_PER_SCALE * scale_m
            steps.append(_surface.newton_step(H, g))
            length = _surface.step_length(steps, length != 1.0) if is_final_gate else 1.0
            T = _surface.moved_by(T, length * steps[-1], centre, radius_m)
            converged = is_final_gate and _surface.has_converged(steps, tolerance_m)
            gate_m = max(final_gate_m, _GATE_PER_SCALE * scale_m, _ANNEALING * gate_m)
        return Outputs(
            transform=T,
            residual_scale_m=scale_m,
            iterations=len(steps),
            converged=converged,
        )
