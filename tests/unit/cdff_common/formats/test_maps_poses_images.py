# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps, images, poses and arrays as files: round trips, and errors for malformed files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError, StorageError
from cdff_common.formats import geotiff
from cdff_common.formats.format_detection import detect
from cdff_common.formats.geotiff import DEM_BANDS, read_bands, read_map, write_bands, write_map
from cdff_common.formats.hillshade import classes_png, hillshade_png
from cdff_common.formats.image import read_image, write_png
from cdff_common.formats.npz import read_npz, write_npz
from cdff_common.formats.payload import FORMATS, to_file
from cdff_common.formats.pose import PoseValue, read_pose
from cdff_common.formats.tum import read_tum, write_tum
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import (
    BodyMotion,
    BundleProblem,
    CorrespondenceMap2D,
    ElevationMap,
    Frame,
    GroundAreas,
    Mesh,
    NavigationMap,
    ObjectTrack,
    Pointcloud,
    PoseGraph,
    PoseTrajectory,
    TransformWithCovariance,
    VisualMap,
)
from cdff_common.types.visual_map_ext import KeyframePoints


@pytest.fixture
def dem(rng: np.random.Generator) -> ElevationMap:
    geometry = GridGeometry("mana/odom", 0.05, -1.0, 2.0, 30, 40)
    layers = {name: rng.normal(size=(30, 40)).astype(np.float32) for name in DEM_BANDS}
    layers["mean"][3, 4] = np.nan
    return ElevationMap.from_layers(geometry, layers, t0_ns=1_000, t1_ns=2_000_000)


@pytest.fixture
def pose() -> TransformWithCovariance:
    T = UncertainTransform(se3.exp_se3([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), np.diag([1.0, 2, 3, 4, 5, 6]))
    return TransformWithCovariance.from_transform(
        T, parent="site", child="mana/base", stamp_ns=1_700_000_000_123_456_000
    )


def test_an_elevation_map_survives_a_geotiff_round_trip(dem: ElevationMap) -> None:
    data = write_map(dem)
    reread = read_map(data)
    assert detect(data) == "tif"
    assert (reread.geometry, reread.t0_ns, reread.t1_ns) == (dem.geometry, dem.t0_ns, dem.t1_ns)
    for name in DEM_BANDS:
        np.testing.assert_array_equal(reread.layer(name), dem.layer(name))


def test_the_geotiff_has_the_bands_of_the_contract(dem: ElevationMap) -> None:
    from rasterio.io import MemoryFile

    with MemoryFile(write_map(dem)) as memory, memory.open() as file:
        assert file.descriptions == DEM_BANDS
        assert set(file.dtypes) == {"float32"}
        assert np.isnan(file.nodata)
        assert file.tags()["AREA_OR_POINT"] == "Area"
        assert (file.bounds.left, file.bounds.top) == (-1.0, 2.0)
        assert file.res == (0.05, 0.05)
        assert "mana/odom" in file.crs.to_wkt()


def test_a_navigation_map_keeps_its_classes_through_float_bands() -> None:
    geometry = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)
    classes = (np.arange(100) % 4).astype(np.uint8).reshape(10, 10)
    layers = {"class": classes, "cost": np.full((10, 10), np.nan, np.float32)}
    value = NavigationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)
    reread = read_map(write_map(value), "NavigationMap")
    assert reread.layer("class").dtype == np.uint8
    np.testing.assert_array_equal(reread.layer("class"), classes)
    assert read_image(classes_png(value)).shape == (10, 10, 4)
    with pytest.raises(CodecError, match="NavigationMap"):
        read_map(write_map(value), "ElevationMap")


def test_a_navigation_map_as_geojson_has_each_area_with_its_holes_kind_and_size() -> None:
    classes = np.array([[3, 3, 3, 0], [3, 1, 3, 0], [3, 3, 3, 2]], np.uint8)
    value = NavigationMap.from_layers(
        GridGeometry("site", 0.5, 10.0, 1.5, 3, 4), {"class": classes}, t0_ns=0, t1_ns=0
    )
    document = json.loads(to_file(value, "geojson"))
    assert document["cdff"] == {"frame": "site", "unit": "m"}
    areas = {f["properties"]["name"]: (f["properties"], f["geometry"]) for f in document["features"]}
    assert {name: (p["class"], p["area_m2"]) for name, (p, _) in areas.items()} == {
        "safe": (1, 0.25),
        "caution": (2, 0.25),
        "hazard": (3, 2.0),
    }
    outer, hole = areas["hazard"][1]["coordinates"]
    assert sorted(map(tuple, outer[1:])) == [(10.0, 0.0), (10.0, 1.5), (11.5, 0.0), (11.5, 1.5)]
    assert outer[0] == outer[-1]
    assert sorted(map(tuple, hole[1:])) == [(10.5, 0.5), (10.5, 1.0), (11.0, 0.5), (11.0, 1.0)]


