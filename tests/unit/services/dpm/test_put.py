# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm put`` with a bus double that calls the DPM directly."""

import argparse
import io
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Request
from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError, StorageError
from cdff_common.formats.payload import to_file
from cdff_common.types import Mesh, PoseTrajectory
from dpm_store import Query
from services.dpm.bus import service
from services.dpm.cli.commands import register
from services.dpm.cli.put import put
from services.dpm.operations.dpm import Dpm
from services.dpm.rendering.convert import convert

from .conftest import S, cloud, elevation, navigation, pose

Put = Callable[..., dict[str, Any]]


@pytest.fixture
def run(dpm: Dpm) -> Put:
    """Return a function that runs ``cdff dpm put`` with the given arguments."""

    def call(
        key: str, parameters: dict[str, str], *, payload: bytes, encoding: str, attachment: bytes, **_: Any
    ) -> Any:
        return service.put(dpm, Request(key, parameters, payload, encoding, attachment))

    bus: Any = SimpleNamespace(call=call, mission_clock=dpm.clock)

    def run_put(*arguments: str) -> dict[str, Any]:
        parser = argparse.ArgumentParser()
        register(parser.add_subparsers())
        return put(bus, parser.parse_args(["dpm", "put", *arguments, "--robot", "mana"]))

    return run_put


def trajectory() -> PoseTrajectory:
    stamps_ns = np.array([2, 3, 4]) * S
    return PoseTrajectory.from_arrays(stamps_ns, [np.eye(4)] * 3, None, parent="site", child="mana/base")


@pytest.mark.parametrize(
    ("value", "suffix", "product"),
    [
        (cloud(), "ply", "pointcloud"),
        (cloud(), "laz", "pointcloud"),
        (elevation(1.0, 3.0), "tif", "dem"),
        (navigation(), "tif", "navigation_map"),
        (pose(3, 1.0), "json", "pose"),
        (trajectory(), "tum", "trajectory"),
    ],
)
def test_exported_files_can_be_inserted_again(
    run: Put, dpm: Dpm, tmp_path: Path, value: Any, suffix: str, product: str
) -> None:
    file = tmp_path / f"value.{suffix}"
    file.write_bytes(to_file(value, suffix))
    result = run(str(file), "--type", product)
    assert result["result"] == "inserted"
    record = dpm.store.get(result["id"])
    assert (record.product, record.header.frame, record.type_name) == (product, "site", type(value).__name__)
    assert record.header.box_m == pytest.approx(value.extent_m(), abs=1e-3)


def test_a_payload_is_inserted_unchanged_and_only_once(run: Put, dpm: Dpm, tmp_path: Path) -> None:
    file = tmp_path / "value.uper"
    file.write_bytes(encode(pose(3, 1.0), "uper"))
    first, repeated = run(str(file), "--type", "pose"), run(str(file), "--type", "pose")
    assert (first["result"], repeated["result"], first["id"]) == ("inserted", "already", repeated["id"])
    assert dpm.store.payload(first["id"]) == file.read_bytes()
    assert dpm.store.get(first["id"]).header.t1_ns == 3 * S


def test_an_image_is_returned_as_jpeg(run: Put, dpm: Dpm, tmp_path: Path) -> None:
    from PIL import Image

    file = tmp_path / "eye.png"
    Image.fromarray(np.full((8, 6), 200, np.uint8)).save(file)
    record = dpm.store.get(run(str(file), "--frame", "mana/eye")["id"])
    body = convert(record.type_name, record.codec, dpm.store.payload(record.id), "jpg", None, record.header)
    assert (body.encoding, body.suffix) == ("image/jpeg", "jpg")
    with Image.open(io.BytesIO(body.data)) as image:
        assert (image.format, image.size, image.getpixel((0, 0))) == ("JPEG", (6, 8), 200)


def test_a_file_without_a_time_gets_the_given_or_the_mission_time(run: Put, dpm: Dpm, tmp_path: Path) -> None:
    file = tmp_path / "cloud.ply"
    file.write_bytes(to_file(cloud(), "ply"))
    header = dpm.store.get(run(str(file), "--t", str(7 * S), "--frame", "mana/lidar")["id"]).header
    assert (header.t1_ns, header.frame) == (7 * S, "mana/lidar")
    assert dpm.store.get(run(str(file))["id"]).header.t1_ns == dpm.clock.now_ns()


def test_a_missing_or_unsuitable_file_is_refused_with_the_alternatives(
    run: Put, dpm: Dpm, tmp_path: Path
) -> None:
    file = tmp_path / "cloud.ply"
    with pytest.raises((InputError, StorageError), match=r"cloud\.ply"):
        run(str(file))
    file.write_bytes(b"no cloud")
    for options, message in (
        ([], "ply"),
        (["--type", "dem"], "tif"),
        (["--type", "nonsense"], "pointcloud"),
        (["--type", "track"], "track"),
    ):
        with pytest.raises(InputError, match=message):
            run(str(file), *options)
    assert not dpm.store.search(Query()).items


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply"])
def test_a_mesh_of_an_object_is_a_product_in_its_own_frame(
    run: Put, dpm: Dpm, tmp_path: Path, suffix: str
) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 200.0, 0.0], [0.0, 0.0, 300.0]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    path = tmp_path / f"Tool-1.{suffix}"
    if suffix == "obj":
        vertices, faces = io.StringIO(), io.StringIO()
        np.savetxt(vertices, corners, fmt="v %g %g %g")
        np.savetxt(faces, triangles + 1, fmt="f %d %d %d")
        path.write_text(vertices.getvalue() + faces.getvalue(), encoding="utf-8")
    elif suffix == "ply":
        path.write_bytes(to_file(Mesh.from_arrays(corners, triangles, frame="f", stamp_ns=0), "ply"))
    else:
        facets = np.zeros(4, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
        facets["corners"] = corners[triangles]
        path.write_bytes(bytes(80) + np.uint32(4).tobytes() + facets.tobytes())
    result = run(str(path), "--type", "mesh", "--unit", "mm")
    record = dpm.store.get(result["id"])
    assert (record.product, record.header.frame) == ("mesh", "mana/body")
    mesh = decode("Mesh", dpm.store.payload(record.id), "uper")
    np.testing.assert_allclose(np.ptp(np.asarray(mesh.data.vertices), axis=0), [0.1, 0.2, 0.3], rtol=1e-6)
