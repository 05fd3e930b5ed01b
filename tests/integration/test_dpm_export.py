# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Other programs read the exports of the DPM: GDAL, laspy, Open3D, GTSAM; poses are in evo's format."""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import ELEVATION_LAYERS, GridGeometry
from cdff_common.types import (
    ElevationMap,
    NavigationMap,
    Pointcloud,
    PoseGraph,
    PoseTrajectory,
    TransformWithCovariance,
)
from services.dpm.cli.commands import register

from .conftest import Eventually, Spawn
from .test_dpm import System

pytestmark = pytest.mark.integration

S = 1_000_000_000


@pytest.fixture
def system(spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path) -> Iterator[System]:
    """A DPM with a product of every type."""
    system = System(spawn, eventually, endpoint, tmp_path)
    fill(system)
    yield system
    system.bus.close()


def fill(system: System) -> None:
    for seq, x0 in enumerate((0.0, 20.0), 1):
        geometry = GridGeometry("site", 0.1, x0, 30.0, 300, 300)
        layers = {name: np.full(geometry.shape, float(seq), np.float32) for name in ELEVATION_LAYERS}
        layers["mean"][:10] = np.nan
        value = ElevationMap.from_layers(geometry, layers, t0_ns=seq * S, t1_ns=seq * S)
        system.put(value, "dem", seq, box_m=value.extent_m(), resolution_m=0.1)
    classes = np.ones((10, 10), np.uint8)
    classes[:, 5:] = 3
    nav = NavigationMap.from_layers(
        GridGeometry("site", 0.5, 0.0, 5.0, 10, 10), {"class": classes}, t0_ns=0, t1_ns=S
    )
    system.put(nav, "navigation_map", 1, box_m=nav.extent_m())
    rng = np.random.default_rng(0)
    for seq in (1, 2):
        cloud = Pointcloud.from_points(rng.uniform(0, 10, (3000, 3)), frame="site", stamp_ns=seq * S)
        system.put(cloud, "pointcloud", seq, box_m=cloud.extent_m())
    for seq in (1, 2, 3):
        T = UncertainTransform(se3.exp_se3([float(seq), 0.0, 0.0, 0.0, 0.0, 0.1 * seq]))
        pose = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=seq * S)
        system.put(pose, "pose", seq, child="mana/base", box_m=pose.extent_m())
    matrices = se3.exp_se3(np.array([[float(i), 1.0, 0.5, 0.0, 0.0, 0.0] for i in range(4)]))
    path = PoseTrajectory.from_arrays(np.arange(1, 5) * S, matrices, None, parent="site", child="minnie/base")
    system.put(path, "trajectory", 4, robot="minnie", child="minnie/base", box_m=path.extent_m())
    ends = np.array([[0, 1], [1, 2], [2, 3]])
    edges = se3.inverse(matrices[:3]) @ matrices[1:]
    graph = PoseGraph.from_arrays(
        np.arange(4),
        np.arange(4) * S,
        matrices,
        ends,
        edges,
        np.tile(np.eye(6) * 4.0, (3, 1, 1)),
        [0, 0, 1],
        frame="site",
    )
    system.put(graph, "pose_graph", 4, box_m=graph.extent_m())


def export(endpoint: str, capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, object]]:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["dpm", "export", *arguments, "--connect", endpoint, "--json"])
    assert args.run(args) == 0
    files: list[dict[str, object]] = json.loads(capsys.readouterr().out)["files"]
    return files


