# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SHOT descriptors agree with a direct implementation of the published definition."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_core.dfns.features_description_3d._shot_kernels import local_frames
from cdff_core.dfns.features_description_3d.interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_description_3d.shot import Shot
from tests.support import surfaces

Array = np.ndarray
RADIUS_M = 1.5


def make_node(**config: object) -> Shot:
    node = Shot()
    node.configure(config)
    return node


def cloud(rng: np.random.Generator, n: int = 6000) -> tuple[Array, Array]:
    """Return points of a surface and unit normals with noise."""
    points = surfaces.terrain(rng, n)
    normals = rng.normal(0, 0.3, (n, 3)) + np.array([0.0, 0.0, 1.0])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def frame_by_definition(offset: Array) -> Array:
    """Return the axes x, y, z as rows: eigenvectors of the scatter weighted by R - d, with signs towards the
    majority of the neighbours.
    """
    weight = RADIUS_M - np.linalg.norm(offset, axis=1)
    scatter = sum(w * np.outer(p, p) for w, p in zip(weight, offset, strict=True)) / weight.sum()
    _, vectors = np.linalg.eigh(scatter)
    x, z = vectors[:, 2], vectors[:, 0]
    x = x if np.sum(offset @ x > 0) >= np.sum(offset @ x < 0) else -x
    z = z if np.sum(offset @ z > 0) >= np.sum(offset @ z < 0) else -z
    return np.array([x, np.cross(z, x), z])


def shot_by_definition(offset: Array, normals: Array, axes: Array) -> Array:
    """Return the normalised histogram: each bin of each dimension gets ``max(0, 1 - d)``, d the distance from
    the bin's centre in bin spacings.
    """
    azimuths = -np.pi + (np.arange(8) + 0.5) * np.pi / 4
    elevations = np.array([-np.pi / 4, np.pi / 4])
    shells = np.array([0.25, 0.75]) * RADIUS_M
    cosines = -1.0 + 0.2 * np.arange(11)
    h = np.zeros((8, 2, 2, 11))
    for p, n in zip(offset, normals, strict=True):
        x, y, z = axes @ p
        d = np.linalg.norm(p)
        if d == 0.0:
            continue
        azimuth_distance = np.abs((np.arctan2(y, x) - azimuths + np.pi) % (2 * np.pi) - np.pi)
        weights = (
            1.0 - azimuth_distance / (np.pi / 4),
            1.0 - np.abs(np.arcsin(z / d) - elevations) / (np.pi / 2),
            1.0 - np.abs(d - shells) / (0.5 * RADIUS_M),
            1.0 - np.abs(axes[2] @ n - cosines) / 0.2,
        )
        h += np.einsum("a,e,r,c->aerc", *(np.maximum(weight, 0.0) for weight in weights))
    return h.ravel() / np.linalg.norm(h)


