# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane ICP with a robust kernel and an annealed gate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

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
from cdff_core.dfns.registration_3d._surface import estimated_normals, evened, spacing_m

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]

_LEAST_PAIRS = 20
_GATE_PER_SCALE = 6.0
_LONGEST_CYCLE = 4


class PointToPlaneIcpConfig(DfnConfig):
    """Gates in metres, or in units of what the clouds themselves are like."""

    max_distance_m: float | None = Field(None, gt=0.0, description="Last gate of pairs, metres; absent: gate_spacings")
    first_distance_m: float | None = Field(None, gt=0.0, description="First gate, metres; absent: from the clouds")
    gate_spacings: float = Field(2.5, ge=1.0, le=50.0, description="Last gate in median point spacings of the target")
    first_radii: float = Field(0.2, ge=0.0, le=2.0, description="First gate in root mean square radii of the target")
    first_medians: float = Field(3.0, ge=1.0, le=20.0, description="First gate in median distances at the guess")
    annealing: float = Field(0.8, gt=0.1, lt=1.0, description="Factor on the gate per iteration")
    tukey: float = Field(3.0, ge=1.0, le=10.0, description="Tukey's constant in robust standard deviations")
    kernel_gates: float = Field(0.2, ge=0.0, le=1.0, description="Least width of the kernel, in gates")
    thin_to: int | None = Field(25_000, ge=100, description="Points left of bigger clouds given without normals")
    max_iterations: int = Field(60, ge=1, le=1000, description="Iterations at most")
    tolerance_m: float | None = Field(None, gt=0.0, description="Step that has converged, metres; absent: spacing/1000")
    neighbours: int = Field(12, ge=4, le=200, description="Neighbourhood for normals where none are given")


class PointToPlaneIcp(Registration3DInterface):
    """Alternate nearest neighbours and one Gauss-Newton step on the distances to the target's planes.

    Notes
    -----
    Chen and Medioni (1992), doi:10.1016/0262-8856(92)90066-C. Residuals are weighted by Tukey's biweight of a scale
    that is the median absolute deviation of each iteration; the gate on pair distances shrinks geometrically from what
    covers the guess to a few point spacings. Babin et al. (2019), arXiv:1810.01474, compare the kernels.
    """

    Config: ClassVar[type[DfnConfig]] = PointToPlaneIcpConfig

    def setup(self) -> None:
        """Compile the kernel, so that the first call costs what the others do."""
        from cdff_core.dfns.registration_3d._kernels import normal_equations

        self._normal_equations = normal_equations
        normal_equations(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), np.zeros(1))

    def process(self, inputs: Registration3DInputs) -> Registration3DOutputs:
        """Return T_target_source; raises InputError, or DegenerateGeometryError when too few pairs are left."""
        from scipy.spatial import cKDTree

        cfg: Any = self.config
        source = checked_points(inputs.source, "source", _LEAST_PAIRS)
        target = checked_points(inputs.target, "target", max(_LEAST_PAIRS, cfg.neighbours))
        if inputs.target_normals is None:
            # Rings around the sensor meet themselves at the identity: uneven clouds are thinned first.
            source, target = evened(source, target, cfg.thin_to)
        tree = cKDTree(target)
        normals = estimated_normals(target, tree, cfg.neighbours, inputs.target_normals)
        T = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
        spaced_m = spacing_m(tree)
        last_gate_m = cfg.max_distance_m or cfg.gate_spacings * spaced_m
        tolerance_m = cfg.tolerance_m or 1e-3 * spaced_m
        gate_m = self._first_gate_m(tree, se3.transform_points(T, source), last_gate_m)
        converged = False
        steps: list[FloatArray] = []
        while len(steps) < cfg.max_iterations:
            T, scale_m, step = self._step(T, source, tree, target, normals, gate_m)
            steps.append(step)
            at_last_gate = gate_m <= last_gate_m or gate_m <= _GATE_PER_SCALE * scale_m
            converged = at_last_gate and _is_at_rest(steps, tolerance_m)
            if converged:
                break
            gate_m = max(last_gate_m, _GATE_PER_SCALE * scale_m, cfg.annealing * gate_m)
        return Registration3DOutputs(
            transform=T,
            residual_scale_m=np.array(scale_m),
            iterations=np.array(len(steps)),
            converged=np.array(converged),
        )

    def _first_gate_m(self, tree: cKDTree, moved: FloatArray, last_gate_m: float) -> float:
        cfg: Any = self.config
        if cfg.first_distance_m is not None:
            return max(cfg.first_distance_m, last_gate_m)
        distance_m, _ = tree.query(moved)
        offset = tree.data - np.median(tree.data, axis=0)
        radius_m = float(np.sqrt(np.mean(np.sum(offset**2, axis=1))))
        return max(last_gate_m, cfg.first_medians * float(np.median(distance_m)), cfg.first_radii * radius_m)

    def _step(
        self, T: FloatArray, source: FloatArray, tree: cKDTree, target: FloatArray, normals: FloatArray, gate_m: float
    ) -> tuple[FloatArray, float, FloatArray]:
        """One Gauss-Newton step: the new transform, the residual scale, and shift and turn times radius, metres."""
        moved = se3.transform_points(T, source)
        distance_m, match = tree.query(moved, distance_upper_bound=gate_m)
        paired = np.isfinite(distance_m)
        if np.count_nonzero(paired) < _LEAST_PAIRS:
            raise DegenerateGeometryError(
                f"{np.count_nonzero(paired)} of {len(source)} points have a neighbour within {gate_m:.3g} m, expected "
                f"at least {_LEAST_PAIRS}; give a better guess",
                ["no_overlap"],
            )
        p, n = moved[paired], normals[match[paired]]
        residual_m = np.einsum("ij,ij->i", p - target[match[paired]], n)
        scale_m = max(1.4826 * float(np.median(np.abs(residual_m))), 1e-9)
        # A wide gate keeps the kernel wide: rings on the ground that meet themselves would else outvote all structure.
        u = residual_m / max(self.config.tukey * scale_m, self.config.kernel_gates * gate_m)
        weight = np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)
        centre = p.mean(axis=0)
        offset = p - centre
        radius_m = max(float(np.sqrt(np.mean(np.sum(offset**2, axis=1)))), 1e-9)
        H, g = self._normal_equations(offset / radius_m, n, residual_m, weight)
        # Rotations are in units of the radius; the damping keeps free directions at rest instead of singular.
        x = -np.linalg.solve(H + 1e-6 * max(np.trace(H), 1e-12) * np.eye(6), g)
        to_centre = se3.transform(np.eye(3), -centre)
        update = se3.transform(se3.normalise_rotation(se3.exp_so3(x[3:] / radius_m)), x[:3] + centre) @ to_centre
        T = update @ T
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])
        return T, scale_m, x


def _is_at_rest(steps: list[FloatArray], tolerance_m: float) -> bool:
    """Whether the last step, or the sum of the last few (a cycle of pairs), moved points too little to matter."""
    for count in range(1, min(_LONGEST_CYCLE, len(steps)) + 1):
        moved = np.sum(steps[-count:], axis=0)
        if np.linalg.norm(moved[:3]) + np.linalg.norm(moved[3:]) < tolerance_m:
            return True
    return False
