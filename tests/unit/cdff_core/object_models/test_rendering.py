# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The z-buffer against Open3D's ray casting, clipping, windows and normals."""

from __future__ import annotations

import numpy as np
import open3d as o3d

from cdff_common.geometry import se3
from cdff_core.object_models.rendering import NO_FACE, Window, camera_normals, render
from tests.support import satellite

WINDOW = Window(200.0, 210.0, 70.0, 55.0, 110, 140)


def ray_cast(mesh: satellite.Mesh, T: np.ndarray, w: Window) -> tuple[np.ndarray, np.ndarray]:
    """Return depths and faces of a mesh along the rays of the pixel centres."""
    columns, rows = np.meshgrid(np.arange(w.columns), np.arange(w.rows))
    rays = np.stack([(columns - w.cx) / w.fx, (rows - w.cy) / w.fy, np.ones(columns.shape)], axis=-1)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(se3.transform_points(T, mesh[0]).astype(np.float32)),
        o3d.core.Tensor(mesh[1].astype(np.uint32)),
    )
    query = np.concatenate([np.zeros_like(rays), rays], axis=-1).astype(np.float32)
    answer = scene.cast_rays(o3d.core.Tensor(query))
    return answer["t_hit"].numpy(), answer["primitive_ids"].numpy()


def test_depths_agree_with_ray_casting_except_on_outlines(rng: np.random.Generator) -> None:
    mesh = satellite.satellite()
    for _ in range(5):
        T = satellite.random_pose(rng, 3.0)
        depth_m, face = render(*mesh, T, WINDOW)
        expected, _ = ray_cast(mesh, T, WINDOW)
        assert np.mean(np.isfinite(depth_m) != np.isfinite(expected)) < 0.002
        both = np.isfinite(depth_m) & np.isfinite(expected)
        assert np.mean(np.abs(depth_m[both] - expected[both]) > 1e-4) < 0.005
        assert ((face == NO_FACE) == ~np.isfinite(depth_m)).all()


def test_triangles_behind_and_around_the_camera_are_clipped() -> None:
    floor = (
        np.array([[-50.0, 1.0, -50.0], [50.0, 1.0, -50.0], [50.0, 1.0, 50.0], [-50.0, 1.0, 50.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    depth_m, _ = render(*floor, np.eye(4), WINDOW)
    rows = np.arange(WINDOW.rows)
    expected = np.where(rows > WINDOW.cy, WINDOW.fy / np.maximum(rows - WINDOW.cy, 1e-9), np.inf)
    visible = expected < 49.0
    np.testing.assert_allclose(depth_m[visible, 70], expected[visible], rtol=1e-9)
    assert not np.isfinite(depth_m[rows <= WINDOW.cy]).any()


def test_a_cropped_window_shows_the_same_pixels() -> None:
    mesh, T = satellite.satellite(), satellite.random_pose(np.random.default_rng(3), 3.0)
    whole_window = render(*mesh, T, WINDOW)
    part = render(*mesh, T, WINDOW.cropped(20, 30, 40, 50))
    np.testing.assert_allclose(part.depth_m, whole_window.depth_m[20:60, 30:80], rtol=1e-12)
    np.testing.assert_array_equal(part.face, whole_window.face[20:60, 30:80])


def test_normals_point_to_the_camera_whatever_the_order_of_the_corners() -> None:
    vertices, triangles = satellite.box((1.0, 1.0, 1.0))
    triangles = np.where(np.arange(12)[:, None] % 2 == 0, triangles, triangles[:, ::-1])
    T = se3.transform(np.eye(3), [0.0, 0.0, 3.0])
    _, face = render(vertices, triangles, T, WINDOW)
    normals = camera_normals(vertices, triangles, T, face)
    np.testing.assert_allclose(normals[55, 70], [0.0, 0.0, -1.0], atol=1e-12)
    assert np.isnan(normals[0, 0]).all()
