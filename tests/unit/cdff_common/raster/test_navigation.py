# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly of navigation maps: a cell has the values of a single map, never a mixture."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.raster.cell_selection import NavigationChoice
from cdff_common.raster.navigation import NavigationMosaic

WINDOW = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)


def layers(classes: np.ndarray, cost: float) -> dict[str, np.ndarray]:
    return {"class": classes.astype(np.uint8), "cost": np.where(classes > 0, cost, np.nan).astype(np.float32)}


def uniform_map(value: int, cost: float = 0.5, shape: tuple[int, int] = (10, 10)) -> dict[str, np.ndarray]:
    return layers(np.full(shape, value), cost)


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (NavigationChoice.NEWEST, (1, 0.1)),
        (NavigationChoice.OLDEST, (2, 0.2)),
        (NavigationChoice.WORST, (3, 0.9)),
    ],
)
def test_a_cell_has_the_class_of_the_selected_map(
    choice: NavigationChoice, expected: tuple[int, float]
) -> None:
    mosaic = NavigationMosaic(WINDOW, choice)
    for navigation_layers in (uniform_map(2, 0.2), uniform_map(3, 0.9), uniform_map(1, 0.1)):
        assert mosaic.add(WINDOW, navigation_layers)
    window = mosaic.layers()
    assert np.unique(window["class"]).tolist() == [expected[0]]
    np.testing.assert_allclose(window["cost"], expected[1], rtol=1e-6)
    assert mosaic.differing.all()


def test_unknown_cells_of_a_map_do_not_override_others() -> None:
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(WINDOW, uniform_map(3, 1.0))
    classes = np.zeros((10, 10))
    classes[:, :5] = 1
    mosaic.add(WINDOW, layers(classes, 0.25))
    window = mosaic.layers()
    assert window["class"][:, :5].tolist() == [[1] * 5] * 10
    assert window["class"][:, 5:].tolist() == [[3] * 5] * 10
    assert mosaic.differing.sum() == 50
    np.testing.assert_array_equal(window["cost"][0], [0.25] * 5 + [1.0] * 5)


def test_an_aggregated_cell_has_the_worst_class() -> None:
    fine = GridGeometry("site", 0.05, 0.0, 1.0, 20, 20)
    classes = np.ones((20, 20))
    classes[7, 3] = 3
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(fine, layers(classes, 0.5))
    window = mosaic.layers()["class"]
    assert window[3, 1] == 3
    assert (window == 3).sum() == 1


def test_a_map_of_another_frame_is_resampled_without_holes_or_lost_hazards() -> None:
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 0.6]), [0.4, 0.1, 0.0]))
    odom_grid = GridGeometry("mana/odom", 0.1, -2.0, 2.0, 40, 40)
    classes = np.ones((40, 40))
    classes[17, 22] = 3
    mosaic = NavigationMosaic(WINDOW)
    assert mosaic.add(odom_grid, layers(classes, 0.5), T)
    window = mosaic.layers()["class"]
    assert (window > 0).all()
    hazard_xyz = T.apply(np.array([[odom_grid.x_centres_m()[22], odom_grid.y_centres_m()[17], 0.0]]))[0]
    assert window[int((1.0 - hazard_xyz[1]) / 0.1), int(hazard_xyz[0] / 0.1)] == 3
    assert 1 <= (window == 3).sum() <= 4


def test_a_map_outside_the_window_does_not_change_it() -> None:
    mosaic = NavigationMosaic(WINDOW)
    assert not mosaic.add(GridGeometry("site", 0.1, 5.0, 1.0, 10, 10), uniform_map(3))
    far = UncertainTransform(se3.transform(np.eye(3), [50.0, 0.0, 0.0]))
    assert not mosaic.add(GridGeometry("mana/odom", 0.1, 0.0, 1.0, 10, 10), uniform_map(3), far)
    assert not mosaic.layers()["class"].any()


def test_a_layer_missing_in_the_selected_map_is_unknown() -> None:
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(WINDOW, uniform_map(1))
    mosaic.add(WINDOW, {"class": np.full((10, 10), 2, dtype=np.uint8)})
    assert np.isnan(mosaic.layers()["cost"]).all()


def test_an_invalid_or_too_coarse_navigation_map_is_refused() -> None:
    mosaic = NavigationMosaic(WINDOW)
    with pytest.raises(InputError, match="without layer 'class'"):
        mosaic.add(WINDOW, {"cost": np.zeros((10, 10), np.float32)})
    with pytest.raises(InputError, match=r"cells of 0\.2 m"):
        mosaic.add(GridGeometry("site", 0.2, 0.0, 1.0, 5, 5), uniform_map(1, shape=(5, 5)))
