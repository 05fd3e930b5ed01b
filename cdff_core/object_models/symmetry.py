# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotational symmetry of a body: transforms that map its visible surface onto itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, nearest, spacing
from cdff_core.object_models.nearest_grid import NearestGrid
from cdff_core.object_models.registration import register
from cdff_core.object_models.surface import VisibleSurface
from cdff_core.object_models.views import directions, view_rotation

#: Number of points of the search for symmetries and of their test.
_SEARCH_POINTS, _TEST_POINTS = 150, 2500
#: Number of directions and of rolls of the rotations that are tried.
_DIRECTIONS, _ROLLS = 120, 12
#: Fraction of the points that must lie on the surface after the rotation.
_FRACTION = 0.995
#: Largest distance to a point of a surface without holes, in distances between neighbouring points.
_SPACINGS = 2.5
#: Largest difference between the normals of a rotated point and of the surface, cosine.
_NORMAL = 0.5
#: Rotations closer than this are the same.
_SAME_RAD = math.radians(6.0)
#: Largest order of a discrete rotation about an axis; above it the symmetry is continuous.
_MAX_ORDER = 12
#: Largest number of transforms; the rotations of the icosahedron are 60.
_MAX_GROUP = 120
#: Samples of a continuous symmetry.
_CONTINUOUS_SAMPLES = 36


@dataclass(frozen=True, slots=True, eq=False)
class SymmetryGroup:
    """Rotational symmetry group of a body.

    Attributes
    ----------
    transforms : ndarray, shape (n, 4, 4)
        T_model_model that leave the surface as it is; the first is the identity. A continuous symmetry is
        sampled every 10 degrees, with the rotations that reverse its axis.
    axis : ndarray, shape (3,), or None
        Axis of a continuous symmetry.
    """

    transforms: FloatArray
    axis: FloatArray | None = None


def symmetry_group(surface: VisibleSurface, grid: NearestGrid, tolerance: float) -> SymmetryGroup:
    """Return the symmetry group of a surface.

    Rotations about the centroid are tried on a grid, registered, and tested with every point: the rotated
    surface must lie within ``tolerance`` times the diameter of the surface.

    Parameters
    ----------
    surface : VisibleSurface
    grid : NearestGrid
        Of its points.
    tolerance : float
        Relative to the diameter.
    """
    centre, diameter_m = surface.points_m.mean(axis=0), surface.diameter_m
    step = max(1, len(surface.points_m) // _SEARCH_POINTS)
    sample = surface.points_m[::step]
    starts = _rotations(centre)
    scales = np.geomspace(0.15, 2.0 * tolerance, 10) * diameter_m
    poses, costs = register(starts, sample, surface.points_m, surface.normals, grid, scales, one_sided=False)
    order = np.argsort(costs, kind="stable")
    candidates = [poses[i] for i in order[: max(60, len(order) // 3)] if costs[i] < 0.5]
    tester = _SurfaceTest(surface, tolerance * diameter_m)
    transforms = [np.eye(4)]
    for T in candidates:
        T_inverse = se3.inverse(T)
        if _is_new(T_inverse, transforms) and tester.holds(T_inverse):
            transforms.append(se3.normalise_transform(T_inverse))
    axis = _common_axis(transforms[1:])
    if axis is not None and len(transforms) > _MAX_ORDER:
        angles = 2.0 * math.pi * np.arange(_CONTINUOUS_SAMPLES) / _CONTINUOUS_SAMPLES
        R = se3.exp_so3(angles[:, None] * axis)
        rotations_about_axis = np.stack([se3.transform(r, centre - r @ centre) for r in R])
        if all(tester.holds(T) for T in rotations_about_axis[1:]):
            across = [T for T in transforms if T[:3, :3] @ axis @ axis < -0.99]
            flipped = [across[0] @ T for T in rotations_about_axis] if across else []
            return SymmetryGroup(np.stack([*rotations_about_axis, *flipped]), axis)
    return SymmetryGroup(np.stack(_close_under_products(transforms, tester)))


class _SurfaceTest:
    """Test whether a transform maps a surface onto itself."""

    def __init__(self, surface: VisibleSurface, tolerance_m: float) -> None:
        step = max(1, len(surface.points_m) // _TEST_POINTS)
        self._surface, self._tree = surface, kd_tree(surface.points_m)
        self._points, self._normals = surface.points_m[::step], surface.normals[::step]
        # A point lies between the points of the surface: their distance is added.
        self._limit_m = tolerance_m + _SPACINGS * spacing(self._tree)
        self._tolerance_m = tolerance_m

    def holds(self, T: FloatArray) -> bool:
        """Return whether a transform (4, 4) of the model in its own frame is a symmetry.

        Nearly all moved points must lie on the surface, across it within the tolerance.
        """
        moved_points = se3.transform_points(T, self._points)
        distance, rows = nearest(self._tree, moved_points)
        normals = self._surface.normals[rows]
        across = np.abs(np.einsum("ij,ij->i", normals, moved_points - self._surface.points_m[rows]))
        aligned = np.einsum("ij,ij->i", normals, self._normals @ T[:3, :3].T) > _NORMAL
        on_surface = (distance < self._limit_m) & ((across < self._tolerance_m) | ~aligned)
        return bool(np.mean(on_surface) >= _FRACTION)


def _close_under_products(transforms: list[FloatArray], tester: _SurfaceTest) -> list[FloatArray]:
    """Add to the transforms the products of two of them that are symmetries as well."""
    group = list(transforms)
    for first in range(_MAX_GROUP):
        if first >= len(group) or len(group) >= _MAX_GROUP:
            break
        for other in transforms:
            T = se3.normalise_transform(group[first] @ other)
            if len(group) < _MAX_GROUP and _is_new(T, group) and tester.holds(T):
                group.append(T)
    return group


def _rotations(centre: FloatArray) -> FloatArray:
    poses = []
    for direction in directions(_DIRECTIONS):
        R_view = view_rotation(direction)
        for k in range(_ROLLS):
            R = se3.exp_so3([0.0, 0.0, 2.0 * math.pi * k / _ROLLS]) @ R_view
            poses.append(se3.transform(R, centre - R @ centre))
    return np.stack(poses)


def _is_new(T: FloatArray, known_transforms: list[FloatArray]) -> bool:
    R = np.stack([other[:3, :3] for other in known_transforms])
    return bool(np.min(se3.rotation_angle(np.swapaxes(R, 1, 2) @ T[:3, :3])) > _SAME_RAD)


def _common_axis(transforms: list[FloatArray]) -> FloatArray | None:
    """Return the axis about which most of the transforms rotate; None if there is none."""
    if len(transforms) <= _MAX_ORDER:
        return None
    vectors = np.stack([se3.log_so3(T[:3, :3]) for T in transforms])
    axes = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    _, basis = np.linalg.eigh(axes.T @ axes)
    axis = basis[:, 2]
    along = np.abs(axes @ axis) > math.cos(math.radians(8.0))
    if np.count_nonzero(along) < _MAX_ORDER:
        return None
    strongest = axes[along]
    signs = np.sign(strongest @ axis)[:, None]
    mean = np.mean(strongest * signs, axis=0)
    return np.asarray(mean / np.linalg.norm(mean))
