# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/ogc/collections/dem/coverage`` in degrees: extent, bands, values at known places, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from fastapi.testclient import TestClient
from rasterio.io import MemoryFile

from cdff_common.geodesy import Anchor, body
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from services.dpm.operations.dpm import Dpm
from tests.support.dpm_products import S, put_arguments

COVERAGE = "/ogc/collections/dem/coverage"


@pytest.fixture
def anchor(dpm: Dpm) -> Anchor:
    """A site on Mars that is turned by 30 degrees; the height of a cell is 10 x + y of its centre."""
    anchor = Anchor(body("mars"), 77.45, 18.44, azimuth_deg=30.0)
    dpm.store.anchors.anchor("site", anchor)
    geometry = GridGeometry("site", 0.1, 0.0, 4.0, 40, 60)
    x = 0.05 + 0.1 * np.arange(60)
    y = 3.95 - 0.1 * np.arange(40)
    mean = (10.0 * x[None, :] + y[:, None]).astype(np.float32)
    zero = np.zeros_like(mean)
    layers = {
        "mean": mean,
        "variance": zero + 0.01,
        "min": mean,
        "max": mean,
        "count": zero + 1,
        "age_s": zero,
    }
    value = ElevationMap.from_layers(geometry, layers, t0_ns=S, t1_ns=S)
    dpm.writer.put(*put_arguments(value, "dem", 1, resolution_m=0.1, box_m=(0.0, 0.0, 0.0, 6.0, 4.0, 64.0)))
    return anchor


def grid_of(http: TestClient) -> dict[str, dict[str, float]]:
    """Return the axes of the coverage by their labels."""
    grid = http.get(f"{COVERAGE}/domainset").json()["generalGrid"]
    assert grid["axisLabels"] == ["Lon", "Lat"]
    return {axis["axisLabel"]: axis for axis in grid["axis"]}


def test_the_values_of_a_coverage_are_those_at_its_longitudes_and_latitudes(
    http: TestClient, anchor: Anchor
) -> None:
    axes = grid_of(http)
    lon, lat = axes["Lon"], axes["Lat"]
    assert lat["resolution"] == pytest.approx(np.degrees(0.1 / 3_396_190.0), rel=1e-3)
    subset = (
        f"Lon({lon['lowerBound']!r}:{lon['upperBound']!r}),Lat({lat['lowerBound']!r}:{lat['upperBound']!r})"
    )
    answer = http.get(COVERAGE, params={"subset": subset, "scaleSize": "Lon(70),Lat(50)"})
    assert answer.status_code == 200, answer.text
    with MemoryFile(answer.content) as memory, memory.open() as file:
        assert (file.width, file.height, file.count) == (70, 50, 6)
        assert "Mars" in file.crs.to_wkt()
        heights, transform = file.read(1), file.transform
    assert 0.3 < np.isfinite(heights).mean() < 0.9  # the corners of the box are outside the turned map
    rows, cols = np.nonzero(np.isfinite(heights))
    lons = transform.c + (cols + 0.5) * transform.a
    lats = transform.f + (rows + 0.5) * transform.e
    points = anchor.points(np.column_stack([lons, lats]))
    np.testing.assert_allclose(heights[rows, cols], 10.0 * points[:, 0] + points[:, 1], atol=0.56)


def test_a_coverage_of_few_cells_is_made_of_larger_cells(http: TestClient, anchor: Anchor) -> None:
    axes = grid_of(http)
    box = [axes[name][end] for end in ("lowerBound", "upperBound") for name in ("Lon", "Lat")]
    bbox = ",".join(map(repr, box))
    answer = http.get(COVERAGE, params={"bbox": bbox, "scaleSize": "Lon(7),Lat(5)"})
    with MemoryFile(answer.content) as memory, memory.open() as file:
        heights, counts = file.read(1), file.read(5)
    assert np.nanmax(counts) > 20
    assert np.nanmin(heights) < 20
    assert np.nanmax(heights) > 40


def test_a_coverage_without_measurements_has_no_values(http: TestClient, anchor: Anchor) -> None:
    subset = "Lon(77.46:77.4601),Lat(18.45:18.4501)"
    answer = http.get(COVERAGE, params={"subset": subset, "scaleSize": "Lon(4),Lat(3)"})
    assert answer.status_code == 200
    with MemoryFile(answer.content) as memory, memory.open() as file:
        assert not np.isfinite(file.read()).any()


def test_the_bands_are_listed_and_the_collection_links_them(http: TestClient, anchor: Anchor) -> None:
    fields = http.get(f"{COVERAGE}/rangetype").json()["field"]
    assert [field["name"] for field in fields] == ["mean", "variance", "min", "max", "count", "age_s"]
    links = http.get("/ogc/collections/dem", params={"f": "json"}).json()["links"]
    related = {link["rel"].rsplit("/", 1)[-1] for link in links}
    assert {"coverage", "coverage-domainset", "coverage-rangetype"} <= related


@pytest.mark.parametrize(
    "query",
    [
        {"scaleSize": "Lon(4),Lat(3)"},
        {"scaleSize": "Lon(4)", "bbox": "77,18,78,19"},
        {"scaleSize": "Lon(0),Lat(3)", "bbox": "77,18,78,19"},
        {"scaleSize": "Lon(9999999),Lat(9999999)", "bbox": "77,18,78,19"},
        {"scaleSize": "Lon(4),Lat(3)", "bbox": "78,18,77,19"},
        {"scaleSize": "Lon(4),Lat(3)", "bbox": "nan,18,77,19"},
        {"scaleSize": "Lon(4),Lat(3)", "subset": "Lon(1.2.3:4),Lat(1:2)"},
        {"scaleSize": "Lon(4),Lat(3)", "subset": "Lon(1:4),Lon(1:2)"},
        {"scaleSize": "Lon(4),Lat(3)", "subset": "(" * 150},
        {"subset": "Lon(77:78),Lat(18:19)"},
        {"scaleSize": "Lon(4),Lat(3)", "subset": "Lon(77:78),Lat(18:19)", "bbox": "77,18,78,19"},
    ],
)
def test_unusable_grids_are_refused(http: TestClient, anchor: Anchor, query: dict[str, str]) -> None:
    answer = http.get(COVERAGE, params=query)
    assert answer.status_code in (400, 422)
    assert answer.json()["detail"]
    assert any(name in answer.json()["detail"] for name in query) or "bbox" in answer.json()["detail"]


def test_frames_and_collections_without_coverages_are_not_found(http: TestClient, anchor: Anchor) -> None:
    for path in ("/ogc/collections/navigation_map/coverage/domainset", f"{COVERAGE}/domainset?frame=lost"):
        assert http.get(path).status_code == 404
