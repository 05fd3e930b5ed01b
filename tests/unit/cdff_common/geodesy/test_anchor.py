# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Anchors of sites on bodies: transform and CRS convert site coordinates to longitude and latitude."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, Body, FrameLocation, Georeference, body

MARS = body("mars")
EARTH_LIKE = Body.from_dict({"name": "earth_like", "kind": "planet", "crs": "EPSG:4326"})
POINTS = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [-730.0, 410.0, 5.0]])


@pytest.mark.req("CDFF-SUP-080")
def test_x_is_east_and_y_is_north() -> None:
    anchor = Anchor(MARS, 77.5, 18.4)
    origin, east, north, _ = anchor.lonlat(POINTS)
    assert origin == pytest.approx([77.5, 18.4, 0.0], abs=1e-9)
    degrees_per_m = np.rad2deg(1.0 / MARS.axes_m[0])
    assert east[:2] == pytest.approx([77.5 + 100 * degrees_per_m / np.cos(np.deg2rad(18.4)), 18.4], abs=1e-6)
    assert north[:2] == pytest.approx([77.5, 18.4 + 100 * degrees_per_m], abs=1e-6)


def test_the_azimuth_is_the_bearing_of_the_y_axis() -> None:
    y_axis_lonlat = Anchor(MARS, 77.5, 18.4, azimuth_deg=90.0).lonlat([[0.0, 100.0]])[0]
    assert y_axis_lonlat == pytest.approx(Anchor(MARS, 77.5, 18.4).lonlat([[100.0, 0.0]])[0], abs=1e-12)


anchors = st.builds(
    Anchor,
    st.sampled_from([MARS, body("moon"), body("bennu"), EARTH_LIKE]),
    st.floats(-179, 179),
    st.floats(-89, 89),
    st.floats(-50, 50),
    st.floats(-179, 179),
)


@settings(max_examples=60, deadline=None)
@given(anchors)
def test_site_coordinates_survive_the_conversion_to_longitude_and_latitude(anchor: Anchor) -> None:
    points = POINTS * (0.1 if anchor.body.name == "bennu" else 1.0)
    assert anchor.points(anchor.lonlat(points)) == pytest.approx(points, abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(anchors)
def test_an_anchor_is_recovered_from_its_transform(anchor: Anchor) -> None:
    recovered = Anchor.from_transform(anchor.body, anchor.T_body_frame)
    assert recovered.T_body_frame == pytest.approx(anchor.T_body_frame, abs=1e-5)
    assert recovered.height_m == pytest.approx(anchor.height_m, abs=1e-4)


@pytest.mark.parametrize("height_m", [0.0, -2500.0])
@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0])
@pytest.mark.req("CDFF-SUP-080")
def test_the_crs_agrees_with_the_transform(height_m: float, azimuth_deg: float) -> None:
    anchor = Anchor(MARS, 77.5, 18.4, height_m, azimuth_deg)
    crs = pyproj.CRS.from_wkt(anchor.wkt)
    assert crs.is_projected
    to_lonlat = pyproj.Transformer.from_crs(crs, MARS.geographic_crs, always_xy=True)
    # Points on the sphere through the site: for these, the projection agrees with the site's x and y.
    lonlat = anchor.lonlat(POINTS)
    lonlat[:, 2] = height_m
    points = anchor.points(lonlat)
    lon, lat = to_lonlat.transform(points[:, 0], points[:, 1])
    assert np.column_stack([lon, lat]) == pytest.approx(lonlat[:, :2], abs=1e-9)
    x, y = to_lonlat.transform(lonlat[:, 0], lonlat[:, 1], direction="INVERSE")
    assert np.column_stack([x, y]) == pytest.approx(points[:, :2], abs=1e-4)


