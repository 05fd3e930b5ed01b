# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane ICP with a robust kernel and an annealed gate."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_core.dfns.registration_3d import _surface
from cdff_core.dfns.registration_3d._kernels import KERNELS
from cdff_core.dfns.registration_3d._plane_iterations import Limits, iterate
from cdff_core.dfns.registration_3d.interface import Inputs, Interface, Outputs

#: Least number of points from which the median spacing is computed.
_SPACING_SAMPLE = 2000


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
        spacing_m = spacing(tree, _SPACING_SAMPLE)
        final_gate_m = cfg.max_distance_m or cfg.gate_spacings * spacing_m
        gate_m = max(final_gate_m, cfg.first_distance_m or 0.0)
        if cfg.first_distance_m is None:
            moved_points = se3.transform_points(T, source)
            gate_m = max(gate_m, _surface.initial_gate_m(tree, moved_points, cfg.first_radii))
        limits = Limits(
            first_gate_m=gate_m,
            final_gate_m=final_gate_m,
            tolerance_m=cfg.tolerance_m or 3e-3 * spacing_m,
            kernel=KERNELS[cfg.kernel],
            kernel_scales=cfg.kernel_scales,
            kernel_gates=cfg.kernel_gates,
            max_iterations=cfg.max_iterations,
            min_pairs=_surface.MIN_PAIRS,
        )
        result = iterate(tree, normals, source, T, limits)
        if result.pairs < limits.min_pairs:
            raise _surface.too_few_pairs_error(result.pairs, len(source), result.gate_m)
        refined = result.T_target_source
        T[:3, :3], T[:3, 3] = se3.normalise_rotation(refined[:3, :3]), refined[:3, 3]
        return Outputs(
            transform=T,
            residual_scale_m=result.scale_m,
            iterations=result.iterations,
            converged=result.converged,
        )
