# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_common.formats.geotiff import write_map
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.compare.elevation import compare, read_dem
from cdff_dev.logs import LogWriter


def relief(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(x / 2.1) * np.cos(y / 1.7) + 0.05 * x


def elevation_map(
    geometry: GridGeometry,
    *,
    dx: float = 0.0,
    dy: float = 0.0,
    up: float = 0.0,
    noise: np.ndarray | float = 0.0,
    sigma: float = 0.02,
) -> ElevationMap:
    x, y = geometry.centres_m()
    z = (relief(x - dx, y - dy) + up + noise).astype(np.float32)
    layers = {"mean": z, "variance": np.full_like(z, sigma**2), "count": np.ones_like(z)}
    return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


TRUE = elevation_map(GridGeometry.aligned("site", 0.05, (-12.0, -12.0, 12.0, 12.0)))
GRID = GridGeometry.aligned("site", 0.1, (-10.0, -8.0, 10.0, 8.0))


def test_the_true_terrain_has_no_error() -> None:
    results = compare(elevation_map(GRID), TRUE)
    assert results["cells"] == GRID.rows * GRID.cols
    assert results["completeness"] == 1.0
    assert results["rmse_m"] < 5e-4
    np.testing.assert_allclose(results["shift_m"], 0.0, atol=1e-3)


def test_noise_of_the_stated_sigma_has_90_percent_interval_coverage(rng: np.random.Generator) -> None:
    results = compare(elevation_map(GRID, up=0.003, noise=rng.normal(0, 0.02, GRID.shape)), TRUE)
    assert results["within_90_percent"] == pytest.approx(0.9, abs=0.01)
    assert results["rmse_m"] == pytest.approx(0.0202, rel=0.03)
    assert results["nmad_m"] == pytest.approx(0.02, rel=0.03)
    assert results["le90_m"] == pytest.approx(0.0331, rel=0.04)
    assert results["bias_m"] == pytest.approx(0.003, abs=0.0005)
    assert results["chi2_per_cell"] == pytest.approx(1.0, abs=0.1)


def test_cells_of_unknown_interval_are_counted_separately(rng: np.random.Generator) -> None:
    noisy = elevation_map(GRID, noise=rng.normal(0, 0.02, GRID.shape))
    layers = {name: noisy.layer(name) for name in noisy.layer_names}
    layers["error_variance"] = noisy.layer("variance").copy()
    layers["error_variance"][:40] = np.nan
    results = compare(ElevationMap.from_layers(GRID, layers, t0_ns=0, t1_ns=0), TRUE)
    assert (results["interval_of"], results["cells_without_interval"]) == ("error_variance", 40 * GRID.cols)
    assert results["within_90_percent"] == pytest.approx(0.9, abs=0.01)


def test_a_displaced_map_has_its_shift_estimated_and_no_error_after_alignment() -> None:
    shifted = elevation_map(GRID, dx=0.12, dy=-0.07, up=0.05)
    results = compare(shifted, TRUE)
    np.testing.assert_allclose(results["shift_m"], [-0.12, 0.07, -0.05], atol=2e-3)
    assert results["rmse_m"] > 0.045
    assert compare(shifted, TRUE, remove_shift=True)["rmse_m"] < 2e-3


def test_unobserved_and_sparsely_measured_cells_count_as_missing() -> None:
    complete = elevation_map(GRID)
    layers = {name: complete.layer(name).copy() for name in complete.layer_names}
    layers["mean"][40:80] = np.nan
    layers["count"][80:120] = 3
    dem = ElevationMap.from_layers(GRID, layers, t0_ns=0, t1_ns=0)
    assert compare(dem, TRUE)["completeness"] == pytest.approx(0.75)
    assert compare(dem, TRUE, least_count=2)["cells"] == 40 * GRID.cols


def test_larger_cells_are_compared_with_the_mean_of_the_reference() -> None:
    coarse = GridGeometry.aligned("site", 1.0, (-10.0, -8.0, 10.0, 8.0))
    x, y = TRUE.geometry.centres_m()
    row, col, inside = coarse.cells_of(x.ravel(), y.ravel())
    sums = np.zeros(coarse.shape)
    np.add.at(sums, (row[inside], col[inside]), TRUE.layer("mean").ravel()[inside])
    dem = ElevationMap.from_layers(coarse, {"mean": (sums / 400).astype(np.float32)}, t0_ns=0, t1_ns=0)
    assert compare(dem, TRUE)["rmse_m"] < 1e-6


@pytest.mark.parametrize("true_cell_m", [0.15, 0.2, 0.5])
def test_smaller_cells_are_compared_with_the_interpolated_reference(true_cell_m: float) -> None:
    coarse_truth = elevation_map(GridGeometry.aligned("site", true_cell_m, (-12.0, -12.0, 12.0, 12.0)))
    results = compare(elevation_map(GRID), coarse_truth)
    assert results["rmse_m"] < 0.01
    np.testing.assert_allclose(results["shift_m"], 0.0, atol=5e-3)


def test_maps_in_different_frames_or_without_overlap_are_refused() -> None:
    with pytest.raises(InputError, match="expected one frame"):
        compare(elevation_map(GridGeometry.aligned("mana/odom", 0.1, (0, 0, 1, 1))), TRUE)
    with pytest.raises(InputError, match="overlap"):
        compare(elevation_map(GridGeometry.aligned("site", 0.1, (50, 50, 51, 51))), TRUE)


def test_maps_are_read_from_rasters_and_logs(tmp_path: Path) -> None:
    (tmp_path / "map.tif").write_bytes(write_map(elevation_map(GRID)))
    with LogWriter(tmp_path / "truth.msg") as writer:
        writer.write("/site/truth.terrain", TRUE, 0)
    assert read_dem(str(tmp_path / "map.tif")).geometry == GRID
    assert read_dem(str(tmp_path / "truth.msg")).geometry == TRUE.geometry
    with pytest.raises(InputError, match="no elevation maps in"):
        read_dem(str(tmp_path / "truth.msg"), "/x/y")
    with pytest.raises(InputError, match="no such file"):
        read_dem(str(tmp_path / "no.tif"))


def test_the_command_prints_the_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, dem in (("map", elevation_map(GRID, up=0.01)), ("truth", TRUE)):
        (tmp_path / f"{name}.tif").write_bytes(write_map(dem))
    files = [str(tmp_path / "map.tif"), str(tmp_path / "truth.tif")]
    assert main(["eval", "dem", *files, "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert results["bias_m"] == pytest.approx(0.01, abs=1e-3)
    assert main(["eval", "dem", *files]) == 0
    assert "completeness" in capsys.readouterr().out
    assert main(["eval", "dem", files[0], str(tmp_path / "none.tif")]) == 1


@pytest.mark.slow
def test_the_command_draws_both_maps_and_the_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "map.tif").write_bytes(write_map(elevation_map(GRID, up=0.25)))
    (tmp_path / "truth.tif").write_bytes(write_map(TRUE))
    plot = tmp_path / "errors.svg"
    command = ["eval", "dem", str(tmp_path / "map.tif"), str(tmp_path / "truth.tif"), "--plot"]
    assert main([*command, str(plot)]) == 0
    assert "bias" in capsys.readouterr().out
    text = plot.read_text()
    assert text.startswith("<svg")
    for label in ("map - truth, m", "true terrain", "LE90 0.250 m"):
        assert label in text
    assert main([*command, str(tmp_path / "errors.gif")]) == 1
    assert "expected .png or .svg" in capsys.readouterr().err
