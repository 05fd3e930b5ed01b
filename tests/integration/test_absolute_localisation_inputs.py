# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Absolute localisation gives the same position with an orbital model from a GeoTIFF or from the DPM."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.cli import main
from cdff_common.codecs import encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.formats.geotiff import write_bands
from cdff_common.formats.payload import to_file
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion.interface import DemFusionInputs
from dpm_store import NewProduct, open_store
from dpm_store.maps.windows import WindowQuery
from evaluation.scenes.orbital import Ground, PatchRun

SEED, DATUM_M = 2, 40.0


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@pytest.fixture(scope="module")
def drive(ground: Ground) -> PatchRun:
    return PatchRun.make(ground, SEED, 40.0)


@pytest.mark.req("CDFF-CORE-088")
def test_geotiffs_of_an_orbital_model_and_a_rover_map_give_the_position_of_the_rover_map(
    ground: Ground, drive: PatchRun, tmp_path: Path
) -> None:
    files = {"orbital": ground.orbital(SEED, DATUM_M), "dem": fused_map(ground, drive)}
    for name, value in files.items():
        (tmp_path / f"{name}.tif").write_bytes(to_file(value, "tif"))
    inputs = [f"{name}={tmp_path / name}.tif" for name in files]
    assert main(["run", "absolute_localisation", *inputs, "--out", str(tmp_path / "out")]) == 0
    document = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
    middle = len(drive.estimated_poses) // 2
    T_corrected, T_true = np.array(document["T"]) @ drive.estimated_poses[middle], drive.true_poses[middle]
    assert document["child"].endswith("/map")
    assert np.hypot(*(T_corrected - T_true)[:2, 3]) < 1.5  # odometry drift deforms the rover map
    assert abs(T_corrected[2, 3] - T_true[2, 3] - DATUM_M) < 0.5


@pytest.mark.parametrize("cell_m", [0.5, 30.0])
def test_plain_geotiffs_of_one_band_are_localised_by_the_names_of_the_contract(
    tmp_path: Path, cell_m: float
) -> None:
    rng = np.random.default_rng(0)
    z = cell_m * gaussian_filter(rng.normal(0.0, 20.0, (120, 120)), 4.0)
    band = {"height": z.astype(np.float32)}
    corner = (round(5.13e5 / cell_m) * cell_m, round(5.4e6 / cell_m) * cell_m)
    whole_geometry = GridGeometry("site", cell_m, *corner, 120, 120)
    (tmp_path / "orbital.tif").write_bytes(write_bands(band, whole_geometry))
    part = {"height": band["height"][30:80, 40:90]}
    # The rover map lies 3 columns and 5 rows off its true place.
    wrong = GridGeometry("site", cell_m, corner[0] + 37 * cell_m, corner[1] - 25 * cell_m, 50, 50)
    (tmp_path / "rover.tif").write_bytes(write_bands(part, wrong))
    inputs = [f"orbital_map={tmp_path}/orbital.tif", f"rover_map={tmp_path}/rover.tif"]
    assert main(["run", "absolute_localisation", *inputs, "--out", str(tmp_path / "out")]) == 0
    pose = json.loads((tmp_path / "out" / "outputs.json").read_text(encoding="utf-8"))["outputs"]["pose"]
    np.testing.assert_allclose(pose["value"]["shift_cells"], [40.0, 30.0], atol=0.02)
    T = np.array(pose["value"]["T"])
    centre = np.array([corner[0] + 62 * cell_m, corner[1] - 50 * cell_m, 0.0, 1.0])
    np.testing.assert_allclose((T @ centre - centre)[:2] / cell_m, [3.0, -5.0], atol=0.02)


@pytest.mark.parametrize(("orbital_cell_m", "rover_cell_m"), [(10.0, 10.0), (10.0, 15.0), (15.0, 10.0)])
def test_geotiffs_with_any_edges_and_the_coarser_one_on_either_port_are_localised(
    tmp_path: Path, orbital_cell_m: float, rover_cell_m: float
) -> None:
    shift_m = np.array([23.7, -31.2])
    relief = 10.0 * gaussian_filter(np.random.default_rng(0).normal(0.0, 20.0, (300, 300)), 6.0)

    def write(name: str, cell_m: float, offset_m: np.ndarray, size_m: float, moved_m: np.ndarray) -> None:
        """Write heights around the middle of the ground; edges are not multiples of the cell."""
        corner = np.array([513_003.3, 5_400_004.7]) + offset_m * [1.0, -1.0]
        n = round(size_m / cell_m)
        row, col = (np.indices((n, n)) + 0.5) * cell_m
        at = np.stack([offset_m[1] + row, offset_m[0] + col]) / 10.0 - 0.5
        profile = {"driver": "GTiff", "count": 1, "height": n, "width": n, "dtype": "float32"}
        transform = rasterio.Affine(cell_m, 0, corner[0] + moved_m[0], 0, -cell_m, corner[1] + moved_m[1])
        with rasterio.open(tmp_path / name, "w", transform=transform, crs="EPSG:32633", **profile) as file:
            file.write(map_coordinates(relief, at, order=3).astype(np.float32), 1)

    write("orbital.tif", orbital_cell_m, np.zeros(2), 3000.0, np.zeros(2))
    write("rover.tif", rover_cell_m, np.array([1000.0, 1100.0]), 750.0, -shift_m)
    inputs = [f"orbital_map={tmp_path}/orbital.tif", f"rover_map={tmp_path}/rover.tif"]
    assert main(["run", "absolute_localisation", *inputs, "--out", str(tmp_path / "out")]) == 0
    pose = json.loads((tmp_path / "out" / "outputs.json").read_text(encoding="utf-8"))["outputs"]["pose"]
    T = np.array(pose["value"]["T"])
    centre = np.array([514_378.3, 5_398_529.7, 0.0, 1.0])
    error_m = (T @ (centre - [*shift_m, 0.0, 0.0]) - centre)[:2]
    assert np.abs(error_m).max() < 0.1 * max(orbital_cell_m, rover_cell_m)


