# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry, hillshade, horn_gradient, slope_rad

GRID = GridGeometry.aligned("site", 0.5, (0, 0, 10, 8))


def plane(dz_dx: float, dz_dy: float) -> np.ndarray:
    x, y = GRID.centres_m()
    return 3.0 + dz_dx * x + dz_dy * y


def test_the_gradient_of_a_plane_is_exact_and_y_grows_upwards() -> None:
    gx, gy = horn_gradient(plane(0.2, -0.4), 0.5)
    np.testing.assert_allclose(gx[1:-1, 1:-1], 0.2, atol=1e-12)
    np.testing.assert_allclose(gy[1:-1, 1:-1], -0.4, atol=1e-12)


def test_the_slope_of_a_plane_is_its_angle() -> None:
    np.testing.assert_allclose(np.degrees(slope_rad(plane(0.0, 1.0), 0.5)[1:-1, 1:-1]), 45.0)


def test_the_slope_is_unknown_next_to_an_unobserved_cell() -> None:
    z = plane(0.1, 0.1)
    z[5, 5] = np.nan
    unknown = np.isnan(slope_rad(z, 0.5))
    assert unknown[4:7, 4:7].all()
    assert unknown[0].all()
    assert not unknown[1:-1, 1:4].any()


def test_a_slope_facing_the_light_is_brighter_and_unobserved_cells_are_zero() -> None:
    z = plane(0.5, -0.5)  # descends towards the north-west, the direction of the light
    z[0, 0] = np.nan
    bright, dark = hillshade(z, 0.5), hillshade(-z, 0.5)
    assert bright.dtype == np.uint8
    assert bright[0, 0] == 0
    assert bright[4, 4] > dark[4, 4] >= 1


def test_an_isolated_cell_is_shaded_as_flat_ground() -> None:
    z = np.full((3, 3), np.nan)
    z[1, 1] = 7.0
    assert hillshade(z, 1.0)[1, 1] == round(1 + 254 * np.sin(np.radians(45)))


def test_heights_of_wrong_shape_are_refused() -> None:
    with pytest.raises(InputError):
        horn_gradient(np.zeros(4), 1.0)
    with pytest.raises(InputError):
        hillshade(np.zeros(4), 1.0)
