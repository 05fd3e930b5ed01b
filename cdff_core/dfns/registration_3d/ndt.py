# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration to the target's normal distributions."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_3d._interface import (
    Registration3DInputs,
    Registration3DInterface,
    Registration3DOutputs,
)

FloatArray = NDArray[np.float64]


class NdtConfig(DfnConfig):
    """Cells in metres, or in units of what the target is like."""

    cell_m: float | None = Field(None, gt=0.0, description="Edge of the last cells, metres; absent: cell_spacings")
    cell_spacings: float = Field(3.0, ge=1.0, le=100.0, description="Edge of the last cells in spacings of the target")
    cells: tuple[Annotated[float, Field(ge=1.0, le=100.0)], ...] = Field(
        (3.0, 1.0), min_length=1, max_length=8, description="Edges of the cells, coarse to fine, in those of the last"
    )
    least_points: int = Field(5, ge=4, le=1000, description="Fewest points of a cell")
    flattest: float = Field(1e-3, gt=0.0, le=1.0, description="Least variance of a cell, in its largest")
    width: float = Field(1.4, gt=0.1, le=100.0, description="Width of the kernel, in Mahalanobis distances")
    max_distance_m: float | None = Field(None, gt=0.0, description="Greatest gate of pairs, metres; absent: any")
    gate_cells: float = Field(1.2, ge=0.5, le=10.0, description="Last gate of pairs, in edges of the cells")
    first_medians: float = Field(3.0, ge=1.0, le=20.0, description="First gate in median distances at the guess")
    annealing: float = Field(0.7, gt=0.1, lt=1.0, description="Factor on the gate per iteration")
    thin_to: int | None = Field(25_000, ge=100, description="Points left of bigger clouds given without normals")
    max_iterations: int = Field(40, ge=1, le=1000, description="Iterations at most, for each size of cells")
    tolerance_m: float | None = Field(None, gt=0.0, description="Step that has converged, metres; absent: cell/2500")


class Ndt(Registration3DInterface):
    """Gauss-Newton on the Mahalanobis distances of the source's points to the nearest cells of the target.

    Notes
    -----
    Biber and Strasser (2003), doi:10.1109/IROS.2003.1249285; Magnusson (2009), The three-dimensional
    normal-distributions transform. The score ``exp(-d^2 / 2 width^2)`` is its own robust kernel; its Hessian is taken
    as Gauss and Newton do, positive semidefinite. Cells along a single ring of a lidar are left out: they would hold
    the source fast across the ring, where nothing was measured. Normals given are not needed and not used.
    """

    Config: ClassVar[type[DfnConfig]] = NdtConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
        corners = np.stack([x.ravel(), y.ravel(), 0.1 * (x * y).ravel()], axis=1)
        self.process(Registration3DInputs(corners, corners + 0.01))

    def process(self, inputs: Registration3DInputs) -> Registration3DOutputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs are left."""
        from cdff_common.geometry.kdtree import kd_tree, spacing
        from cdff_core.dfns.registration_3d import _surface as s

        cfg: Any = self.config
        source = checked_points(inputs.source, "source", s.LEAST_PAIRS)
        target = checked_points(inputs.target, "target", s.LEAST_PAIRS)
        if inputs.target_normals is None:
            source, target = s.evened(source, target, cfg.thin_to)
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        cell_m = cfg.cell_m or cfg.cell_spacings * spacing(kd_tree(target))
        iterations = 0
        for edges in cfg.cells:
            T, scale_m, count, converged = self._at(T, source, target, edges * cell_m, edges == cfg.cells[0])
            iterations += count
        return Registration3DOutputs(
            transform=T,
            residual_scale_m=np.array(scale_m),
            iterations=np.array(iterations),
            converged=np.array(converged),
        )

    def _at(
        self, T: FloatArray, source: FloatArray, target: FloatArray, cell_m: float, first: bool
    ) -> tuple[FloatArray, float, int, bool]:
        """Transform, residual scale, iterations and whether it converged, with cells of one size."""
        from cdff_core.dfns.registration_3d import _kernels as k
        from cdff_core.dfns.registration_3d import _surface as s
        from cdff_core.dfns.registration_3d._cells import cells_of

        cfg: Any = self.config
        cells = cells_of(target, cell_m, cfg.least_points, cfg.flattest)
        if cells is None:
            raise DegenerateGeometryError(
                f"no cell of {cell_m:.3g} m holds {cfg.least_points} points of a surface: the target is too sparse",
                ["too_sparse"],
            )
        last_gate_m = cfg.gate_cells * cell_m
        tolerance_m = cfg.tolerance_m or cell_m / 2500.0
        gate_m = last_gate_m
        if first:
            gate_m = max(gate_m, s.first_gate_m(cells.tree, se3.transform_points(T, source), cfg.first_medians, 0.0))
        gate_m = min(gate_m, cfg.max_distance_m or gate_m)
        row, moved = np.full(len(source), -1), np.empty_like(source)
        converged, steps = False, []
        while len(steps) < cfg.max_iterations and not converged:
            count = k.pair(cells.tree, source, T, gate_m, row, moved)
            if count < s.LEAST_PAIRS:
                raise s.too_few(count, len(source), gate_m)
            centre, radius_m = k.middle(row, moved)
            H, g = k.distribution_equations(
                cells.tree.points, cells.information, row, moved, centre, radius_m, cfg.width
            )
            T, step = s.stepped(T, H, g, centre, radius_m)
            steps.append(step)
            converged = gate_m <= last_gate_m and s.is_at_rest(steps, tolerance_m)
            gate_m = max(last_gate_m, cfg.annealing * gate_m)
        distances_m = k.plane_distances(cells.tree.points, cells.normals, row, moved)
        return T, max(1.4826 * float(np.median(np.abs(distances_m))), 1e-9), len(steps), converged
