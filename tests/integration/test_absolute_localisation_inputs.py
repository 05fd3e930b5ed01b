# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orbital model comes as a GeoTIFF, or from the Data Product Manager; the same place is found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.codecs import encode
from cdff_common.codecs.siblings import wire_type
from cdff_common.formats.payload import to_file
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_fusion._interface import DemFusionInputs
from cdff_dev.evaluate._orbital import Drive, Ground
from dpm_store import Parcel, open_store
from dpm_store.windows import WindowQuery

SEED, DATUM_M = 2, 40.0


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@pytest.fixture(scope="module")
def drive(ground: Ground) -> Drive:
    return Drive.make(ground, SEED, 40.0)


@pytest.mark.req("CDFF-CORE-088")
def test_geotiffs_of_the_model_and_of_a_mapped_corridor_give_where_the_corridor_lies(
    ground: Ground, drive: Drive, tmp_path: Path
) -> None:
    files = {"orbital": ground.orbital(SEED, DATUM_M), "dem": pooled(ground, drive)}
    for name, value in files.items():
        (tmp_path / f"{name}.tif").write_bytes(to_file(value, "tif"))
    words = [f"{name}={tmp_path / name}.tif" for name in files]
    assert main(["run", "absolute_localisation", *words, "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "pose.json").read_text(encoding="utf-8"))
    middle = len(drive.believed) // 2
    moved, true = np.array(found["T"]) @ drive.believed[middle], drive.true[middle]
    assert found["child"].endswith("/map")
    assert np.hypot(*(moved - true)[:2, 3]) < 1.5  # the corridor itself bends by its drift
    assert abs(moved[2, 3] - true[2, 3] - DATUM_M) < 0.5


def test_a_model_that_the_data_product_manager_holds_in_pieces_leads_to_the_same_fix(
    ground: Ground, drive: Drive, tmp_path: Path
) -> None:
    whole = ground.orbital(SEED, DATUM_M)
    with open_store(f"sqlite:///{tmp_path}") as store:
        store.put_all([parcel(piece, i) for i, piece in enumerate(quarters(whole))])
        held = store.maps.elevation_window(WindowQuery(resolution_m=whole.geometry.resolution_m)).map
    np.testing.assert_allclose(fix(ground, drive, held), fix(ground, drive, whole), atol=1e-4)


def pooled(ground: Ground, drive: Drive) -> ElevationMap:
    """All patches of the drive in one map."""
    node = Registry.default().make_dfn("dem_fusion")
    node.configure({"size_m": 80.0})
    made = None
    for sample in drive.samples(ground, SEED):
        if sample.port == "dem":
            made = node.process(DemFusionInputs(patch=sample.value)).map
    assert made is not None
    return made


def fix(ground: Ground, drive: Drive, orbital: ElevationMap) -> np.ndarray:
    node = Registry.default().make_dfpc("absolute_localisation")
    node.configure({}, DfpcContext("mana"))
    list(node.step(Sample("orbital", 0, 0, orbital)))
    outputs = [output for sample in drive.samples(ground, SEED) for output in node.step(sample)]
    true = drive.true[outputs[0].t1_ns // 10_000_000_000 - 1]
    assert np.hypot(*(outputs[0].value.transform.matrix - true)[:2, 3]) < 1.5
    return np.asarray(outputs[0].value.transform.matrix)


def quarters(whole: ElevationMap) -> list[ElevationMap]:
    g, made = whole.geometry, []
    for row in (slice(0, g.rows // 2), slice(g.rows // 2, g.rows)):
        for col in (slice(0, g.cols // 2), slice(g.cols // 2, g.cols)):
            geometry = GridGeometry.from_cells(
                g.frame, g.resolution_m, left=g.left + col.start, top=g.top - row.start, rows=row.stop - row.start,
                cols=col.stop - col.start,
            )  # fmt: skip
            made.append(measured(geometry, np.ascontiguousarray(whole.layer("mean")[row, col]), whole.t1_ns))
    return made


def measured(geometry: GridGeometry, z: np.ndarray, t_ns: int) -> ElevationMap:
    """Heights with all layers that the Data Product Manager pools by."""
    layers = {"mean": z, "min": z, "max": z, "variance": np.full_like(z, 0.15**2), "count": np.ones_like(z)}
    return ElevationMap.from_layers(geometry, {**layers, "age_s": np.zeros_like(z)}, t0_ns=t_ns, t1_ns=t_ns)


def parcel(value: ElevationMap, seq: int) -> Parcel:
    header = Header(
        id=product_id("orbiter", "survey", "dem", 0, seq, ""), seq=seq, t0_ns=value.t0_ns, t1_ns=value.t1_ns,
        frame=value.frame, producer="survey", config_hash="", box_m=value.extent_m(),
    )  # fmt: skip
    return Parcel(header, encode(value, "uper"), "orbiter", "survey", "dem", "dem", wire_type(value), "uper", value)