def test_the_crs_survives_a_geotiff() -> None:
    from cdff_common.formats.geotiff import write_bands
    from cdff_common.raster import GridGeometry

    anchor = Anchor(MARS, 77.5, 18.4, -2500.0, 30.0)
    grid = GridGeometry.from_cells("site", 0.5, left=0, top=4, rows=4, cols=4)
    data = write_bands({"mean": np.zeros((4, 4), np.float32)}, grid, place=anchor.georeference)
    from rasterio.io import MemoryFile

    with MemoryFile(data) as memory, memory.open() as file:
        crs, transform = pyproj.CRS.from_wkt(file.crs.to_wkt()), file.transform
    assert crs.ellipsoid.semi_major_metre == 3396190.0
    # GDAL before 3.10 and PROJ before 9.5 support this method, but not Local Orthographic.
    assert crs.coordinate_operation.method_name == "Orthographic"
    to_lonlat = pyproj.Transformer.from_crs(crs, MARS.geographic_crs, always_xy=True)
    matrix = np.reshape(transform, (3, 3))[:2]
    for col, row in ((0.0, 0.0), (4.0, 4.0), (4000.0, -2000.0)):
        expected = anchor.lonlat([[0.5 * col, 2.0 - 0.5 * row]])[0][:2]
        assert to_lonlat.transform(*(matrix @ [col, row, 1.0])) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0, 180.0])
def test_a_map_of_a_turned_frame_is_read_back_in_its_frame(azimuth_deg: float) -> None:
    from cdff_common.formats.geotiff import read_map, write_map
    from cdff_common.raster import GridGeometry
    from cdff_common.types import ElevationMap

    grid = GridGeometry.from_cells("mana/camp", 0.1, left=3, top=7, rows=4, cols=5)
    layers = {"mean": np.arange(20, dtype=np.float32).reshape(4, 5)}
    value = ElevationMap.from_layers(grid, layers, t0_ns=0, t1_ns=0)
    data = write_map(value, place=Anchor(MARS, 77.5, 18.4, 100.0, azimuth_deg).georeference)
    read = read_map(data)
    assert read.geometry == grid
    assert np.array_equal(read.layer("mean"), layers["mean"])


def test_a_georeference_survives_its_dict_form() -> None:
    place = Anchor(MARS, 77.5, 18.4, 100.0, 30.0).georeference
    assert Georeference.from_dict(place.to_dict()) == place
    assert Anchor(MARS, 77.5, 18.4).georeference.is_identity
    assert not place.is_identity


def test_a_kilometre_on_the_earth_is_one_of_wgs_84() -> None:
    earth = body("earth")
    north, east = Anchor(earth, 1.48, 43.56).lonlat([[0.0, 1000.0], [1000.0, 0.0]])
    geod = pyproj.Geod(ellps="WGS84")
    for lon, lat, _ in (north, east):
        assert geod.inv(1.48, 43.56, lon, lat)[2] == pytest.approx(1000.0, abs=0.01)


def test_frames_of_different_bodies_are_not_connected() -> None:
    with pytest.raises(pyproj.exceptions.ProjError, match="celestial body"):
        pyproj.Transformer.from_crs(Anchor(MARS, 0, 0).crs, body("moon").geographic_crs).transform(0, 0)


def test_two_sites_of_one_body_are_connected_through_it() -> None:
    a, b = Anchor(MARS, 77.5, 18.4, 10.0), Anchor(MARS, 77.51, 18.4, 10.0)
    T_a_b = np.linalg.inv(a.T_body_frame) @ b.T_body_frame
    assert T_a_b[:3, 3] == pytest.approx(a.points([[77.51, 18.4, 10.0]])[0], abs=1e-6)


@pytest.mark.parametrize("numbers", [(400, 0, 0), (0, 91, 0), (0, 0, 4e6), (float("nan"), 0, 0)])
def test_an_invalid_anchor_is_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="anchor"):
        Anchor(MARS, *numbers)


def test_a_target_has_no_anchor() -> None:
    with pytest.raises(InputError, match="no longitude"):
        Anchor(body("orbital_target"), 0.0, 0.0)


def test_an_unanchored_frame_has_an_engineering_crs_with_the_name_of_the_frame() -> None:
    location = FrameLocation("mana/odom")
    crs = pyproj.CRS.from_wkt(location.wkt)
    assert crs.is_engineering
    assert crs.name == "mana/odom"
    with pytest.raises(InputError, match="not anchored"):
        location.lonlat([[0.0, 0.0]])
