# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration to the target's normal distributions."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, spacing
from cdff_common.geometry.robust import median_sigma
from cdff_core.dfns.registration_3d import _kernels, _steps, _surface
from cdff_core.dfns.registration_3d._cells import fit_cells
from cdff_core.dfns.registration_3d.interface import Inputs, Interface, Outputs

#: Default edge of the finest cells in point spacings of the target.
_CELL_SPACINGS = 3.0
#: Minimum number of points of a cell, and minimum ratio of its variances to the largest (Magnusson 2009,
#: section 6.1).
_MIN_POINTS, _MIN_VARIANCE_RATIO = 5, 1e-3
#: Final gate in edges of the cells, and factor on the gate per iteration.
_GATE_CELLS, _ANNEALING = 1.2, 0.7


class NdtConfig(_surface.RegistrationConfig):
    """Parameters of Ndt."""

    cell_m: float | None = Field(
        None, gt=0, description="Edge of the finest cells; absent: three point spacings of the target"
    )
    cells: tuple[Annotated[float, Field(ge=1.0, le=100.0)], ...] = Field(
        (3.0, 1.0),
        min_length=1,
        max_length=8,
        description="Edges of the cells from coarse to fine, in edges of the finest",
    )
    width: float = Field(1.4, gt=0.1, le=100, description="Width of the kernel in Mahalanobis distances")
    max_iterations: int = Field(40, ge=1, le=1000, description="Maximum number of iterations per cell size")


class Ndt(Interface[NdtConfig]):
    """Minimise the Mahalanobis distances of the source's points from the nearest cells of the target.

    Notes
    -----
    Biber and Strasser (2003), doi:10.1109/IROS.2003.1249285; Magnusson (2009), The three-dimensional
    normal-distributions transform. The score ``exp(-d^2 / (2 width^2))`` acts as a robust kernel; its Hessian
    is approximated by the positive semi-definite one of Gauss-Newton. Cells along a single lidar ring are
    excluded: they would constrain the source across the ring, where nothing was measured. Given normals are
    not used.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
        corners = np.stack([x.ravel(), y.ravel(), 0.1 * (x * y).ravel()], axis=1)
        self.process(Inputs(source=corners, target=corners + 0.01))

    def process(self, inputs: Inputs) -> Outputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs remain."""
        cfg = self.config
        source, target, T = _surface.prepare_clouds(inputs, cfg)
        cell_m = cfg.cell_m or _CELL_SPACINGS * spacing(kd_tree(target))
        iterations = 0
        for edges in cfg.cells:
            T, scale_m, steps, converged = self._register_at_cell_size(
                T, source, target, edges * cell_m, is_coarsest=edges == cfg.cells[0]
            )
            iterations += steps
        return Outputs(
            transform=T,
            residual_scale_m=scale_m,
            iterations=iterations,
            converged=converged,
        )

    def _register_at_cell_size(
        self,
        T_target_source: FloatArray,
        source: FloatArray,
        target: FloatArray,
        cell_m: float,
        *,
        is_coarsest: bool,
    ) -> tuple[FloatArray, float, int, bool]:
        """Return transform, residual scale, iterations and convergence for cells of one size."""
        cfg = self.config
        cells = fit_cells(target, cell_m, _MIN_POINTS, _MIN_VARIANCE_RATIO)
        if cells is None:
            raise DegenerateGeometryError(
                f"no cell of {cell_m:.3g} m holds {_MIN_POINTS} points of a surface: the "
                "target is too sparse",
                ["too_sparse"],
            )
        final_gate_m = _GATE_CELLS * cell_m
        tolerance_m = cfg.tolerance_m or cell_m / 2500.0
        gate_m = final_gate_m
        if is_coarsest:
            moved_points = se3.transform_points(T_target_source, source)
            gate_m = max(gate_m, _surface.initial_gate_m(cells.tree, moved_points, 0.0))
        gate_m = min(gate_m, cfg.max_distance_m or gate_m)
        pairs = _kernels.no_pairs(len(source))
        steps = np.empty((cfg.max_iterations, 6))
        converged, iterations = False, 0
        while iterations < cfg.max_iterations and not converged:
            count = _kernels.pair(cells.tree, source, T_target_source, gate_m, pairs)
            if count < _surface.MIN_PAIRS:
                raise _surface.too_few_pairs_error(count, len(source), gate_m)
            centre, radius_m = _kernels.centre_and_radius(pairs.row, pairs.moved)
            H, g = _kernels.distribution_equations(
                cells.tree.points, cells.information, pairs.row, pairs.moved, centre, radius_m, cfg.width
            )
            steps[iterations] = _steps.newton_step(H, g)
            T_target_source = _steps.moved_by(T_target_source, steps[iterations], centre, radius_m)
            iterations += 1
            converged = gate_m <= final_gate_m and _steps.has_converged(steps[:iterations], tolerance_m)
            gate_m = max(final_gate_m, _ANNEALING * gate_m)
        distances_m = _kernels.plane_distances(cells.tree.points, cells.normals, pairs.row, pairs.moved)
        T_target_source[:3, :3] = se3.normalise_rotation(T_target_source[:3, :3])
        return T_target_source, max(median_sigma(distances_m), 1e-9), iterations, converged
