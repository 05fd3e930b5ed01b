# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff world`` shows, compares and exports the world of a log."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, EXIT_ERROR, main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_common.world import read_world
from cdff_dev.logs import LogWriter

S = 1_000_000_000
MOUNT = UncertainTransform.exact(se3.transform(np.eye(3), [0.0, 0.0, 1.5]))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A rover that drives 2 m along x in 2 s, with a cloud at each second."""
    path = tmp_path / "drive.msg"
    with LogWriter(path) as writer:
        for second in range(3):
            T = UncertainTransform(se3.transform(np.eye(3), [second, 0.0, 0.0]), np.eye(6) * 0.01)
            pose = TransformWithCovariance.from_transform(
                T, parent="site", child="mana/base", stamp_ns=second * S
            )
            writer.write("/mana/vo.pose", pose, second * S)
            points = np.arange(30.0).reshape(-1, 3)
            cloud = Pointcloud.from_points(
                points, frame="mana/lidar", stamp_ns=second * S, T_robot_sensor=MOUNT
            )
            writer.write("/mana/lidar.cloud", cloud, second * S)
    return path


def test_show_prints_frames_and_items(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "show", str(log), "--at", "+1.5"]) == EXIT_DONE
    out = capsys.readouterr().out
    assert "3 frames, 2 items" in out
    assert "mana/base: x 1.500, y 0.000, z 0.000 m, sigma 0.173 m (/mana/vo.pose)" in out
    assert "/mana/lidar.cloud  Pointcloud in mana/lidar, 0.500 s old: 10 points" in out


def test_show_prints_the_transform_between_two_frames(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "show", str(log), "--transform", "site", "mana/lidar"]) == EXIT_DONE
    assert "position: x 2.000, y 0.000, z 1.500 m" in capsys.readouterr().out
    assert main(["world", "show", str(log), "--transform", "site", "mana/lidar", "--json"]) == EXIT_DONE
    assert json.loads(capsys.readouterr().out)["T"][2][3] == 1.5


def test_diff_prints_the_motion(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "diff", str(log), "--at", "+0", "+2"]) == EXIT_DONE
    out = capsys.readouterr().out
    assert "moved: mana/base in site by 2.000 m, 0.00 degrees" in out
    assert "newer item: /mana/lidar.cloud" in out


def test_export_writes_a_file_that_shows_the_same(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "end.world"
    assert main(["world", "export", str(log), "--out", str(out)]) == EXIT_DONE
    assert read_world(out.read_bytes()).stamp_ns == 2 * S
    capsys.readouterr()
    assert main(["world", "show", str(out), "--type", "Pointcloud", "--json"]) == EXIT_DONE
    world_json = json.loads(capsys.readouterr().out)
    assert [item["name"] for item in world_json["items"]] == ["/mana/lidar.cloud"]
    assert main(["world", "show", str(out), "--at", "+1"]) == EXIT_ERROR
    assert "holds one time only" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show"], "name a log"),
        (["show", "LOG", "--at", "+x"], "expected \\+SECONDS"),
        (["show", "LOG", "--transform", "site", "moon"], "'moon' is unknown"),
        (["export", "LOG", "--out", "world.txt"], "expected one of .world, .glb, .gpkg"),
    ],
)
def test_wrong_arguments_are_reported(
    log: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    named = [str(log) if word == "LOG" else word for word in arguments]
    assert main(["world", *named]) == EXIT_ERROR
    assert re.search(message, capsys.readouterr().err)


def test_gltf_contains_frames_and_points_in_the_axes_of_the_root(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "end.glb"
    assert main(["world", "export", str(log), "--out", str(out)]) == EXIT_DONE
    data = out.read_bytes()
    magic, version, length, size = struct.unpack_from("<4sIII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    document = json.loads(data[20 : 20 + size])
    assert document["nodes"][0]["name"] == "site"
    lidar = next(node for node in document["nodes"] if node["name"] == "mana/lidar")
    assert lidar["matrix"][12:] == [2.0, 0.0, 1.5, 1.0]  # columns
    (mesh,) = document["meshes"]
    position = document["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]
    assert (position["count"], position["max"]) == (10, [27.0, 28.0, 29.0])
    start = 28 + size + document["bufferViews"][position["bufferView"]]["byteOffset"]
    points = np.frombuffer(data, "<f4", 30, start).reshape(-1, 3)
    np.testing.assert_array_equal(points, np.arange(30.0).reshape(-1, 3))


def test_geopackage_contains_positions_and_outlines(log: Path, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    out = tmp_path / "end.gpkg"
    assert main(["world", "export", str(log), "--out", str(out)]) == EXIT_DONE
    assert sorted(name for name, _ in pyogrio.list_layers(out)) == ["frames", "items"]
    meta, _, _, columns = pyogrio.raw.read(out, layer="frames")
    rows = dict(zip(columns[0], columns[2], strict=True))
    assert rows["mana/base"] == pytest.approx(np.sqrt(0.03))
    assert "site" in meta["crs"]
    bounds = pyogrio.read_info(out, layer="items")["total_bounds"]
    np.testing.assert_allclose(bounds, [2.0, 1.0, 29.0, 28.0])


def test_the_time_of_a_log_is_not_that_of_its_static_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "drive.msg"
    with LogWriter(path) as writer:
        for second in range(3):
            T = UncertainTransform(se3.transform(np.eye(3), [second, 0.0, 0.0]))
            moving = TransformWithCovariance.from_transform(
                T, parent="site", child="mana/base", stamp_ns=second * S
            )
            writer.write("/mana/vo.pose", moving, second * S)
        fixed = TransformWithCovariance.from_transform(
            MOUNT, parent="mana/base", child="mana/lidar", stamp_ns=900 * S
        )
        writer.write("/mana/tf_static.lidar", fixed, 900 * S)
    assert main(["world", "show", str(path)]) == EXIT_DONE
    out = capsys.readouterr().out
    assert "at 1970-01-01T00:00:02" in out
    assert "mana/base: x 2.000" in out
    assert "mana/lidar: x 0.000, y 0.000, z 1.500 m" in out
