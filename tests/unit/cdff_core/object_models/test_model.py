# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Preparation: only the visible surface, outward normals, symmetry groups, decimation."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_core.object_models.decimation import decimate, decimate_to_cell
from cdff_core.object_models.model import PreparationConfig, content_hash, prepare_model
from cdff_core.object_models.nearest_grid import nearest_grid
from cdff_core.object_models.surface import VisibleSurface, visible_surface
from cdff_core.object_models.symmetry import symmetry_group
from tests.support import satellite

SMALL = PreparationConfig(points=3000, views=60, view_pixels=96, grid_cells=48)


def surface_of(mesh: satellite.Mesh) -> VisibleSurface:
    return visible_surface(*mesh, points=3000, views=60, pixels=96)


def test_inner_parts_are_dropped_and_normals_point_outwards() -> None:
    mesh = satellite.satellite()
    surface = surface_of(mesh)
    assert len(surface.points_m) == pytest.approx(3000, rel=0.1)
    inside = np.all(np.abs(surface.points_m) < [0.39, 0.29, 0.24], axis=1)
    assert not inside.any()
    of_body = np.abs(surface.points_m[:, 0] + 0.4) < 1e-6  # the wall of the body at x = -0.4
    of_body &= np.abs(surface.points_m[:, 1]) < 0.25
    assert np.count_nonzero(of_body) > 50
    assert (surface.normals[of_body, 0] < -0.999).all()
    inner_vertices = set(range(len(mesh[0]) - 16, len(mesh[0])))
    assert not inner_vertices & set(surface.triangles.ravel().tolist())


def test_a_thin_panel_with_inverted_faces_has_points_on_both_sides_with_opposite_normals() -> None:
    surface = surface_of(satellite.satellite())
    on_panel = (surface.points_m[:, 0] > 0.5) & (np.abs(np.abs(surface.points_m[:, 1]) - 0.01) < 1e-6)
    points, normals = surface.points_m[on_panel], surface.normals[on_panel]
    facing = np.abs(normals[:, 1]) > 0.9
    assert np.count_nonzero(facing) > 100
    assert (np.sign(normals[facing, 1]) == np.sign(points[facing, 1])).all()
    assert 0.3 < np.mean(points[facing, 1] > 0) < 0.7


@pytest.mark.parametrize(
    ("mesh", "order"),
    [
        (satellite.satellite(), 1),
        (satellite.box((1.0, 1.0, 1.0)), 24),
        (satellite.box((1.0, 2.0, 3.0)), 4),
        (satellite.box((1.0, 1.0, 3.0)), 8),
    ],
    ids=["satellite", "cube", "brick", "square prism"],
)
def test_the_symmetry_group_is_found(mesh: satellite.Mesh, order: int) -> None:
    surface = surface_of(mesh)
    group = symmetry_group(surface, nearest_grid(surface.points_m, 48), 0.02)
    assert len(group.transforms) == order
    assert group.axis is None
    np.testing.assert_array_equal(group.transforms[0], np.eye(4))
    for T in group.transforms:
        corners = mesh[0][:8] if order > 1 else np.zeros((1, 3))
        moved_corners = se3.transform_points(T, corners)
        assert np.linalg.norm(moved_corners[:, None] - corners[None], axis=2).min(axis=1).max() < 0.03


def test_a_cylinder_has_a_continuous_symmetry_about_its_axis_and_can_be_reversed() -> None:
    surface = surface_of(satellite.cylinder(0.5, 2.0))
    group = symmetry_group(surface, nearest_grid(surface.points_m, 48), 0.02)
    assert group.axis is not None
    assert abs(group.axis[2]) > 0.999
    assert len(group.transforms) == 72


def test_decimation_to_cells_keeps_planes_and_edges_and_drops_unused_vertices() -> None:
    size = 40
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, size + 1), np.linspace(-1.0, 1.0, size + 1), indexing="ij")
    roof = np.column_stack([x.ravel(), y.ravel(), 0.3 * np.abs(x.ravel())])
    row = np.arange(size * (size + 1)).reshape(size, size + 1)[:, :-1].ravel()
    halves = [
        np.column_stack([row, row + size + 1, row + 1]),
        np.column_stack([row + 1, row + size + 1, row + size + 2]),
    ]
    triangles = np.concatenate(halves)
    vertices, kept = decimate_to_cell(np.vstack([roof, [[9.0, 9.0, 9.0]]]), triangles, 0.2)
    assert len(kept) < len(triangles) / 8
    assert np.abs(vertices).max() <= 1.0 + 1e-9
    np.testing.assert_allclose(vertices[:, 2], 0.3 * np.abs(vertices[:, 0]), atol=1e-3)
    corners = vertices[kept]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert areas.sum() == pytest.approx(4.0 * np.hypot(1.0, 0.3), rel=0.2)


def test_symmetry_ignores_where_the_origin_is() -> None:
    vertices, triangles = satellite.box((1.0, 2.0, 3.0))
    surface = surface_of((vertices + np.array([5.0, -3.0, 2.0]), triangles))
    group = symmetry_group(surface, nearest_grid(surface.points_m, 48), 0.02)
    assert len(group.transforms) == 4
    centre = np.array([5.0, -3.0, 2.0])
    for T in group.transforms:
        np.testing.assert_allclose(se3.transform_points(T, centre[None])[0], centre, atol=0.02)


def test_decimation_keeps_the_shape_within_a_cluster() -> None:
    n = 60
    u, v = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, n))
    sphere = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1).reshape(-1, 3)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)])
    vertices, kept_triangles, cell = decimate(sphere, triangles, 1000)
    assert 400 < len(kept_triangles) <= 1000
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1.0).max() < cell
    assert decimate(sphere, triangles, 10_000)[2] == 0.0


def test_faulty_meshes_are_refused() -> None:
    vertices, triangles = satellite.box((1.0, 1.0, 1.0))
    with pytest.raises(InputError, match="no triangle"):
        prepare_model(vertices, triangles[:0], SMALL)
    with pytest.raises(InputError, match="NaN"):
        prepare_model(np.where(vertices > 0, np.nan, vertices), triangles, SMALL)
    with pytest.raises(DegenerateGeometryError, match="extent"):
        prepare_model(np.zeros_like(vertices), triangles, SMALL)


def test_the_content_hash_changes_with_the_mesh() -> None:
    vertices, triangles = satellite.box((1.0, 1.0, 1.0))
    assert content_hash(vertices, triangles) == content_hash(vertices.copy(), triangles.copy())
    assert content_hash(2.0 * vertices, triangles) != content_hash(vertices, triangles)
    assert content_hash(vertices, triangles[::-1]) != content_hash(vertices, triangles)
