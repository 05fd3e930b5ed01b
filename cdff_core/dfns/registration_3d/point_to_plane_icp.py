# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane ICP with a robust kernel and an annealed gate."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_3d._interface import (
    Registration3DInputs,
    Registration3DInterface,
    Registration3DOutputs,
)

FloatArray = NDArray[np.float64]

_GATE_PER_SCALE = 6.0


class PointToPlaneIcpConfig(DfnConfig):
    """Gates in metres, or in units of what the clouds themselves are like."""

    max_distance_m: float | None = Field(None, gt=0.0, description="Last gate of pairs, metres; absent: gate_spacings")
    first_distance_m: float | None = Field(None, gt=0.0, description="First gate, metres; absent: from the clouds")
    gate_spacings: float = Field(2.5, ge=1.0, le=50.0, description="Last gate in median point spacings of the target")
    first_radii: float = Field(0.2, ge=0.0, le=2.0, description="First gate in root mean square radii of the target")
    first_medians: float = Field(3.0, ge=1.0, le=20.0, description="First gate in median distances at the guess")
    annealing: float = Field(0.8, gt=0.1, lt=1.0, description="Factor on the gate per iteration")
    kernel: Literal["tukey", "huber", "cauchy", "geman_mcclure", "none"] = Field(
        "tukey", description="Robust kernel of the residuals"
    )
    kernel_scales: float = Field(3.0, ge=0.5, le=10.0, description="Width of the kernel in robust standard deviations")
    kernel_gates: float = Field(0.2, ge=0.0, le=1.0, description="Least width of the kernel, in gates")
    thin_to: int | None = Field(25_000, ge=100, description="Points left of bigger clouds given without normals")
    max_iterations: int = Field(60, ge=1, le=1000, description="Iterations at most")
    tolerance_m: float | None = Field(None, gt=0.0, description="Step that has converged, metres; absent: spacing/1000")
    neighbours: int = Field(12, ge=4, le=200, description="Neighbourhood for normals where none are given")


class PointToPlaneIcp(Registration3DInterface):
    """Alternate nearest neighbours and one Gauss-Newton step on the distances to the target's planes.

    Notes
    -----
    Chen and Medioni (1992), doi:10.1016/0262-8856(92)90066-C. Residuals are weighted by a robust kernel whose width
    follows the median absolute deviation of each iteration; the gate on pair distances shrinks geometrically from what
    covers the guess to a few point spacings. Babin et al. (2019), arXiv:1810.01474, compare the kernels.
    """

    Config: ClassVar[type[DfnConfig]] = PointToPlaneIcpConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        corners = np.array([[x, y, 0.1 * x * y] for x in range(6) for y in range(6)], dtype=np.float64)
        self.process(Registration3DInputs(corners, corners + 0.01))

    def process(self, inputs: Registration3DInputs) -> Registration3DOutputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs are left."""
        from cdff_common.geometry.kdtree import kd_tree, spacing
        from cdff_core.dfns.registration_3d import _kernels as k
        from cdff_core.dfns.registration_3d import _surface as s

        cfg: Any = self.config
        source = checked_points(inputs.source, "source", s.LEAST_PAIRS)
        target = checked_points(inputs.target, "target", max(s.LEAST_PAIRS, cfg.neighbours))
        if inputs.target_normals is None:
            # Rings around the sensor meet themselves at the identity: uneven clouds are thinned first.
            source, target = s.evened(source, target, cfg.thin_to)
        tree = kd_tree(target)
        normals = s.tree_normals(tree, cfg.neighbours, inputs.target_normals)
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        spaced_m = spacing(tree)
        last_gate_m = cfg.max_distance_m or cfg.gate_spacings * spaced_m
        tolerance_m = cfg.tolerance_m or 1e-3 * spaced_m
        gate_m = max(last_gate_m, cfg.first_distance_m or 0.0)
        if cfg.first_distance_m is None:
            moved = se3.transform_points(T, source)
            gate_m = max(gate_m, s.first_gate_m(tree, moved, cfg.first_medians, cfg.first_radii))
        row, moved = np.full(len(source), -1), np.empty_like(source)
        converged = False
        steps: list[FloatArray] = []
        while len(steps) < cfg.max_iterations:
            count = k.pair(tree, source, T, gate_m, row, moved)
            if count < s.LEAST_PAIRS:
                raise s.too_few(count, len(source), gate_m)
            distances_m = k.plane_distances(tree.points, normals, row, moved)
            scale_m = max(1.4826 * float(np.median(np.abs(distances_m))), 1e-9)
            # A wide gate keeps the kernel wide: rings on the ground that meet themselves would else outvote structure.
            width_m = max(cfg.kernel_scales * scale_m, cfg.kernel_gates * gate_m)
            centre, radius_m = k.middle(row, moved)
            kernel = k.KERNELS[cfg.kernel]
            H, g = k.plane_equations(tree.points, normals, row, moved, centre, radius_m, width_m, kernel)
            T, step = s.stepped(T, H, g, centre, radius_m)
            steps.append(step)
            at_last_gate = gate_m <= last_gate_m or gate_m <= _GATE_PER_SCALE * scale_m
            converged = at_last_gate and s.is_at_rest(steps, tolerance_m)
            if converged:
                break
            gate_m = max(last_gate_m, _GATE_PER_SCALE * scale_m, cfg.annealing * gate_m)
        return Registration3DOutputs(
            transform=T,
            residual_scale_m=np.array(scale_m),
            iterations=np.array(len(steps)),
            converged=np.array(converged),
        )