def test_a_port_given_by_two_of_its_names_is_refused(tmp_path: Path) -> None:
    inputs = ["dem=a.tif", "rover_map=b.tif", "orbital=c.tif"]
    assert main(["run", "absolute_localisation", *inputs, "--out", str(tmp_path / "out")]) == 1


def test_an_orbital_model_stored_in_tiles_gives_the_same_fix(
    ground: Ground, drive: PatchRun, tmp_path: Path
) -> None:
    orbital_map = ground.orbital(SEED, DATUM_M)
    with open_store(f"sqlite:///{tmp_path}") as store:
        store.put_all([parcel(piece, i) for i, piece in enumerate(quarters(orbital_map))])
        stored_map = store.maps.elevation_window(
            WindowQuery(resolution_m=orbital_map.geometry.resolution_m)
        ).map
    np.testing.assert_allclose(fix(ground, drive, stored_map), fix(ground, drive, orbital_map), atol=1e-4)


def fused_map(ground: Ground, drive: PatchRun) -> ElevationMap:
    """Fuse all patches of the drive into one map."""
    node = Registry.default().make_dfn("dem_fusion")
    node.configure({"size_m": 80.0})
    result = None
    for sample in drive.samples(ground, SEED):
        if sample.port == "dem":
            result = node.process(DemFusionInputs(patch=sample.value)).map
    assert result is not None
    return result


def fix(ground: Ground, drive: PatchRun, orbital: ElevationMap) -> np.ndarray:
    node = Registry.default().make_dfpc("absolute_localisation")
    node.configure({}, DfpcContext("mana"))
    list(node.step(Sample("orbital", 0, 0, orbital)))
    outputs = [output for sample in drive.samples(ground, SEED) for output in node.step(sample)]
    T_true = drive.true_poses[outputs[0].t1_ns // 10_000_000_000 - 1]
    assert np.hypot(*(outputs[0].value.transform.matrix - T_true)[:2, 3]) < 1.5
    return np.asarray(outputs[0].value.transform.matrix)


def quarters(orbital_map: ElevationMap) -> list[ElevationMap]:
    g, result = orbital_map.geometry, []
    for row in (slice(0, g.rows // 2), slice(g.rows // 2, g.rows)):
        for col in (slice(0, g.cols // 2), slice(g.cols // 2, g.cols)):
            geometry = GridGeometry.from_cells(
                g.frame,
                g.resolution_m,
                left=g.left + col.start,
                top=g.top - row.start,
                rows=row.stop - row.start,
                cols=col.stop - col.start,
            )
            result.append(
                elevation_map(
                    geometry, np.ascontiguousarray(orbital_map.layer("mean")[row, col]), orbital_map.t1_ns
                )
            )
    return result


def elevation_map(geometry: GridGeometry, z: np.ndarray, t_ns: int) -> ElevationMap:
    """Return a map with all layers that the DPM needs to fuse maps."""
    layers = {"mean": z, "min": z, "max": z, "variance": np.full_like(z, 0.15**2), "count": np.ones_like(z)}
    return ElevationMap.from_layers(geometry, {**layers, "age_s": np.zeros_like(z)}, t0_ns=t_ns, t1_ns=t_ns)


def parcel(value: ElevationMap, seq: int) -> NewProduct:
    header = Header(
        id=product_id("orbiter", "survey", "dem", 0, seq, ""),
        seq=seq,
        t0_ns=value.t0_ns,
        t1_ns=value.t1_ns,
        frame=value.frame,
        producer="survey",
        config_hash="",
        box_m=value.extent_m(),
    )
    return NewProduct(
        header, encode(value, "uper"), "orbiter", "survey", "dem", "dem", wire_type(value), "uper", value
    )