@pytest.mark.req("CDFF-SUP-183")
@pytest.mark.slow
def test_exports_are_read_by_other_programs(
    system: System, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()

    export(endpoint, capsys, str(out / "dem.tif"), "--region", "bbox:0,0,50,30", "--resolution-m", "0.2")
    import rasterio

    with rasterio.open(out / "dem.tif") as file:
        assert file.descriptions == ELEVATION_LAYERS
        assert np.isnan(file.nodata)
        assert (file.tags()["AREA_OR_POINT"], file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"]) == ("Area", "COG")
        assert not file.crs.is_geographic
        assert "Site on mars" in file.crs.to_wkt()
        assert (file.res, tuple(file.bounds)) == ((0.2, 0.2), (0.0, 0.0, 50.0, 30.0))
        mean = file.read(1)
        assert np.isnan(mean[:5]).all()
        assert (mean[10, 10], mean[10, 125], mean[10, 240]) == (1.0, np.float32(5 / 3), 2.0)

    export(endpoint, capsys, str(out / "wide.tif"), "--region", "bbox:0,0,50,30")
    with rasterio.open(out / "wide.tif") as file:
        assert file.overviews(1)
        coarse = file.read(1, out_shape=(150, 250))
        assert set(np.unique(coarse[np.isfinite(coarse)])) <= {
            1.0,
            np.float32(5 / 3),
            2.0,
        }  # an overview contains only values of the map

    import laspy
    import open3d

    for suffix in ("laz", "las", "ply", "pcd"):
        export(
            endpoint,
            capsys,
            str(out / f"cloud.{suffix}"),
            "--region",
            "box:0,0,0,10,10,5",
            "--points",
            "1000",
        )
        if suffix.startswith("la"):
            points = laspy.read(out / f"cloud.{suffix}").xyz
        else:
            points = np.asarray(open3d.io.read_point_cloud(str(out / f"cloud.{suffix}")).points)
        assert len(points) == 1000
        assert points[:, 2].max() <= 5.001

    export(endpoint, capsys, str(out / "path.tum"), "--type", "pose", "--robot", "mana")
    table = np.loadtxt(out / "path.tum")
    assert table.shape == (3, 8)
    np.testing.assert_allclose(table[:, 0], [1.0, 2.0, 3.0])


@pytest.mark.slow
def test_an_exported_pose_graph_is_read_by_gtsam(
    system: System, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gtsam = pytest.importorskip("gtsam", reason="peers are installed by make evaluate")
    export(endpoint, capsys, str(tmp_path / "graph.g2o"))
    factors, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    assert (factors.size(), values.size()) == (3, 4)
    np.testing.assert_allclose(values.atPose3(3).translation(), [3.0, 1.0, 0.5], atol=1e-9)


def test_an_export_folder_contains_each_product_and_all_outlines(
    system: System, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = export(endpoint, capsys, str(tmp_path / "all"))
    suffixes = sorted(Path(str(f["file"])).suffix for f in files)
    assert suffixes == sorted(
        [".tif", ".tif", ".tif", ".ply", ".ply", ".json", ".json", ".json", ".tum", ".g2o", ".geojson"]
    )
    pyogrio = pytest.importorskip("pyogrio")
    info = pyogrio.read_info(tmp_path / "all" / "index_site.geojson")
    assert (info["features"], info["geometry_type"]) == (10, "Polygon")
    assert "Site on mars" in info["crs"]
    assert {"id", "product", "robot", "frame", "file"} <= set(info["fields"])

    export(
        endpoint, capsys, str(tmp_path / "nav"), "--type", "navigation_map,trajectory", "--format", "geojson"
    )
    shapes = {}
    for path in (tmp_path / "nav").glob("[nt]*.geojson"):
        shapes[pyogrio.read_info(path)["geometry_type"]] = pyogrio.read_info(path)["features"]
    assert shapes == {"Polygon": 2, "LineString Z": 1}


@pytest.mark.slow
def test_products_that_cannot_be_exported_are_reported(
    system: System, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ProductNotFoundError, match="nothing to export"):
        export(endpoint, capsys, str(tmp_path / "x"), "--robot", "nobody")
    with pytest.raises(InputError, match="a laz file holds a pointcloud"):
        export(endpoint, capsys, str(tmp_path / "x.laz"), "--type", "dem")
    with pytest.raises(InputError, match="a tum file holds one"):
        export(endpoint, capsys, str(tmp_path / "x.tum"))
    with pytest.raises(InputError, match="expected a folder, or a file of"):
        export(endpoint, capsys, str(tmp_path / "x.docx"))


def test_profiles_and_clouds_are_retrieved_over_zenoh(system: System) -> None:
    profile = system.call("profile", robot="any", path="1.05,1.05,25.05,1.05", step_m=0.5).body()
    assert (profile["mean_m"][0], profile["mean_m"][-1], profile["coverage"]) == (
        1.0,
        pytest.approx(5 / 3),
        1.0,
    )
    reply = system.call("get", robot="any", type="pointcloud", points=500, region="circle:5,5,3")
    assert (reply.attachment["points"], reply.attachment["kind"]) == (500, "product")
    assert system.get("/api/v1/maps/dem/profile?path=1,1,2,2")["coverage"] == 1.0


@pytest.mark.slow
def test_gdal_reads_the_tiles_as_a_map_in_the_frame_of_the_site(system: System, tmp_path: Path) -> None:
    import rasterio
    from rasterio.windows import from_bounds

    address = f"WMTS:{system.http}/tiles/wmts.xml,layer=hillshade,tilematrixset=grid,tilematrix=17"
    with rasterio.Env(GDAL_DEFAULT_WMS_CACHE_PATH=str(tmp_path)), rasterio.open(address) as file:
        assert "Site on mars" in file.crs.to_wkt()
        assert file.res == pytest.approx((0.1, 0.1))
        rgba = file.read(window=from_bounds(0.0, 0.0, 50.0, 30.0, file.transform))
    is_opaque = rgba[3] > 0
    assert not is_opaque[:10].any()
    assert is_opaque[10:].all()
