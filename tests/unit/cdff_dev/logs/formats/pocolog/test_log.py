# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files, ports and stamps of pocolog files as logs; the files are written by a test writer."""

from __future__ import annotations

import json
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import CodecError, InputError
from cdff_dev.logs import LogWriter, open_log
from tests.support import pocolog_files as rock

IMU = rock.Compound(
    "/base/samples/IMUSensors_m",
    {"time": rock.TIME, "acc": rock.VECTOR3, "gyro": rock.VECTOR3, "mag": rock.VECTOR3},
)
T0_US = 1_600_000_000_000_000


def imu(microseconds: int, acc: float = 9.81) -> dict[str, Any]:
    vectors = {"acc": {"data": [0.0, 0.0, acc]}, "gyro": {"data": [0.1] * 3}, "mag": {"data": [0.0] * 3}}
    return {"time": rock.time(microseconds), **vectors}


def write_imu(path: Path, times: list[int], name: str = "/xsens.samples", order: str = "<") -> Path:
    writer = rock.PocologWriter(order)
    writer.declare(0, name, IMU)
    for k, microseconds in enumerate(times):
        writer.sample(0, IMU, imu(microseconds, k), T0_US + k)
    path.write_bytes(writer.data)
    return path


@pytest.mark.req("CDFF-DEV-023")
def test_a_log_is_converted_into_the_intermediate_format(tmp_path: Path) -> None:
    with closing(open_log(write_imu(tmp_path / "imu.0.log", [T0_US + 10, T0_US + 20]))) as log:
        samples = list(log.samples())
        with LogWriter(tmp_path / "imu.msg") as writer:
            for s in samples:
                writer.write(s.stream, s.value, s.stamp_ns, s.header)
    with closing(open_log(tmp_path / "imu.msg")) as copy:
        assert [(s.stream, s.stamp_ns, s.value) for s in copy.samples()] == [
            (s.stream, s.stamp_ns, s.value) for s in samples
        ]


def test_stamps_are_own_times_and_without_them_logical_times(tmp_path: Path) -> None:
    with closing(open_log(write_imu(tmp_path / "imu.0.log", [T0_US + 7, 0]))) as log:
        stamps = [s.stamp_ns for s in log.samples()]
    assert stamps == [(T0_US + 1) * 1000, (T0_US + 7) * 1000]