def test_a_single_band_raster_becomes_the_mean_layer_of_an_elevation_map() -> None:
    heights = np.arange(6, dtype=np.float32).reshape(2, 3)
    data = write_bands({"height": heights}, GridGeometry("site", 2.0, 10.0, 20.0, 2, 3))
    reread = read_map(data, frame="mars")
    assert reread.geometry == GridGeometry("mars", 2.0, 10.0, 20.0, 2, 3)
    np.testing.assert_array_equal(reread.layer("mean"), heights)


def test_a_float_image_without_georeference_keeps_its_nan_pixels() -> None:
    disparity = np.array([[1.5, np.nan], [2.25, 3.0]], np.float32)
    bands, _, _ = read_bands(write_bands({"disparity": disparity}))
    np.testing.assert_array_equal(bands["disparity"], disparity)


def test_a_hillshade_is_transparent_in_unobserved_cells(dem: ElevationMap) -> None:
    image = read_image(hillshade_png(dem))
    assert image.shape == (30, 40, 4)
    assert image[3, 4, 3] == 0


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_survive_a_round_trip_pixel_for_pixel(rng: np.random.Generator, dtype: type) -> None:
    grey = rng.integers(0, np.iinfo(dtype).max, (7, 5)).astype(dtype)
    pixels = grey.astype(">u2" if dtype is np.uint16 else np.uint8).tobytes()
    pgm = f"P5\n5 7\n{np.iinfo(dtype).max}\n".encode() + pixels
    for data, fmt in ((write_png(grey), "png"), (pgm, "pgm")):
        assert detect(data) == fmt
        np.testing.assert_array_equal(read_image(data), grey)
    rgb = rng.integers(0, 255, (7, 5, 3)).astype(np.uint8)
    for data, fmt in ((write_png(rgb), "png"), (b"P6\n5 7\n255\n" + rgb.tobytes(), "ppm")):
        assert detect(data) == fmt
        np.testing.assert_array_equal(read_image(data), rgb)


def test_errors_of_corrupt_images_and_rasters_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "cut.png"
    path.write_bytes(write_png(np.zeros((50, 50), np.uint8))[:60])
    with pytest.raises(CodecError, match=r"cut\.png"):
        read_image(path)
    with pytest.raises(CodecError, match="raster"):
        read_bands(b"II*\x00" + bytes(30))
    with pytest.raises(CodecError, match="npz"):
        read_npz(b"PK\x03\x04" + bytes(30))
    with pytest.raises(CodecError, match="pixels"):
        read_image(b"P5 100000 100000 65535\n" + bytes(10))


def test_a_tum_trajectory_keeps_microseconds_of_the_unix_epoch() -> None:
    stamps = np.array([1_700_000_000_123_456_000, 1_700_000_000_223_457_000])
    T = se3.exp_se3(np.array([[0.1, 0.2, 0.3, 0.0, 0.0, 3.0], [1, 2, 3, 0.3, 0.2, 0.1]]))
    data = write_tum(stamps, T)
    back_stamps, reread = read_tum(data)
    np.testing.assert_array_equal(back_stamps, stamps)
    np.testing.assert_allclose(reread, T, atol=1e-8)
    with pytest.raises(CodecError, match="line 1"):
        read_tum(b"1.0 2 3\n")


def test_a_pose_is_read_from_json_text_and_a_one_line_tum_file(
    tmp_path: Path, pose: TransformWithCovariance
) -> None:
    T = pose.transform.matrix
    rows = "\n".join(" ".join(f"{v:.12g}" for v in row) for row in T)
    for data, fmt in (
        (to_file(pose, "json"), "json"),
        (rows.encode(), "pose_txt"),
        (to_file(pose, "tum"), "tum"),
    ):
        assert detect(data) == fmt
        np.testing.assert_allclose(read_pose(data).T.matrix, T, atol=1e-8)
    read = read_pose(to_file(pose, "json"))
    assert (read.parent, read.child, read.stamp_ns) == ("site", "mana/base", pose.stamp_ns)
    np.testing.assert_allclose(read.T.covariance, pose.transform.covariance)
    document = {"outputs": {}, "value": PoseValue(pose.transform).to_json()}
    assert np.allclose(read_pose(json.dumps(document).encode()).T.matrix, T)


