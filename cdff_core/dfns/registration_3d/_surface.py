# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the registrations: clouds of even density, normals, and the update of a pose."""

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

LEAST_PAIRS = 20
_LONGEST_CYCLE = 4
#: Initial gate in median distances at the guess: most correct pairs are nearer.
FIRST_MEDIANS = 3.0


class RegistrationConfig(DfnConfig):
    """Parameters of all registrations."""

    max_distance_m: float | None = Field(
        None, gt=0, description="Gate on the distance of a pair; absent: from other parameters"
    )
    thin_to: int | None = Field(
        25_000, ge=100, description="Number of points of clouds without normals; null: all"
    )
    tolerance_m: float | None = Field(
        None,
        gt=0,
        description=(
            "Step below which the iteration has converged, translation plus rotation times the cloud's "
            "radius; absent: a fraction of the point spacing"
        ),
    )


def prepared(
    inputs: Inputs, cfg: RegistrationConfig, least_source: int = 0, least_target: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return source, target and guess; raises InputError on malformed ones.

    Without given normals both clouds are downsampled to even density: rings around the sensor match
    themselves at the identity.
    """
    source = checked_points(inputs.source, "source", max(LEAST_PAIRS, least_source))
    target = checked_points(inputs.target, "target", max(LEAST_PAIRS, least_target))
    T_guess = checked_transform(np.eye(4) if inputs.guess is None else inputs.guess, "guess")
    if inputs.target_normals is None and cfg.thin_to is not None:
        voxel_m = max(voxel_for(source, cfg.thin_to), voxel_for(target, cfg.thin_to))
        if voxel_m > 0.0:
            source, target = voxel_means(source, voxel_m), voxel_means(target, voxel_m)
    return source, target, T_guess


def tree_normals(tree: KdTree, neighbours: int, given: FloatArray | None) -> FloatArray:
    """Return unit normals (n, 3) in the order of the tree, given or of planes through neighbours."""
    if given is None:
        return np.ascontiguousarray(plane_fits(tree, neighbours)[0][tree.order])
    return np.ascontiguousarray(given[tree.order], np.float64)


def first_gate_m(tree: KdTree, moved: FloatArray, radii: float) -> float:
    """Return the larger of the multiples of the median distance at the guess and of the target's radius."""
    distance_m, _ = nearest(tree, moved)
    offset = tree.points - np.median(tree.points, axis=0)
    radius_m = float(np.sqrt(np.mean(np.einsum("ij,ij->i", offset, offset))))
    return max(FIRST_MEDIANS * float(np.median(distance_m)), radii * radius_m)


def stepped(
    T: FloatArray, H: FloatArray, g: FloatArray, centre: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Return the transform after one Gauss-Newton step, and the translation and rotation times radius (6,),
    metres.

    The damping avoids singularity along unconstrained directions.
    """
    x = -np.linalg.solve(H + 1e-6 * max(np.trace(H), 1e-12) * np.eye(6), g)
    R = se3.exp_so3(x[3:] / radius)
    T = se3.transform(R, x[:3] + centre - R @ centre) @ T
    T[:3, :3] = se3.normalise_rotation(T[:3, :3])
    return T, x


def is_at_rest(steps: list[FloatArray], tolerance_m: float) -> bool:
    """Return whether the last step, or the sum of the last few (a cycle of pairs), is below the tolerance."""
    for count in range(1, min(_LONGEST_CYCLE, len(steps)) + 1):
        moved = np.sum(steps[-count:], axis=0)
        if np.linalg.norm(moved[:3]) + np.linalg.norm(moved[3:]) < tolerance_m:
            return True
    return False


def too_few(count: int, of: int, gate_m: float) -> DegenerateGeometryError:
    """Return the error for too few pairs."""
    return DegenerateGeometryError(
        f"{count} of {of} points have a neighbour within {gate_m:.3g} m, expected at least "
        f"{LEAST_PAIRS}; give a "
        "better guess",
        ["no_overlap"],
    )
