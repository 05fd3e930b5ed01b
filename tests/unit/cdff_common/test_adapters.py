# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of messages to other libraries, files and plots."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cdff_common import types
from cdff_common.codecs import decode
from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry

POINTS_M = np.arange(12.0).reshape(4, 3)
CLOUD = types.Pointcloud.from_points(POINTS_M, frame="site", stamp_ns=0)
DEM = types.ElevationMap.from_layers(
    GridGeometry("site", 0.5, 10.0, 4.0, 2, 4),
    {"mean": np.arange(8, dtype=np.float32).reshape(2, 4)},
    t0_ns=0,
    t1_ns=0,
)
T = np.tile(np.eye(4), (3, 1, 1))
T[:, 0, 3] = [0.0, 3.0, 1.0]
PATH = types.PoseTrajectory.from_arrays(np.arange(3) * 10**9, T, None, parent="site", child="mana/base")


def test_arrays_have_the_names_of_layers_and_properties() -> None:
    assert list(DEM.to_numpy()) == ["mean"]
    np.testing.assert_array_equal(CLOUD.to_numpy()["points_m"], POINTS_M)
    assert set(PATH.to_numpy()) >= {"stamps_ns", "matrices"}


def test_the_stamp_of_a_message_is_also_a_datetime() -> None:
    cloud = types.Pointcloud.from_points(POINTS_M, frame="site", stamp_ns=1_700_000_000_500_000_000)
    assert cloud.to_datetime().isoformat() == "2023-11-14T22:13:20.500000+00:00"
    assert types.Time.from_ns(cloud.stamp_ns).to_datetime() == cloud.to_datetime()
    with pytest.raises(InputError, match="a Vector3d has no stamp"):
        types.Vector3d().to_datetime()


def test_a_map_in_xarray_has_the_centres_of_its_cells() -> None:
    pytest.importorskip("xarray")
    data = DEM.to_xarray()
    assert float(data["mean"].sel(x=10.25, y=3.75)) == 0.0
    assert float(data["mean"].sel(x=11.75, y=3.25)) == 7.0
    assert data.attrs["frame"] == "site"


def test_a_trajectory_in_pandas_has_datetimes() -> None:
    pytest.importorskip("pandas")
    table = PATH.to_pandas()
    assert str(table.index[1]) == "1970-01-01 00:00:01"
    assert table["x"].tolist() == [0.0, 3.0, 1.0]
    assert table["qw"].tolist() == [1.0, 1.0, 1.0]
    assert CLOUD.to_pandas()[["x", "y", "z"]].to_numpy().tolist() == POINTS_M.tolist()


def test_a_path_in_geopandas_is_made_of_its_geojson(monkeypatch: pytest.MonkeyPatch) -> None:
    geopandas = SimpleNamespace(GeoDataFrame=SimpleNamespace(from_features=lambda features: features))
    monkeypatch.setattr("cdff_common.adapters.import_extra", lambda module: geopandas)
    (feature,) = PATH.to_geopandas()
    assert feature["geometry"]["type"] == "LineString"


@pytest.mark.slow  # importing Open3D takes seconds
def test_a_cloud_in_open3d_has_its_finite_points() -> None:
    pytest.importorskip("open3d")
    points_m = np.vstack([POINTS_M, [np.nan, 0.0, 0.0]])
    cloud = types.Pointcloud.from_points(points_m, frame="site", stamp_ns=0).to_open3d()
    np.testing.assert_array_equal(np.asarray(cloud.points), POINTS_M)


def test_the_suffix_of_a_saved_file_selects_its_format(tmp_path: Path) -> None:
    CLOUD.save(tmp_path / "a.ply")
    assert (tmp_path / "a.ply").read_bytes().startswith(b"ply")
    DEM.save(tmp_path / "a.uper")
    assert decode("ElevationMap", (tmp_path / "a.uper").read_bytes(), "uper") == DEM
    with pytest.raises(InputError, match=r"\.tif"):
        DEM.save(tmp_path / "a.ply")


def test_a_type_without_a_form_is_refused() -> None:
    for convert in (types.Time(0).to_xarray, types.Time(0).to_pandas, types.Time(0).to_open3d):
        with pytest.raises(InputError, match="a Time has no form"):
            convert()
