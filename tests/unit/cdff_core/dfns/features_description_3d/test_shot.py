# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shot: the published definition, computed here a second time in the plainest way."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_core.dfns.features_description_3d._interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_description_3d._shot_kernels import local_frames
from cdff_core.dfns.features_description_3d.shot import Shot
from tests import surfaces

Array = np.ndarray
RADIUS_M = 1.5


def made(**config: object) -> Shot:
    node = Shot()
    node.configure(config)
    return node


def cloud(rng: np.random.Generator, n: int = 6000) -> tuple[Array, Array]:
    """Points of a surface and unit normals that are not quite its own."""
    points = surfaces.terrain(rng, n)
    normals = rng.normal(0, 0.3, (n, 3)) + np.array([0.0, 0.0, 1.0])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def frame_by_definition(offset: Array) -> Array:
    """Rows x, y, z: eigenvectors of the scatter weighted by R - d, turned to the majority of the neighbours."""
    weight = RADIUS_M - np.linalg.norm(offset, axis=1)
    scatter = sum(w * np.outer(p, p) for w, p in zip(weight, offset, strict=True)) / weight.sum()
    _, vectors = np.linalg.eigh(scatter)
    x, z = vectors[:, 2], vectors[:, 0]
    x = x if np.sum(offset @ x > 0) >= np.sum(offset @ x < 0) else -x
    z = z if np.sum(offset @ z > 0) >= np.sum(offset @ z < 0) else -z
    return np.array([x, np.cross(z, x), z])


def shot_by_definition(offset: Array, normals: Array, axes: Array) -> Array:
    """The histogram: every bin of every dimension gets ``max(0, 1 - d)``, d in spacings from the bin's centre."""
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
        turn = np.abs((np.arctan2(y, x) - azimuths + np.pi) % (2 * np.pi) - np.pi)
        parts = (
            1.0 - turn / (np.pi / 4),
            1.0 - np.abs(np.arcsin(z / d) - elevations) / (np.pi / 2),
            1.0 - np.abs(d - shells) / (0.5 * RADIUS_M),
            1.0 - np.abs(axes[2] @ n - cosines) / 0.2,
        )
        h += np.einsum("a,e,r,c->aerc", *(np.maximum(part, 0.0) for part in parts))
    return h.ravel() / np.linalg.norm(h)


def test_frames_and_histograms_are_those_of_the_definition(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    keypoints = points[::600]
    start, index = radius_neighbours(points, keypoints, RADIUS_M)
    frames, _ = local_frames(points, keypoints, start, index, RADIUS_M)
    out = made().process(FeaturesDescription3DInputs(points, normals, keypoints, np.array(RADIUS_M)))
    assert out.descriptors.shape == (10, 352)
    assert np.all(out.valid)
    for k, q in enumerate(keypoints):
        near = index[start[k] : start[k + 1]]
        axes = frame_by_definition(points[near] - q)
        assert np.allclose(frames[k], axes, atol=1e-9)
        expected = shot_by_definition(points[near] - q, normals[near], axes)
        assert np.allclose(out.descriptors[k], expected, atol=1e-6)


def test_frames_are_right_handed_and_turn_with_the_cloud(rng: np.random.Generator) -> None:
    points, _ = cloud(rng)
    T = se3.exp_se3([5.0, -2.0, 1.0, 1.0, -0.5, 2.0])
    keypoints = points[::100]
    start, index = radius_neighbours(points, keypoints, RADIUS_M)
    frames, _ = local_frames(points, keypoints, start, index, RADIUS_M)
    turned, _ = local_frames(
        se3.transform_points(T, points), se3.transform_points(T, keypoints), start, index, RADIUS_M
    )
    assert np.allclose(np.linalg.det(frames), 1.0)
    assert np.allclose(turned, frames @ T[:3, :3].T, atol=1e-6)


def test_descriptors_do_not_depend_on_the_pose_and_have_unit_length(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    T = se3.exp_se3([5.0, -2.0, 1.0, 1.0, -0.5, 2.0])
    here = made().process(FeaturesDescription3DInputs(points, normals, points[::60], np.array(RADIUS_M)))
    moved, moved_normals = se3.transform_points(T, points), normals @ T[:3, :3].T
    there = made().process(FeaturesDescription3DInputs(moved, moved_normals, moved[::60], np.array(RADIUS_M)))
    assert np.allclose(np.linalg.norm(here.descriptors, axis=1), 1.0, atol=1e-5)
    assert np.allclose(here.descriptors, there.descriptors, atol=1e-4)


def test_without_signed_normals_their_sides_do_not_matter(rng: np.random.Generator) -> None:
    points, normals = cloud(rng)
    flipped = normals * np.where(rng.random(len(normals)) < 0.5, -1.0, 1.0)[:, None]
    radius_m = np.array(RADIUS_M)
    both = [FeaturesDescription3DInputs(points, n, points[::600], radius_m) for n in (normals, flipped)]
    unsigned = [made(signed_normals=False).process(inputs).descriptors for inputs in both]
    signed = [made().process(inputs).descriptors for inputs in both]
    assert np.array_equal(unsigned[0], unsigned[1])
    assert not np.allclose(signed[0], signed[1], atol=0.1)


def test_a_support_with_too_few_points_or_on_a_line_is_not_valid(rng: np.random.Generator) -> None:
    line = np.c_[np.linspace(0, 1, 50), np.zeros((50, 2))]
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    far = np.array([[0.5, 0.0, 0.0], [100.0, 0.0, 0.0]])
    out = made().process(FeaturesDescription3DInputs(line, up, far, np.array(1.0)))
    assert out.valid.tolist() == [False, False]
    assert not out.descriptors.any()


def test_the_radius_follows_from_the_spacing_where_none_is_given(rng: np.random.Generator) -> None:
    x, y = np.meshgrid(np.arange(20) * 0.1, np.arange(20) * 0.1)
    points = np.c_[x.ravel(), y.ravel(), rng.normal(0, 1e-3, 400)]
    up = np.tile([0.0, 0.0, 1.0], (400, 1))
    given = made().process(FeaturesDescription3DInputs(points, up, points, np.array(0.6)))
    spacing_m = float(np.median(np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)[:, 1]))
    found = made(radius_spacings=0.6 / spacing_m).process(FeaturesDescription3DInputs(points, up, points))
    assert np.allclose(given.descriptors, found.descriptors, atol=1e-4)


def test_normals_that_do_not_fit_the_points_are_refused(rng: np.random.Generator) -> None:
    points, normals = cloud(rng, 100)
    with pytest.raises(InputError, match="normals"):
        made().process(FeaturesDescription3DInputs(points, normals[:50], points))
    with pytest.raises(InputError, match="radius_m"):
        made().process(FeaturesDescription3DInputs(points, normals, points, np.array(np.nan)))
