# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the registrations share: clouds of even density, normals, and the update of a pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import KdTree, nearest
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.voxels import voxel_for, voxel_means

FloatArray = NDArray[np.float64]

LEAST_PAIRS = 20
_LONGEST_CYCLE = 4


def evened(source: FloatArray, target: FloatArray, wanted: int | None) -> tuple[FloatArray, FloatArray]:
    """Both clouds thinned with the voxels that leave about ``wanted`` points of the bigger one; None leaves them."""
    if wanted is None:
        return source, target
    voxel_m = max(voxel_for(source, wanted), voxel_for(target, wanted))
    if voxel_m == 0.0:
        return source, target
    return voxel_means(source, voxel_m), voxel_means(target, voxel_m)


def tree_normals(tree: KdTree, neighbours: int, given: FloatArray | None) -> FloatArray:
    """Unit normals (n, 3) in the order of the tree: those given once checked, else of planes through neighbours."""
    if given is None:
        return np.ascontiguousarray(plane_fits(tree, neighbours)[0][tree.order])
    normals = np.asarray(given, dtype=np.float64)
    if normals.shape != tree.points.shape or not np.all(np.isfinite(normals)):
        raise InputError(f"target_normals: shape {normals.shape}, expected finite values of shape {tree.points.shape}")
    return np.ascontiguousarray(normals[tree.order])


def first_gate_m(tree: KdTree, moved: FloatArray, medians: float, radii: float) -> float:
    """Gate that covers a guess: so many median distances at the guess, or so many radii of the target."""
    distance_m, _ = nearest(tree, moved)
    offset = tree.points - np.median(tree.points, axis=0)
    radius_m = float(np.sqrt(np.mean(np.einsum("ij,ij->i", offset, offset))))
    return max(medians * float(np.median(distance_m)), radii * radius_m)


def stepped(
    T: FloatArray, H: FloatArray, g: FloatArray, centre: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step: the new transform, and shift and turn times radius (6,), metres.

    The damping keeps free directions at rest instead of singular.
    """
    x = -np.linalg.solve(H + 1e-6 * max(np.trace(H), 1e-12) * np.eye(6), g)
    R = se3.exp_so3(x[3:] / radius)
    T = se3.transform(R, x[:3] + centre - R @ centre) @ T
    T[:3, :3] = se3.normalise_rotation(T[:3, :3])
    return T, x


def is_at_rest(steps: list[FloatArray], tolerance_m: float) -> bool:
    """Whether the last step, or the sum of the last few (a cycle of pairs), moved points too little to matter."""
    for count in range(1, min(_LONGEST_CYCLE, len(steps)) + 1):
        moved = np.sum(steps[-count:], axis=0)
        if np.linalg.norm(moved[:3]) + np.linalg.norm(moved[3:]) < tolerance_m:
            return True
    return False


def too_few(count: int, of: int, gate_m: float) -> DegenerateGeometryError:
    """What is raised where hardly a point has a partner."""
    return DegenerateGeometryError(
        f"{count} of {of} points have a neighbour within {gate_m:.3g} m, expected at least {LEAST_PAIRS}; give a "
        "better guess",
        ["no_overlap"],
    )
