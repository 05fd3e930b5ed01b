# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Steps common to all registrations: downsampling, normals, initial gate."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry.kdtree import KdTree, nearest
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_3d.interface import Inputs

#: Least number of pairs for a transform and its covariance.
MIN_PAIRS = 20
#: Initial gate in median pair distances at the guess; most correct pairs are nearer.
INITIAL_GATE_MEDIANS = 3.0
#: Least number of points from which the median pair distance at the guess is computed.
_GATE_SAMPLE = 2000


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


def tree_normals(tree: KdTree, neighbours: int, normals_of_input: FloatArray | None) -> FloatArray:
    """Return unit normals (n, 3) in the order of the tree: given, or of planes through neighbours."""
    if normals_of_input is None:
        return np.ascontiguousarray(plane_fits(tree, neighbours)[0][tree.order])
    return np.ascontiguousarray(normals_of_input[tree.order], np.float64)


def initial_gate_m(tree: KdTree, moved: FloatArray, radii: float) -> float:
    """Return the larger of a multiple of the median pair distance at the guess and ``radii`` radii of the
    target.
    """
    distance_m, _ = nearest(tree, moved[:: max(1, len(moved) // _GATE_SAMPLE)])
    offset = tree.points - np.median(tree.points, axis=0)
    radius_m = float(np.sqrt(np.mean(np.einsum("ij,ij->i", offset, offset))))
    return max(INITIAL_GATE_MEDIANS * float(np.median(distance_m)), radii * radius_m)


def too_few_pairs_error(pairs: int, points: int, gate_m: float) -> DegenerateGeometryError:
    """Return the error for too few pairs of the source's points."""
    return DegenerateGeometryError(
        f"{pairs} of {points} points have a neighbour within {gate_m:.3g} m, expected at least {MIN_PAIRS}; "
        "give a better guess",
        ["no_overlap"],
    )