def test_frames_and_histograms_follow_the_definition(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    keypoints = points[::600]
    start, index = radius_neighbours(points, keypoints, RADIUS_M)
    frames, _ = local_frames(points, keypoints, start, index, RADIUS_M)
    out = make_node().process(
        FeaturesDescription3DInputs(points=points, normals=normals, keypoints=keypoints, radius_m=RADIUS_M)
    )
    assert out.descriptors.shape == (10, 352)
    assert np.all(out.valid)
    for k, q in enumerate(keypoints):
        near = index[start[k] : start[k + 1]]
        axes = frame_by_definition(points[near] - q)
        assert np.allclose(frames[k], axes, atol=1e-9)
        expected = shot_by_definition(points[near] - q, normals[near], axes)
        assert np.allclose(out.descriptors[k], expected, atol=1e-6)


def test_frames_are_right_handed_and_rotate_with_the_cloud(rng: np.random.Generator) -> None:
    points, _ = cloud(rng)
    T = se3.exp_se3([5.0, -2.0, 1.0, 1.0, -0.5, 2.0])
    keypoints = points[::100]
    start, index = radius_neighbours(points, keypoints, RADIUS_M)
    frames, _ = local_frames(points, keypoints, start, index, RADIUS_M)
    rotated_frames, _ = local_frames(
        se3.transform_points(T, points), se3.transform_points(T, keypoints), start, index, RADIUS_M
    )
    assert np.allclose(np.linalg.det(frames), 1.0)
    assert np.allclose(rotated_frames, frames @ T[:3, :3].T, atol=1e-6)


def test_descriptors_do_not_depend_on_the_pose_and_have_unit_length(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    T = se3.exp_se3([5.0, -2.0, 1.0, 1.0, -0.5, 2.0])
    original = make_node().process(
        FeaturesDescription3DInputs(points=points, normals=normals, keypoints=points[::60], radius_m=RADIUS_M)
    )
    moved_points, moved_normals = se3.transform_points(T, points), normals @ T[:3, :3].T
    of_moved = make_node().process(
        FeaturesDescription3DInputs(
            points=moved_points, normals=moved_normals, keypoints=moved_points[::60], radius_m=RADIUS_M
        )
    )
    assert np.allclose(np.linalg.norm(original.descriptors, axis=1), 1.0, atol=1e-5)
    assert np.allclose(original.descriptors, of_moved.descriptors, atol=1e-4)


def test_the_sign_of_unsigned_normals_has_no_effect(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    flipped = normals * np.where(rng.random(len(normals)) < 0.5, -1.0, 1.0)[:, None]
    inputs_of_both = [
        FeaturesDescription3DInputs(points=points, normals=n, keypoints=points[::600], radius_m=RADIUS_M)
        for n in (normals, flipped)
    ]
    unsigned = [make_node(signed_normals=False).process(inputs).descriptors for inputs in inputs_of_both]
    signed = [make_node().process(inputs).descriptors for inputs in inputs_of_both]
    assert np.array_equal(unsigned[0], unsigned[1])
    assert not np.allclose(signed[0], signed[1], atol=0.1)


def test_a_neighbourhood_of_too_few_or_collinear_points_is_invalid(rng: np.random.Generator) -> None:
    line = np.c_[np.linspace(0, 1, 50), np.zeros((50, 2))]
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    keypoints = np.array([[0.5, 0.0, 0.0], [100.0, 0.0, 0.0]])
    out = make_node().process(
        FeaturesDescription3DInputs(points=line, normals=up, keypoints=keypoints, radius_m=1.0)
    )
    assert out.valid.tolist() == [False, False]
    assert not out.descriptors.any()


def test_the_default_radius_is_derived_from_the_point_spacing(rng: np.random.Generator) -> None:
    x, y = np.meshgrid(np.arange(20) * 0.1, np.arange(20) * 0.1)
    points = np.c_[x.ravel(), y.ravel(), rng.normal(0, 1e-3, 400)]
    up = np.tile([0.0, 0.0, 1.0], (400, 1))
    with_radius = make_node().process(
        FeaturesDescription3DInputs(points=points, normals=up, keypoints=points, radius_m=0.6)
    )
    spacing_m = float(
        np.median(np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)[:, 1])
    )
    with_default_radius = make_node(radius_spacings=0.6 / spacing_m).process(
        FeaturesDescription3DInputs(points=points, normals=up, keypoints=points)
    )
    assert np.allclose(with_radius.descriptors, with_default_radius.descriptors, atol=1e-4)


def test_normals_of_inconsistent_shape_are_refused(rng: np.random.Generator) -> None:
    points, normals = cloud(rng, 100)
    with pytest.raises(InputError, match="normals"):
        make_node().process(
            FeaturesDescription3DInputs(points=points, normals=normals[:50], keypoints=points)
        )
    with pytest.raises(InputError, match="radius_m"):
        make_node().process(
            FeaturesDescription3DInputs(points=points, normals=normals, keypoints=points, radius_m=np.nan)
        )