def test_numbered_files_are_one_recording_in_numerical_order(tmp_path: Path) -> None:
    for n in (0, 2, 10):
        write_imu(tmp_path / f"imu.{n}.log", [T0_US + n])
    (tmp_path / "imu.0.idx").write_bytes(b"POCOSIM_INDEX")
    for location in (tmp_path, tmp_path / "imu.*.log"):
        with closing(open_log(location)) as log:
            samples = list(log.samples())
        assert {s.stream for s in samples} == {"/robot/xsens.samples"}
        assert [(s.seq, s.stamp_ns // 1000 - T0_US) for s in samples] == [(0, 0), (1, 2), (2, 10)]


def test_equal_ports_of_several_recordings_have_the_name_of_their_recording(tmp_path: Path) -> None:
    for name in ("front", "rear"):
        write_imu(tmp_path / f"{name}.0.log", [T0_US])
    with closing(open_log(tmp_path)) as log:
        assert list(log.streams) == ["/robot/front_xsens.samples", "/robot/rear_xsens.samples"]


def test_big_endian_and_compressed_samples_are_read(tmp_path: Path) -> None:
    path = tmp_path / "imu.0.log"
    writer = rock.PocologWriter(">")
    writer.declare(0, "/imu.samples", IMU)
    writer.sample(0, IMU, imu(T0_US, 1.0))
    writer.sample(0, IMU, imu(T0_US + 1, 2.0), compress=True)
    path.write_bytes(writer.data)
    with closing(open_log(path)) as log:
        samples = list(log.samples())
    assert [s.value.acc[2] for s in samples] == [1.0, 2.0]
    assert [s.stamp_ns for s in samples] == [T0_US * 1000, T0_US * 1000 + 1000]


def test_elements_of_vectors_are_samples(tmp_path: Path) -> None:
    vectors = rock.Vector(IMU)
    writer = rock.PocologWriter()
    writer.declare(0, "/imu.batches", vectors)
    writer.sample(0, vectors, [imu(T0_US), imu(T0_US + 5, 1.0)])
    writer.sample(0, vectors, [])
    writer.sample(0, vectors, [imu(T0_US + 9, 2.0)])
    (tmp_path / "imu.0.log").write_bytes(writer.data)
    with closing(open_log(tmp_path)) as log:
        samples = list(log.samples())
    assert [(s.stamp_ns // 1000 - T0_US, s.value.acc[2]) for s in samples] == [(0, 9.81), (5, 1.0), (9, 2.0)]


def test_content_without_conversion_is_listed(tmp_path: Path) -> None:
    wrench = rock.Compound(
        "/base/samples/Wrench_m",
        {"force": rock.VECTOR3, "torque": rock.VECTOR3, "time": rock.TIME, "frame_id": rock.String()},
    )
    sonar = rock.Compound("/base/samples/Sonar", {"time": rock.TIME, "bins": rock.Vector(rock.FLOAT)})
    writer = rock.PocologWriter()
    for stream, (name, kind) in enumerate(
        {"/arm.wrench": wrench, "/sonar.beams": sonar, "/a.n": rock.INT}.items()
    ):
        writer.declare(stream, name, kind)
    force = {"data": [1.0, 2.0, 3.0]}
    writer.sample(0, wrench, {"force": force, "torque": force, "time": rock.time(T0_US), "frame_id": "tool"})
    writer.sample(1, sonar, {"time": rock.time(T0_US), "bins": [1.0]})
    writer.sample(2, rock.INT, 1)
    writer.raw(9, b"lost")
    writer.block(3, 0, b"control")
    (tmp_path / "arm.log").write_bytes(writer.data)
    with closing(open_log(tmp_path)) as log:
        assert list(log.streams) == ["/robot/arm.wrench"]
        assert {name: (u.type_name, u.count) for name, u in log.unconverted.items()} == {
            "/arm.wrench: field frame_id": ("/base/samples/Wrench_m", 1),
            "/sonar.beams": ("/base/samples/Sonar", 1),
            "/a.n": ("/int32_t", 1),
            "arm.log: streams without declaration": ("unknown", 1),
            "arm.log: control streams": ("control block", 1),
        }


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("kind", "value", "shown"),
    [
        (rock.SONAR, rock.SONAR_VALUE, "bins: <"),
        (rock.SONAR_BEAM, rock.SONAR_BEAM_VALUE, "bearing: {rad: 0.5}"),
        (rock.SONAR_SCAN, rock.SONAR_SCAN_VALUE, "number_of_bins: 50"),
        (rock.SPLINE, rock.SPLINE_VALUE, "kind: 'POLYNOMIAL_BSPLINE'"),
        (rock.TRAJECTORY, rock.TRAJECTORY_VALUE, "spline: {geometric_resolution: 0.125"),
        (rock.Vector(rock.TRAJECTORY), [rock.TRAJECTORY_VALUE], "[{speed: 0.5"),
    ],
)
def test_types_without_one_of_cdff_are_decoded_and_printed(
    tmp_path: Path, kind: Any, value: Any, shown: str, order: str, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = rock.PocologWriter(order)
    writer.declare(0, "/task.port", kind)
    writer.sample(0, kind, value, T0_US)
    writer.sample(0, kind, value, T0_US, compress=True)
    writer.declare(1, "/xsens.samples", IMU)
    writer.sample(1, IMU, imu(T0_US + 5))
    path = tmp_path / "task.0.log"
    path.write_bytes(writer.data)
    assert main(["log", "info", "--deep", str(path)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("not converted")]
    assert line.startswith(f"not converted: /task.port  {kind.name} ")
    assert line.endswith("; cdff log cat prints it")
    assert main(["log", "cat", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines] == ["/task.port", "/task.port", "/robot/xsens.samples"]
    assert shown in lines[0]
    assert main(["log", "cat", str(path), "--stream", "/task.port", "--json"]) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    expected = json.loads(json.dumps(value).replace("NaN", "null"))
    assert first["value"] == second["value"] == expected
    assert (first["type"], first["stamp_ns"]) == (kind.name, str(T0_US * 1000))


def test_fields_without_one_of_cdff_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kind = rock.Compound("/base/samples/Pressure", {"pascal": rock.FLOAT, "depth": rock.FLOAT})
    writer = rock.PocologWriter()
    writer.declare(0, "/water.pressure", kind)
    writer.sample(0, kind, {"pascal": 1000.0, "depth": 0.25}, T0_US)
    (tmp_path / "water.0.log").write_bytes(writer.data)
    assert main(["log", "cat", str(tmp_path)]) == 0
    sample, field = capsys.readouterr().out.splitlines()
    assert field.endswith("/water.pressure: field depth #0 0.25")
    assert "pascals=1000.0" in sample


def test_damaged_samples_without_a_type_of_cdff_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = rock.PocologWriter()
    writer.declare(0, "/task.port", rock.SONAR_BEAM)
    writer.raw(0, b"short", T0_US)
    path = tmp_path / "task.0.log"
    path.write_bytes(writer.data)
    assert main(["log", "cat", str(path)]) == 1
    assert "task.0.log: /task.port sample at byte" in capsys.readouterr().err


def test_a_truncated_file_gives_what_is_readable_and_where_it_ends(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_imu(tmp_path / "imu.0.log", [T0_US, T0_US + 1, T0_US + 2])
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[:-10])
    with closing(open_log(path)) as log:
        assert len(list(log.samples())) == 2
        fault = log.unconverted["imu.0.log"].reason
    sample = 8 + 21 + 80
    assert (
        f"damaged at byte {size - sample} of {size - 10}: block of 101 bytes, expected at most the 91"
        in fault
    )
    assert [str(path) in record.getMessage() for record in caplog.records] == [True]


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (struct.pack("<BBHI", 7, 0, 0, 0), "block of type 7, expected 1"),
        (struct.pack("<BBHI", 2, 0, 0, 5) + bytes(5), "sample of 5 bytes, expected a header of 21"),
        (struct.pack("<BBHI", 2, 0, 0, 21) + bytes(16) + b"\x09" + bytes(4), "sample of 9 bytes, expected 0"),
        (struct.pack("<BBHI", 1, 0, 0, 5) + b"\x01\xff\xff\xff\xff", "text of 4294967295 bytes"),
        (struct.pack("<BBHI", 1, 0, 0, 1) + b"\x05", "declaration of kind"),
        (b"\x02", "1 bytes, expected a block header of 8"),
    ],
)
def test_damaged_blocks_end_the_file(tmp_path: Path, damage: bytes, expected: str) -> None:
    path = write_imu(tmp_path / "imu.0.log", [T0_US])
    path.write_bytes(path.read_bytes() + damage)
    with closing(open_log(path)) as log:
        assert log.streams["/robot/xsens.samples"].count == 1
        assert expected in log.unconverted["imu.0.log"].reason


def test_other_versions_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "old.0.log"
    path.write_bytes(b"POCOSIM\0" + struct.pack("<II", 1, 0))
    with pytest.raises(CodecError, match=r"old\.0\.log: pocolog version 1, expected 2"):
        open_log(path)


def test_a_sample_that_is_not_of_its_type_names_file_and_byte(tmp_path: Path) -> None:
    writer = rock.PocologWriter()
    writer.declare(0, "/imu.samples", IMU)
    at = len(writer.data) + 8 + 21
    writer.raw(0, bytes(79))
    (tmp_path / "imu.0.log").write_bytes(writer.data)
    with closing(open_log(tmp_path)) as log, pytest.raises(CodecError) as error:
        list(log.samples())
    assert "imu.0.log" in str(error.value)
    assert f"/imu.samples sample at byte {at}: " in str(error.value)
    assert "79 bytes at byte 0, expected 80" in str(error.value)


def test_the_length_of_a_large_log_does_not_need_memory_for_its_samples(tmp_path: Path) -> None:
    import tracemalloc

    path = tmp_path / "camera.0.log"
    image = rock.frame_value(bytes(1 << 20), 1024, 1024, "MODE_GRAYSCALE", T0_US)
    writer = rock.PocologWriter()
    writer.declare(0, "/camera.frame", rock.FRAME)
    content = rock.FRAME.encode({**image, "image": []}, "<")
    head, tail = content[:16] + struct.pack("<Q", 1 << 20), content[24:]
    for _ in range(20):
        writer.raw(0, head + bytes(1 << 20) + tail)
    path.write_bytes(writer.data)
    del writer, image
    tracemalloc.start()
    try:
        with closing(open_log(path)) as log:
            assert sum(int(np.size(s.value.image)) for s in log.samples()) == 20 << 20
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 8 << 20


def test_a_file_without_readable_types_does_not_hide_the_other_files(tmp_path: Path) -> None:
    write_imu(tmp_path / "imu.0.log", [T0_US])
    writer = rock.PocologWriter()
    writer.declare(0, "/xsens.samples", IMU, b"<typelib")
    writer.sample(0, IMU, imu(T0_US))
    (tmp_path / "imu.1.log").write_bytes(writer.data)
    with closing(open_log(tmp_path)) as log:
        assert log.streams["/robot/xsens.samples"].count == 1
        assert log.unconverted["imu.1.log: /xsens.samples"].count == 1


def test_a_file_that_only_begins_like_a_log_is_not_one(tmp_path: Path) -> None:
    (tmp_path / "imu.0.log").write_bytes(b"POCOSIM_INDEX" + bytes(100))
    with pytest.raises(InputError, match="none of the known formats"):
        open_log(tmp_path / "imu.0.log")
