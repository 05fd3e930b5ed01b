# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Navigation maps put together: a cell is one map's judgement, the worst of the cells that become one."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.raster.choice import NavigationChoice
from cdff_common.raster.navigation import NavigationMosaic

WINDOW = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)


def layers(classes: np.ndarray, cost: float) -> dict[str, np.ndarray]:
    return {"class": classes.astype(np.uint8), "cost": np.where(classes > 0, cost, np.nan).astype(np.float32)}


def of(value: int, cost: float = 0.5, shape: tuple[int, int] = (10, 10)) -> dict[str, np.ndarray]:
    return layers(np.full(shape, value), cost)


@pytest.mark.parametrize(
    ("choice", "wanted"),
    [(NavigationChoice.NEWEST, (1, 0.1)), (NavigationChoice.OLDEST, (2, 0.2)), (NavigationChoice.WORST, (3, 0.9))],
)
def test_a_cell_is_the_judgement_of_the_map_that_is_chosen(choice: NavigationChoice, wanted: tuple[int, float]) -> None:
    mosaic = NavigationMosaic(WINDOW, choice)
    for given in (of(2, 0.2), of(3, 0.9), of(1, 0.1)):
        assert mosaic.add(WINDOW, given)
    found = mosaic.layers()
    assert np.unique(found["class"]).tolist() == [wanted[0]]
    np.testing.assert_allclose(found["cost"], wanted[1], rtol=1e-6)
    assert mosaic.differing.all()


def test_what_a_map_does_not_know_it_does_not_judge() -> None:
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(WINDOW, of(3, 1.0))
    half = np.zeros((10, 10))
    half[:, :5] = 1
    mosaic.add(WINDOW, layers(half, 0.25))
    found = mosaic.layers()
    assert found["class"][:, :5].tolist() == [[1] * 5] * 10
    assert found["class"][:, 5:].tolist() == [[3] * 5] * 10
    assert mosaic.differing.sum() == 50
    np.testing.assert_array_equal(found["cost"][0], [0.25] * 5 + [1.0] * 5)


def test_the_worst_of_the_cells_that_become_one_counts() -> None:
    fine = GridGeometry("site", 0.05, 0.0, 1.0, 20, 20)
    classes = np.ones((20, 20))
    classes[7, 3] = 3
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(fine, layers(classes, 0.5))
    found = mosaic.layers()["class"]
    assert found[3, 1] == 3
    assert (found == 3).sum() == 1


def test_a_map_of_another_frame_leaves_no_hole_and_loses_no_hazard() -> None:
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 0.6]), [0.4, 0.1, 0.0]))
    theirs = GridGeometry("mana/odom", 0.1, -2.0, 2.0, 40, 40)
    classes = np.ones((40, 40))
    classes[17, 22] = 3
    mosaic = NavigationMosaic(WINDOW)
    assert mosaic.add(theirs, layers(classes, 0.5), T)
    found = mosaic.layers()["class"]
    assert (found > 0).all()
    at = T.apply(np.array([[theirs.x_centres_m()[22], theirs.y_centres_m()[17], 0.0]]))[0]
    assert found[int((1.0 - at[1]) / 0.1), int(at[0] / 0.1)] == 3
    assert 1 <= (found == 3).sum() <= 4


def test_a_map_beside_the_window_does_not_reach_into_it() -> None:
    mosaic = NavigationMosaic(WINDOW)
    assert not mosaic.add(GridGeometry("site", 0.1, 5.0, 1.0, 10, 10), of(3))
    far = UncertainTransform(se3.transform(np.eye(3), [50.0, 0.0, 0.0]))
    assert not mosaic.add(GridGeometry("mana/odom", 0.1, 0.0, 1.0, 10, 10), of(3), far)
    assert not mosaic.layers()["class"].any()


def test_layers_that_only_some_maps_have_are_unknown_in_the_others() -> None:
    mosaic = NavigationMosaic(WINDOW)
    mosaic.add(WINDOW, of(1))
    mosaic.add(WINDOW, {"class": np.full((10, 10), 2, dtype=np.uint8)})
    assert np.isnan(mosaic.layers()["cost"]).all()


def test_what_is_no_navigation_map_or_too_coarse_is_refused() -> None:
    mosaic = NavigationMosaic(WINDOW)
    with pytest.raises(InputError, match="without layer 'class'"):
        mosaic.add(WINDOW, {"cost": np.zeros((10, 10), np.float32)})
    with pytest.raises(InputError, match=r"cells of 0\.2 m"):
        mosaic.add(GridGeometry("site", 0.2, 0.0, 1.0, 5, 5), of(1, shape=(5, 5)))
