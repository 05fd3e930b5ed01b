# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies in the light of the Sun: radiance, shadow and outline against analytic values."""

from __future__ import annotations

from math import erf, sqrt

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.object_models.lit_body import in_shadow, lit_body
from cdff_core.object_models.rendering import Window
from tests.support import satellite
from tests.support.sunlit_images import sunlit

FOCAL_PX, DISTANCE_M, SPREAD_PX = 2000.0, 50.0, 0.7
#: A camera 50 m away: 40 px/m on the plane of the origin of the body.
CAMERA = Window(FOCAL_PX, FOCAL_PX, 79.5, 79.5, 160, 160)
FACING = se3.transform(np.eye(3), [0.0, 0.0, DISTANCE_M])


def light_of(mesh: satellite.Mesh, sun: np.ndarray, extent_px: float = 100.0) -> np.ndarray:
    return lit_body(*mesh, FACING, CAMERA, sun, point_spread_px=SPREAD_PX, extent_px=extent_px)


def sphere(resolution: int) -> satellite.Mesh:
    """Return a sphere with a radius of 1 m."""
    import open3d

    ball = open3d.geometry.TriangleMesh.create_sphere(1.0, resolution=resolution)
    return np.asarray(ball.vertices), np.asarray(ball.triangles, np.int64)


@pytest.mark.parametrize("phase_deg", [0.0, 40.0, 100.0])
def test_the_radiance_of_a_sphere_is_the_analytic_one(phase_deg: float) -> None:
    phase = np.radians(phase_deg)
    sun = np.array([np.sin(phase), 0.0, -np.cos(phase)])
    light = light_of(sphere(150), sun)
    tested = 0
    for row, column in ((79, 80), (60, 90), (95, 100), (79, 95), (79, 110), (100, 60)):
        ray = np.array([(column - 79.5) / FOCAL_PX, (row - 79.5) / FOCAL_PX, 1.0])
        ray /= np.linalg.norm(ray)
        along = DISTANCE_M * ray[2]
        normal = (along - np.sqrt(along**2 - DISTANCE_M**2 + 1.0)) * ray - [0.0, 0.0, DISTANCE_M]
        mu0, mu = normal @ sun, -normal @ ray
        expected = 2.0 * mu0 / (mu0 + mu) if mu0 > 0.0 else 0.0
        if abs(mu0) > 0.1:  # the terminator is blurred
            assert light[row, column] == pytest.approx(expected, abs=0.02)
            tested += 1
    assert tested >= 3


@pytest.mark.parametrize("sun_deg", [30.0, 45.0, 60.0])
def test_the_edge_of_a_shadow_is_where_the_ray_over_the_wall_ends(sun_deg: float) -> None:
    # A wall of 0.4 m at x = 0 on a plate whose front is at z = 0; the Sun is to the right of the camera.
    plate = satellite.box((3.0, 1.0, 0.1), (0.0, 0.0, 0.05))
    wall = satellite.box((0.02, 1.0, 0.4), (0.0, 0.0, -0.2))
    sun = np.array([np.sin(np.radians(sun_deg)), 0.0, -np.cos(np.radians(sun_deg))])
    row = light_of(satellite.merged(plate, wall), sun)[80]
    level = 2.0 * np.cos(np.radians(sun_deg)) / (np.cos(np.radians(sun_deg)) + 1.0)
    edge_m = -0.01 - 0.4 * np.tan(np.radians(sun_deg))
    edge_px = 79.5 + FOCAL_PX * edge_m / DISTANCE_M
    left = np.arange(int(edge_px) - 8, int(edge_px) + 8)
    found_px = np.interp(0.5 * level, row[left][::-1], left[::-1])
    assert found_px == pytest.approx(edge_px, abs=0.6)  # the image from the Sun has about 1 px
    assert row[int(edge_px) - 8] == pytest.approx(level, abs=0.01)
    assert row[int(edge_px) + 8] == pytest.approx(0.0, abs=0.01)


def test_a_point_is_in_shadow_behind_the_body_only() -> None:
    cube = satellite.box((1.0, 1.0, 1.0))
    points = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.4, 0.4, 0.5], [0.0, 0.0, -1.5]])
    is_shadowed = in_shadow(*cube, points, np.zeros(4), np.array([0.0, 0.0, 1.0]))
    assert is_shadowed.tolist() == [False, True, False, True]


@pytest.mark.parametrize("part_px", [0.0, 0.25, 0.5, 0.75])
def test_a_pixel_on_the_outline_has_the_light_of_its_covered_part(part_px: float) -> None:
    # The right edge of a plate that faces camera and Sun is part_px into column 100.
    edge_px = 99.5 + part_px
    edge_m = (edge_px - 79.5) * DISTANCE_M / FOCAL_PX
    plate = satellite.box((edge_m + 1.0, 1.5, 0.1), (0.5 * (edge_m - 1.0), 0.0, 0.05))
    row = light_of(plate, np.array([0.0, 0.0, -1.0]), extent_px=50.0)[80]  # 16 samples of each pixel
    sigma_px = sqrt(SPREAD_PX**2 + 1.0 / 12.0)  # of the image of a point, and of the area of a pixel
    for column in (99, 100, 101):
        expected = 0.5 * (1.0 + erf((edge_px - column) / sigma_px / sqrt(2.0)))
        assert row[column] == pytest.approx(expected, abs=0.05)


def test_the_image_is_that_of_traced_rays() -> None:
    plate = satellite.box((1.5, 1.2, 0.2))
    mast = satellite.box((0.2, 0.2, 0.6), (0.3, -0.2, -0.4))
    both = satellite.merged(plate, mast)
    T = se3.transform(se3.exp_so3([0.4, -0.3, 0.2]), [0.1, 0.0, 4.0])
    camera = Window(300.0, 300.0, 159.5, 119.5, 240, 320)
    K = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
    sun = np.array([0.6, 0.3, -0.74])
    sun /= np.linalg.norm(sun)
    difference = lit_body(*both, T, camera, sun, point_spread_px=0.7, extent_px=120.0) - sunlit(
        both, T, K, sun
    )
    assert np.abs(difference).mean() < 0.002
    assert (np.abs(difference) > 0.15).mean() < 0.002