@pytest.mark.parametrize(
    "text", ["1 2 3", "2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1", "{}", '{"T": [[1]]}', "0 0 0 0 0 0 0 0"]
)
def test_an_invalid_pose_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        read_pose(text.encode())


def test_equal_arrays_give_npz_files_with_equal_bytes(rng: np.random.Generator) -> None:
    arrays = {"a": rng.normal(size=(3, 4)), "b": np.array("text")}
    data = write_npz(arrays)
    assert data == write_npz(arrays)
    np.testing.assert_array_equal(read_npz(data)["a"], arrays["a"])


def test_every_type_can_be_written_in_each_of_its_formats(
    dem: ElevationMap, pose: TransformWithCovariance
) -> None:
    nav = {"class": np.zeros((30, 40), np.uint8)}
    T = np.eye(4)[None]
    graph = PoseGraph.from_arrays(
        [0], [0], T, np.zeros((0, 2)), np.zeros((0, 4, 4)), np.zeros((0, 6, 6)), [], frame="site"
    )
    keyframe = KeyframePoints(np.ones((2, 3)), np.ones(2), np.ones((2, 4), np.uint8))
    values = [
        dem,
        pose,
        NavigationMap.from_layers(dem.geometry, nav, t0_ns=0, t1_ns=0),
        Pointcloud.from_points(
            np.ones((5, 3)), frame="site", stamp_ns=0, intensity=np.arange(5, dtype=np.int32)
        ),
        PoseTrajectory.from_arrays(np.array([1000]), T, None, parent="site", child="mana/base"),
        Frame.from_image(np.zeros((4, 6), np.uint8), stamp_ns=0),
        graph,
        VisualMap.from_parts(graph, [keyframe], sensor="mana/navcam", stamp_ns=0, descriptor_type="ORB"),
        CorrespondenceMap2D.from_arrays([[1, 2]], [[3, 4]]),
        BundleProblem.from_arrays(
            T, [9.0, 9.0, 0.0, 0.0], [[0, 0, 1]], ([0], [0]), [[0.0, 0.0]], frame="site"
        ),
        GroundAreas.from_rings([3], [1], [3], [[0, 0], [1, 0], [0, 1]], frame="site", t0_ns=0, t1_ns=0),
        ObjectTrack.from_arrays(1, [1000], T, frame="site"),
        BodyMotion(),
        Mesh.from_arrays(np.eye(3), np.array([[0, 1, 2]]), frame="client/body", stamp_ns=0),
    ]
    assert {type(v).__name__ for v in values} == set(FORMATS)
    for value in values:
        for fmt in FORMATS[type(value).__name__]:
            assert to_file(value, fmt)
        with pytest.raises(InputError, match="expected one of"):
            to_file(value, "docx")


@pytest.mark.parametrize("cloud_optimized", [True, False])
def test_large_rasters_are_written_with_files_and_equal_those_in_memory(
    monkeypatch: pytest.MonkeyPatch, cloud_optimized: bool
) -> None:
    bands = {"mean": np.random.default_rng(0).normal(size=(600, 700)).astype(np.float32)}
    grid = GridGeometry("site", 0.1, 0.0, 60.0, 600, 700)
    in_memory = write_bands(bands, grid, cloud_optimized=cloud_optimized)
    monkeypatch.setattr(geotiff, "_IN_MEMORY_BYTES", 0)
    from_file = write_bands(bands, grid, cloud_optimized=cloud_optimized)
    assert len(from_file) == pytest.approx(len(in_memory), rel=0.01)
    assert (b"LAYOUT=IFDS_BEFORE_DATA" in from_file) is cloud_optimized
    np.testing.assert_array_equal(read_bands(from_file)[0]["mean"], bands["mean"])
    monkeypatch.setattr("tempfile.tempdir", "/nonexistent")
    with pytest.raises(StorageError, match="GeoTIFF of 600 x 700 cells"):
        write_bands(bands, grid)
