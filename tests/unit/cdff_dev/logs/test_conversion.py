# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff log convert``, ``diff`` and ``export`` on real recordings."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common import types
from cdff_common.cli import EXIT_USAGE, main
from cdff_common.formats.tum import read_tum
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.source import recorded_header

RealData = Callable[[str], Path]
KITTI = "kitti_stereo/KITTI_sequence_1"


def _errors(*words: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["log", *words]) != 0
    return capsys.readouterr().err


@pytest.mark.parametrize("target", ["run.bag", "run.mcap", "foxglove.mcap", "foxglove-json.mcap"])
@pytest.mark.parametrize(
    ("source", "streams", "duration_s"),
    [
        (KITTI, ["/kitti/navcam.pair", "/kitti/truth.pose"], 0.3),
        ("kitti_velodyne", ["/robot/lidar.scan"], 0.2),
        ("euroc_v101_pairs", ["/euroc/navcam.pair", "/euroc/truth.pose"], 3.0),
        ("rosbags/husky_first_150s.bag", None, 0.5),
        ("infuse_logs/dynamixel_0.msg", None, 2.0),
    ],
)
def test_converted_recordings_are_equal(
    real_data: RealData,
    tmp_path: Path,
    source: str,
    streams: list[str] | None,
    duration_s: float,
    target: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    part, out = tmp_path / "part.msg", tmp_path / target
    span = ["--duration", str(duration_s)]
    assert main(["log", "convert", str(real_data(source)), str(part), *span]) == 0
    schemas = ["--schemas", out.stem] if out.stem.startswith("foxglove") else []
    assert main(["log", "convert", str(real_data(source)), str(out), *span, *schemas, "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [loss for loss in report["losses"] if loss["loss"] != "header.frame"] == []
    assert schemas or report["losses"] == []
    assert streams is None or sorted(report["written"]) == streams
    assert main(["log", "diff", str(part), str(out), "--rounding"]) == 0


@pytest.mark.parametrize(("schemas", "encoding"), [("foxglove", "protobuf"), ("foxglove-json", "jsonschema")])
def test_foxglove_schemas_are_those_of_their_types_and_only_of_mcap_files(
    schemas: str, encoding: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mcap.reader import make_reader

    with LogWriter(tmp_path / "run.msg") as writer:
        joints = types.Joints(types.Time(1), ("elbow",), (types.JointState(0.5, 0.1, 2.0, np.nan, np.nan),))
        header = recorded_header("/mana/arm.joints", 0, 1000, frame="mana/arm")
        writer.write("/mana/arm.joints", joints, 1000, header)
        writer.write("/mana/imu.sample", types.IMUSensors(types.Time(1)), 1000)
    log, out = str(tmp_path / "run.msg"), tmp_path / "run.mcap"
    assert main(["log", "convert", log, str(out), "--schemas", schemas]) == 0
    assert capsys.readouterr().err.splitlines() == [
        "not held: /mana/arm.joints: header.frame (1 samples)",
        "as sensor_msgs/msg/Imu: /mana/imu.sample (1 samples): Foxglove has no schema for it",
    ]
    with out.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert sorted((s.name, s.encoding) for s in summary.schemas.values()) == [
        ("foxglove.JointStates", encoding),
        ("sensor_msgs/msg/Imu", "ros2msg"),
        ("std_msgs/msg/String", "ros2msg"),
    ]
    assert main(["log", "diff", log, str(out)]) == 0
    for name in ("run.bag", "folder", "other.msg"):
        words = ("convert", log, str(tmp_path / name), "--schemas", schemas)
        assert "expected NAME.mcap" in _errors(*words, capsys=capsys)


def test_content_that_a_bag_cannot_hold_is_listed(
    real_data: RealData, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = real_data("infuse_logs/xsens_imu_00.msg")
    assert main(["log", "convert", str(source), str(tmp_path / "run.bag"), "--json"]) == 0
    output = capsys.readouterr()
    losses = {(item["loss"], item["count"]) for item in json.loads(output.out)["losses"]}
    assert ("mag", 100) in losses
    assert "mag (100 samples)" in output.err


def test_streams_are_renamed_by_the_map(real_data: RealData, tmp_path: Path) -> None:
    chosen = tmp_path / "map.yaml"
    chosen.write_text(
        "streams:\n  /kitti/truth.pose: {to: /mana/reference.pose}\nframes:\n  kitti/vo: site\n",
        encoding="utf-8",
    )
    words = ["--map", str(chosen), "--streams", "/kitti/truth.pose", "--start", "1", "--duration", "0.5"]
    assert main(["log", "convert", str(real_data(KITTI)), str(tmp_path / "run.msg"), *words]) == 0
    with open_log(tmp_path / "run.msg") as log:
        samples = list(log.samples())
    assert [s.stamp_ns for s in samples] == [k * 100_000_000 for k in range(10, 15)]
    assert {(s.stream, s.value.parent_frame) for s in samples} == {("/mana/reference.pose", "site")}
    assert samples[0].header is not None
    assert samples[0].header.frame == "site"


def test_wrong_maps_and_targets_are_refused(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = tmp_path / "map.yaml"
    for text, expected in (
        ("topics: {}", "expected a mapping with streams, frames and anchors"),
        ("streams: {/a/b.c: {to: /x}}", "stream /a/b.c is not in the log"),
        ("streams: {/mana/arm.pose: /x}", "expected to, and optionally message"),
        ("streams: {/mana/arm.pose: {to: /imu}}", "topic /imu of several streams"),
    ):
        chosen.write_text(text, encoding="utf-8")
        assert expected in _errors(
            "convert", str(log), str(tmp_path / "x.bag"), "--map", str(chosen), capsys=capsys
        )
    assert "no writer for .xyz" in _errors("convert", str(log), str(tmp_path / "x.xyz"), capsys=capsys)
    assert "would replace the log" in _errors("convert", str(log), str(log), capsys=capsys)
    assert "--start" in _errors("convert", str(log), str(tmp_path / "x.bag"), "--start", "-1", capsys=capsys)
    assert main(["log", "convert", str(log)]) == EXIT_USAGE
    assert not list(tmp_path.glob("x.*"))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A pose and an IMU sample a second; the third IMU sample is missing."""
    path = tmp_path / "run.msg"
    with LogWriter(path) as writer:
        for i in range(6):
            stamp_ns = i * 1_000_000_000
            value = types.IMUSensors(types.Time.from_ns(stamp_ns), np.array([i, 0.0, 9.8]))
            state = types.RigidBodyState(types.Time.from_ns(stamp_ns), "arm", "base", np.array([i, 0.0, 0.0]))
            if i != 2:
                writer.write("/mana/imu.imu", value, stamp_ns)
            writer.write("/mana/arm.pose", state, stamp_ns)
    return path


def test_info_prints_a_map_that_convert_takes(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["log", "info", str(log), "--map"]) == 0
    chosen = tmp_path / "map.yaml"
    chosen.write_text(capsys.readouterr().out, encoding="utf-8")
    assert "/mana/imu.imu: {to: /imu}" in chosen.read_text(encoding="utf-8")
    target = tmp_path / "mapped.mcap"
    assert main(["log", "convert", str(log), str(target), "--map", str(chosen)]) == 0
    assert main(["log", "diff", str(log), str(target), "--rounding"]) == 0


def test_diff_names_streams_counts_and_the_first_different_value(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.msg"
    with open_log(log) as source, LogWriter(other) as writer:
        for sample in source.samples(["/mana/arm.pose"]):
            value = sample.value
            if sample.seq == 3:
                value = types.RigidBodyState(value.timestamp, "arm", "base", np.array([9.0, 0.0, 0.0]))
            if sample.seq < 5:
                writer.write(sample.stream, value, sample.stamp_ns)
    capsys.readouterr()
    assert main(["log", "diff", str(log), str(other), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["differences"] == [
        "/mana/imu.imu: only in the first log",
        "/mana/arm.pose: 6 and 5 samples",
        "/mana/arm.pose: first different value at 1970-01-01T00:00:03.000000Z: pos",
    ]
    assert main(["log", "diff", str(log), str(log)]) == 0


def test_streams_are_exported(log: Path, real_data: RealData, tmp_path: Path) -> None:
    assert main(["log", "export", str(log), "/mana/arm.pose", "--out", str(tmp_path / "arm.tum")]) == 0
    stamps_ns, T = read_tum(tmp_path / "arm.tum")
    np.testing.assert_array_equal(stamps_ns, np.arange(6) * 1_000_000_000)
    np.testing.assert_allclose(T[:, 0, 3], np.arange(6))
    assert main(["log", "export", str(log), "/mana/imu.imu", "--out", str(tmp_path / "imu.csv")]) == 0
    rows = (tmp_path / "imu.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("stamp_ns,timestamp.microseconds,")
    assert rows[2].split(",")[0] == "1000000000"
    scans = tmp_path / "scans.ply"
    source = real_data("kitti_velodyne")
    assert main(["log", "export", str(source), "/robot/lidar.scan", "--out", str(scans)]) == 0
    with open_log(source) as original, open_log(scans) as exported:
        pairs = list(zip(original.samples(), exported.samples(), strict=True))
    assert len(pairs) == 5
    assert all(a.value == b.value and a.stamp_ns == b.stamp_ns for a, b in pairs)


def test_unsuitable_exports_are_refused(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = _errors("export", str(log), "/mana/imu.imu", "--out", str(tmp_path / "x.tum"), capsys=capsys)
    assert "not a format of IMUSensors" in text
    text = _errors("export", str(log), "/mana/none.x", "--out", str(tmp_path / "x.csv"), capsys=capsys)
    assert "expected one of" in text


@pytest.mark.parametrize("target", ["run.msg", "run.bag"])
def test_info_is_equal_for_all_formats(
    log: Path, tmp_path: Path, target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["log", "convert", str(log), str(tmp_path / target)]) == 0 if target != log.name else True
    capsys.readouterr()
    assert main(["log", "info", str(tmp_path / target), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    imu = content["streams"]["/mana/imu.imu"]
    assert (imu["type"], imu["count"], imu["t0_ns"], imu["t1_ns"]) == ("IMUSensors", 5, "0", "5000000000")
    assert imu["rate_hz"] == pytest.approx(1.0)
    assert imu["duration_s"] == pytest.approx(5.0)
    assert content["bytes"] == (tmp_path / target).stat().st_size
