# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Steps common to all registrations: downsampling, normals, initial gate, pose update, convergence."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import KdTree, nearest
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_3d.interface import Inputs

MIN_PAIRS = 20
#: Number of iterations after which the pairs may repeat.
_LONGEST_CYCLE = 4
#: Ratio of successive steps above which convergence is slow, and largest factor on a step.
_SLOW, _LONGEST_STEP = 0.25, 6.0
#: Initial gate in median pair distances at the guess; most correct pairs are nearer.
INITIAL_GATE_MEDIANS = 3.0


class RegistrationConfig(DfnConfig):
    """Parameters of all registrations."""

    max_distance_m: float | None = Field(
        None, gt=0, description="Largest distance of a pair (final gate); absent: from other parameters"
    )
    thin_to: int | None = Field(
        25_000,
        ge=100,
        description="Number of points to which clouds without normals are downsampled; null: all",
    )
    tolerance_m: float | None = Field(
        None,
        gt=0,
        description=(
            "Step below which the iteration has converged, translation plus rotation times the radius of the "
            "cloud; absent: a fraction of the point spacing"
        ),
    )


def prepare_clouds(
    inputs: Inputs, cfg: RegistrationConfig, min_source: int = 0, min_target: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return source, target and guess; raises InputError if one is malformed or has too few points.

    Without given normals both clouds are downsampled to even density: otherwise the dense rings around the
    two sensors match each other at the identity.
    """
    source = checked_points(inputs.source, "source", max(MIN_PAIRS, min_source))
    target = checked_points(inputs.target, "target", max(MIN_PAIRS, min_target))
    T_guess = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
    if inputs.target_normals is None and cfg.thin_to is not None:
        voxel_m = max(voxel_for(source, cfg.thin_to), voxel_for(target, cfg.thin_to))
        if voxel_m > 0.0:
            source, target = voxel_means(source, voxel_m), voxel_means(target, voxel_m)
    return source, target, T_guess


def tree_normals(tree: KdTree, neighbours: int, given: FloatArray | None) -> FloatArray:
    """Return unit normals (n, 3) in the order of the tree: given, or of planes through neighbours."""
    if given is None:
        return np.ascontiguousarray(plane_fits(tree, neighbours)[0][tree.order])
    return np.ascontiguousarray(given[tree.order], np.float64)


def initial_gate_m(tree: KdTree, moved: FloatArray, radii: float) -> float:
    """Return the larger of a multiple of the median pair distance at the guess and ``radii`` radii of the
    target.
    """
    distance_m, _ = nearest(tree, moved)
    offset = tree.points - np.median(tree.points, axis=0)
    radius_m = float(np.sqrt(np.mean(np.einsum("ij,ij->i", offset, offset))))
    return max(INITIAL_GATE_MEDIANS * float(np.median(distance_m)), radii * radius_m)


def apply_step(
    T: FloatArray, H: FloatArray, g: FloatArray, centre: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Return the transform after one Gauss-Newton step, and the step (6,): translation, and rotation about
    the centre times the radius, metres.
    """
    x = newton_step(H, g)
    return moved_by(T, x, centre, radius), x


def newton_step(H: FloatArray, g: FloatArray) -> FloatArray:
    """Return the Gauss-Newton step (6,); damping avoids singular equations along unconstrained directions."""
    return -np.linalg.solve(H + 1e-6 * max(np.trace(H), 1e-12) * np.eye(6), g)


def moved_by(T: FloatArray, step: FloatArray, centre: FloatArray, radius: float) -> FloatArray:
    """Return the transform after a step (6,): translation, and rotation about the centre times the radius."""
    R = se3.exp_so3(step[3:] / radius)
    T = se3.transform(R, step[:3] + centre - R @ centre) @ T
    T[:3, :3] = se3.normalise_rotation(T[:3, :3])
    return T


def step_length(steps: list[FloatArray], was_extended: bool) -> float:
    """Return the factor on the last step that replaces further steps in its direction.

    Where surfaces slide along each other, steps form a geometric sequence whose sum is ``1 / (1 - ratio)``
    times the first step (Aitken's extrapolation; Besl and McKay 1992, doi:10.1109/34.121791, extrapolate
    ICP). After an extended step (``was_extended``) the ratio is unknown and the factor is 1.
    """
    if was_extended or len(steps) < 2:
        return 1.0
    ratio = float(steps[-1] @ steps[-2]) / max(float(steps[-2] @ steps[-2]), 1e-300)
    return min(1.0 / (1.0 - ratio), _LONGEST_STEP) if _SLOW <= ratio < 1.0 else 1.0


def has_converged(steps: list[FloatArray], tolerance_m: float) -> bool:
    """Return whether the last step, or the sum of the last few (pairs that repeat in a cycle), is below the
    tolerance.
    """
    for count in range(1, min(_LONGEST_CYCLE, len(steps)) + 1):
        total = np.sum(steps[-count:], axis=0)
        if np.linalg.norm(total[:3]) + np.linalg.norm(total[3:]) < tolerance_m:
            return True
    return False


def too_few_pairs_error(pairs: int, points: int, gate_m: float) -> DegenerateGeometryError:
    """Return the error for too few pairs of the source's points."""
    return DegenerateGeometryError(
        f"{pairs} of {points} points have a neighbour within {gate_m:.3g} m, expected at least {MIN_PAIRS}; "
        "give a better guess",
        ["no_overlap"],
    )
