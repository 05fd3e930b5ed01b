# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figures of values and their files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.plots import figure_bytes, figure_of, write_figure
from cdff_common.raster import GridGeometry

RNG = np.random.default_rng(1)
GEOMETRY = GridGeometry("site", 0.5, 2.0, 10.0, 30, 40)


def elevation() -> types.ElevationMap:
    heights = RNG.random((30, 40), dtype=np.float32)
    heights[:5] = np.nan
    return types.ElevationMap.from_layers(GEOMETRY, {"mean": heights}, t0_ns=0, t1_ns=0)


def navigation() -> types.NavigationMap:
    classes = RNG.integers(0, 4, (30, 40)).astype(np.uint8)
    return types.NavigationMap.from_layers(GEOMETRY, {"class": classes}, t0_ns=0, t1_ns=0)


def trajectory() -> types.PoseTrajectory:
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, 0, 3] = np.arange(5)
    return types.PoseTrajectory.from_arrays(np.arange(5) * 10**9, T, None, parent="a", child="b")


def pose() -> types.TransformWithCovariance:
    T = se3.transform(np.eye(3), [1.0, 2.0, 3.0])
    covariance = np.diag([4.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    return types.TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent="site", child="mana/base", stamp_ns=0
    )


VALUES: dict[str, Any] = {
    "elevation": elevation(),
    "navigation": navigation(),
    "trajectory": trajectory(),
    "pose": pose(),
    "cloud": types.Pointcloud.from_points(RNG.random((100, 3)), frame="site", stamp_ns=0),
    "image": types.Frame.from_image(np.zeros((20, 30), np.uint8), stamp_ns=0),
    "disparity": RNG.random((20, 30)).astype(np.float32),
    "distances": types.DistanceImage(width=30, height=20, data=RNG.random(600)),
    "matches": types.CorrespondenceMap2D.from_arrays(RNG.random((9, 2)), RNG.random((9, 2))),
    "points": RNG.random((100, 3)),
    "matrix": np.eye(4),
}


@pytest.mark.parametrize("name", VALUES)
def test_each_value_has_a_panel_with_its_name_and_labelled_axes(name: str) -> None:
    figure = figure_of({name: VALUES[name]})
    axes = figure.axes[0]
    assert axes.get_title() == name
    assert axes.get_xlabel()
    assert axes.get_ylabel()
    assert figure_bytes(figure).startswith(b"\x89PNG")


def test_rasters_have_a_colour_bar_and_the_extent_of_the_map() -> None:
    axes, bar = figure_of({"dem": VALUES["elevation"]}).axes
    assert bar.get_ylabel() == "height, m"
    assert tuple(axes.images[-1].get_extent()) == (2.0, 22.0, -5.0, 10.0)


def test_the_ellipse_of_a_pose_holds_95_percent_of_the_positions() -> None:
    (axes,) = figure_of({"pose": VALUES["pose"]}).axes
    ellipse = next(line for line in axes.lines if line.get_label() == "95 % of the position")
    x_m = np.asarray(ellipse.get_xdata(), dtype=float)
    assert np.ptp(x_m) / 2.0 == pytest.approx(2.0 * np.sqrt(5.991), rel=1e-3)


def test_several_values_are_panels_and_others_are_omitted() -> None:
    nine_values = dict(list(VALUES.items())[:9])  # a figure has at most nine panels
    figure = figure_of({"text": types.Time(0), **nine_values})
    assert {axes.get_title() for axes in figure.axes} >= set(nine_values)
    with pytest.raises(InputError, match="nothing to draw"):
        figure_of({"t": types.Time(0)})


def test_the_suffix_selects_png_or_svg(tmp_path: Path) -> None:
    figure = figure_of({"cloud": VALUES["points"]})
    write_figure(tmp_path / "a.svg", figure)
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<svg")
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        write_figure(tmp_path / "a.pdf", figure)


def test_notebooks_show_a_figure_as_a_picture() -> None:
    from matplotlib.figure import Figure

    figure = VALUES["cloud"].plot()
    assert isinstance(figure, Figure)
    assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(("count", "title"), [(9, ""), (11, "9 of 11 values drawn, 2 left out")])
def test_a_figure_gives_the_number_of_values_it_leaves_out(count: int, title: str) -> None:
    figure = figure_of({f"pose {index}": VALUES["pose"] for index in range(count)})
    assert len(figure.axes) == 9
    assert figure.get_suptitle() == title
