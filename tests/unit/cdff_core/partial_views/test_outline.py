# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Steps of the depth along the outline of a sphere before a wall, embedded in it, and out of the image."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.partial_views.model_surface import ModelSurface, model_surface, sphere_directions
from cdff_core.partial_views.outline import outline_steps
from cdff_core.partial_views.range_image import RangeImage

PIXEL, RADIUS_M, SPACING_M = 0.005, 0.1, 0.007


@pytest.fixture(scope="module")
def sphere() -> ModelSurface:
    directions = sphere_directions(3000)
    return model_surface(RADIUS_M * directions, directions, SPACING_M)


def steps(sphere: ModelSurface, wall_m: float, x_m: float = 0.0, z_m: float = 1.0) -> float:
    """Return the steps along the outline of a sphere at ``z_m``, in a view of a wall at ``wall_m``."""
    depth = np.full((200, 200), wall_m)
    image = RangeImage(np.eye(3), depth, np.array([-0.5, -0.5]), PIXEL, PIXEL / 1.5)
    return outline_steps(image, sphere, se3.transform(np.eye(3), [x_m, 0.0, z_m]), SPACING_M, 0.02)


def test_a_wall_behind_a_sphere_is_a_step_along_the_whole_outline(sphere: ModelSurface) -> None:
    assert steps(sphere, 1.2) == 1.0


def test_a_wall_at_the_depth_of_the_outline_is_no_step(sphere: ModelSurface) -> None:
    assert steps(sphere, 0.98) < 0.1


def test_a_wall_in_front_of_the_sphere_hides_the_outline(sphere: ModelSurface) -> None:
    assert steps(sphere, 0.5) == 0.0


def test_a_sphere_outside_the_image_has_no_visible_outline(sphere: ModelSurface) -> None:
    assert steps(sphere, 1.2, x_m=2.0) == 0.0


def test_the_part_of_an_outline_inside_the_image_counts(sphere: ModelSurface) -> None:
    assert steps(sphere, 1.2, x_m=0.5) == 1.0


def test_a_sphere_behind_the_sensor_has_no_outline(sphere: ModelSurface) -> None:
    assert steps(sphere, 1.2, z_m=-1.0) == 0.0
