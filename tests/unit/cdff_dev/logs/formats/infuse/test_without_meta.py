# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""InFuse logs whose ``.meta`` follows the samples are read up to the end of a cut file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.codecs.dict_form import to_dict_form
from cdff_common.types import IMUSensors, Matrix3d, RigidBodyState, Time
from cdff_dev.logs import LogReader, open_log

T0_US = 1_530_195_436_000_000


def imu(k: int) -> IMUSensors:
    return IMUSensors(Time(T0_US + 10_000 * k), np.array([k, 0.0, 9.81]), np.zeros(3), np.ones(3))


def write(path: Path, streams: dict[str, list[Any]], cut: int = 0) -> None:
    """Write a log with ``.meta`` after the samples, and remove its last bytes."""
    content = {}
    for name, values in streams.items():
        content[name] = [to_dict_form(value) for value in values]
        meta = {"type": type(values[0]).ASN1_NAME, "timestamps": [T0_US + k for k in range(len(values))]}
        content[f"{name}.meta"] = meta
    data = msgpack.packb(content)
    path.write_bytes(data[: len(data) - cut])


@pytest.mark.parametrize(("cut", "count"), [(5, 20), (200, 20), (1000, 14)])
def test_a_cut_stream_has_the_type_of_its_fields_and_the_times_of_its_samples(
    tmp_path: Path, cut: int, count: int, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "imu.msg"
    write(path, {"/imu.samples": [imu(k) for k in range(20)]}, cut)
    with open_log(path) as log:
        samples = list(log.samples())
    assert {(s.stream, s.type_name) for s in samples} == {("/imu.samples", "IMUSensors")}
    assert [s.stamp_ns for s in samples] == [(T0_US + 10_000 * k) * 1000 for k in range(len(samples))]
    assert [s.value for s in samples] == [imu(k) for k in range(len(samples))]
    assert len(samples) == count
    assert f"ends at byte {path.stat().st_size}" in caplog.text
    assert "/imu.samples.meta is beyond the end of the file; read as IMUSensors" in caplog.text


def test_complete_streams_before_the_end_keep_their_stamps(tmp_path: Path) -> None:
    path = tmp_path / "log.msg"
    states = [RigidBodyState(Time(T0_US), "a", "b")] * 3
    write(path, {"/arm.state": states, "/imu.samples": [imu(k) for k in range(20)]}, 1000)
    with open_log(path) as log:
        assert [log.streams[name].count for name in ("/arm.state", "/imu.samples")] == [3, 14]
        assert log.stamps_ns("/arm.state").tolist() == [(T0_US + k) * 1000 for k in range(3)]


def test_a_cut_chunk_has_the_types_of_the_others(tmp_path: Path) -> None:
    for chunk, cut in enumerate((0, 300)):
        values = [Matrix3d(np.eye(3) * k) for k in range(5)] if chunk == 0 else [imu(0)] * 5
        write(tmp_path / f"run_{chunk}.msg", {f"/a.port{chunk}": values}, cut)
    write(tmp_path / "run_2.msg", {"/a.port1": [imu(k) for k in range(20)]})
    with open_log(tmp_path) as log:
        assert {name: info.type_name for name, info in log.streams.items()} == {
            "/a.port0": "Matrix3d",
            "/a.port1": "IMUSensors",
        }


def test_samples_without_a_type_or_time_are_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.msg"
    data = msgpack.packb({"/a.unknown": [{"speed": 1.0}] * 3, "/a.unknown.meta": {}})
    path.write_bytes(data[:-10])
    assert main(["log", "info", str(path)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("not converted")]
    assert line.split()[2:5] == ["/a.unknown", "unknown", "3"]
    assert "0 types have the fields speed" in line


def test_the_logs_of_the_robots_are_read_up_to_their_end(
    tmp_path: Path, real_data: Callable[[str], Path]
) -> None:
    data = (real_data("infuse_logs") / "xsens_imu_00.msg").read_bytes()
    with LogReader([real_data("infuse_logs") / "xsens_imu_00.msg"]) as log:
        whole_samples = list(log.samples())
    (tmp_path / "cut.msg").write_bytes(data[: len(data) // 2])
    with open_log(tmp_path / "cut.msg") as log:
        samples = list(log.samples())
    assert len(samples) > 40
    assert [s.value for s in samples] == [s.value for s in whole_samples[: len(samples)]]
