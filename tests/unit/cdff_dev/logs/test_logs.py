# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs: round trips in a defined order and in bounded memory; damaged logs are reported."""

from __future__ import annotations

import tracemalloc
import uuid
from pathlib import Path

import msgpack
import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import CodecError, InputError, StorageError
from cdff_common.interfaces.product import Header
from cdff_dev.logs import LogReader, LogWriter, StreamInfo, open_log


def _imu(i: int) -> types.IMUSensors:
    return types.IMUSensors(types.Time.from_ns(i * 1000), np.full(3, float(i)), np.zeros(3), np.zeros(3))


def _frame(i: int, size: int = 100) -> types.Frame:
    return types.Frame.from_image(np.full((size, size), i % 256, np.uint8), stamp_ns=i * 1000)


def _write(path: Path, n: int = 10, chunk_bytes: int = 64_000_000) -> None:
    with LogWriter(path, chunk_bytes=chunk_bytes) as writer:
        for i in range(n):
            writer.write("/mana/navcam.left", _frame(i), i * 1000)
            writer.write("/mana/imu.sample", _imu(i), i * 1000)


@pytest.mark.req("CDFF-DEV-020")
def test_a_short_log_is_one_file_in_the_format_of_figure_4(tmp_path: Path) -> None:
    _write(tmp_path / "run.msg", 2)
    assert [p.name for p in tmp_path.iterdir()] == ["run.msg"]
    log = msgpack.unpackb((tmp_path / "run.msg").read_bytes())
    assert list(log) == [
        "/mana/imu.sample.meta",
        "/mana/imu.sample",
        "/mana/navcam.left.meta",
        "/mana/navcam.left",
    ]
    assert log["/mana/imu.sample.meta"] == {"type": "IMUSensors", "timestamps": [0, 1]}
    assert log["/mana/imu.sample"][1]["acc"] == [1.0, 1.0, 1.0]


@pytest.mark.req("CDFF-DEV-021")
def test_samples_are_ordered_by_stamp_stream_and_number(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.msg") as writer:
        for stream, stamp in (("/b/x.y", 3), ("/b/x.y", 1), ("/a/x.y", 1), ("/b/x.y", 1), ("/a/x.y", 2)):
            writer.write(stream, _imu(stamp), stamp * 1000)
    with open_log(tmp_path / "run.msg") as log:
        order = [(s.stamp_ns, s.stream, s.seq) for s in log.samples()]
        assert order == [
            (1000, "/a/x.y", 0),
            (1000, "/b/x.y", 1),
            (1000, "/b/x.y", 2),
            (2000, "/a/x.y", 1),
            (3000, "/b/x.y", 0),
        ]
        assert log.streams["/b/x.y"] == StreamInfo("IMUSensors", 3, 1000, 3000)
        assert [s.seq for s in log.samples(["/a/x.y"])] == [0, 1]


@pytest.mark.parametrize("name", ["run.msg", "folder"])
def test_a_long_log_is_split_into_chunks_that_are_valid_logs(tmp_path: Path, name: str) -> None:
    _write(tmp_path / name, 20, chunk_bytes=50_000)
    folder = tmp_path / name if name == "folder" else tmp_path
    chunks = sorted(folder.iterdir())
    prefix = "log" if name == "folder" else "run"
    assert [c.name for c in chunks] == [f"{prefix}_{i:09d}.msg" for i in range(len(chunks))]
    assert len(chunks) == 5
    assert all(c.stat().st_size < 60_000 for c in chunks)
    for path in (tmp_path / name, f"{folder}/{prefix}_*.msg", folder):
        with open_log(path) as log:
            assert [s.value for s in log.samples(["/mana/imu.sample"])] == [_imu(i) for i in range(20)]
            assert [s.seq for s in log.samples(["/mana/navcam.left"])] == list(range(20))
    with open_log(chunks[1]) as log:
        assert set(log.streams) == {"/mana/imu.sample", "/mana/navcam.left"}


def test_headers_of_products_are_kept(tmp_path: Path) -> None:
    header = Header(id=str(uuid.uuid4()), seq=3, t0_ns=0, t1_ns=1000, frame="site", producer="x")
    with LogWriter(tmp_path / "run.msg") as writer:
        writer.write("/mana/pom.pose", _imu(0), 0)
        writer.write("/mana/pom.pose", _imu(1), 1000, header)
    with open_log(tmp_path / "run.msg") as log:
        assert [s.header for s in log.samples()] == [None, header]


def test_writing_twice_gives_equal_bytes(tmp_path: Path) -> None:
    for name in ("a.msg", "b.msg"):
        _write(tmp_path / name)
    assert (tmp_path / "a.msg").read_bytes() == (tmp_path / "b.msg").read_bytes()


def test_a_new_log_replaces_the_chunks_of_an_old_one(tmp_path: Path) -> None:
    _write(tmp_path / "run.msg", 20, chunk_bytes=50_000)
    _write(tmp_path / "run.msg", 1)
    assert [p.name for p in tmp_path.iterdir()] == ["run.msg"]


def test_an_empty_log_has_no_streams(tmp_path: Path) -> None:
    LogWriter(tmp_path / "run.msg").close()
    with open_log(tmp_path / "run.msg") as log:
        assert log.streams == {}
        assert list(log.samples()) == []


def test_values_that_a_log_cannot_store_are_refused(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.msg") as writer:
        writer.write("/a/b.c", _imu(0), 0)
        for stream, value, stamp, message in (
            ("/a/b.c", _imu(0), 1, "multiple of 1000"),
            ("/a/b.c", types.Time(), 0, "a Time, expected IMUSensors"),
            ("/a/b.meta", _imu(0), 0, r"not ending in \.meta"),
            ("a/b.c", _imu(0), 0, "expected /robot"),
        ):
            with pytest.raises(InputError, match=message):
                writer.write(stream, value, stamp)
    with pytest.raises(InputError, match="closed"):
        writer.write("/a/b.c", _imu(0), 0)
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="log"):
        LogWriter(tmp_path / "file" / "run.msg")


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.msg", chunk_bytes=1_000_000) as writer:
        tracemalloc.start()
        for i in range(60):
            writer.write("/mana/navcam.left", _frame(i, 500), i * 1000)
        write_peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    with open_log(tmp_path / "run.msg") as log:
        count = sum(1 for _ in log.samples())
        read_peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == 60
    assert write_peak < 4_000_000
    assert read_peak < 4_000_000


@pytest.mark.parametrize("fraction", [0.95, 0.6, 0.3, 0.02])
def test_a_truncated_log_is_read_up_to_its_last_whole_sample(tmp_path: Path, fraction: float) -> None:
    _write(tmp_path / "run.msg", 20)
    data = (tmp_path / "run.msg").read_bytes()
    (tmp_path / "cut.msg").write_bytes(data[: int(fraction * len(data))])
    with open_log(tmp_path / "cut.msg") as log:
        assert any("truncated" in text for text in log.quirks.counts)
        samples = list(log.samples())
        assert sum(i.count for i in log.streams.values()) == len(samples)
        expected = {
            "/mana/imu.sample": [_imu(i) for i in range(20)],
            "/mana/navcam.left": [_frame(i) for i in range(20)],
        }
        for name in log.streams:
            values = [s.value for s in samples if s.stream == name]
            assert values == expected[name][: len(values)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a log", "MessagePack map"),
        (msgpack.packb({"/a.b": [{}]}), "has no /a.b.meta"),
        (msgpack.packb({"/a.b.meta": {"type": "Time"}, "/a.b": [{}]}), "timestamps as a list of integers"),
        (msgpack.packb({"/a.b.meta": {"type": "Tim", "timestamps": [1]}, "/a.b": [{}]}), "'Tim'"),
        (msgpack.packb({"/a.b.meta": {"type": "Time", "timestamps": [1]}, "/a.b": {}}), "MessagePack array"),
        (msgpack.packb({3: 4}), "key 3"),
        (b"\xdf\xff\xff\xff\xff", None),
        (b"\x82\xa4/a.b\xdd\xff\xff\xff\xff", None),
    ],
)
def test_an_invalid_log_is_refused_and_a_truncated_one_is_empty(
    tmp_path: Path, content: bytes, message: str | None
) -> None:
    (tmp_path / "x.msg").write_bytes(content)
    if message is None:
        with open_log(tmp_path / "x.msg") as log:
            assert log.streams == {}
        return
    with pytest.raises(CodecError, match=message):
        open_log(tmp_path / "x.msg")


def test_a_missing_log_is_refused(tmp_path: Path) -> None:
    for path in ("nothing.msg", "*.msg", "folder"):
        with pytest.raises(InputError, match="no such file"):
            open_log(tmp_path / path)


def test_a_sample_of_another_type_is_refused(tmp_path: Path) -> None:
    log = {
        "/a.b.meta": {"type": "Time", "timestamps": [1, 2]},
        "/a.b": [{"microseconds": 1}, {"acc": [1, 2, 3]}],
    }
    (tmp_path / "x.msg").write_bytes(msgpack.packb(log))
    with (
        open_log(tmp_path / "x.msg") as reader,
        pytest.raises(CodecError, match=r"/a\.b sample 1: .*unknown field 'acc'"),
    ):
        list(reader.samples())


def test_real_infuse_logs_are_read_with_their_quirks(real_data) -> None:  # type: ignore[no-untyped-def]
    folder = real_data("infuse_logs")
    with LogReader([folder / "dynamixel_0.msg"]) as log:
        assert log.streams["/dynamixel.transforms"] == StreamInfo(
            "RigidBodyState", 100, 1530195435193075000, 1530195445089138000
        )
        samples = list(log.samples())
        assert samples[0].value.timestamp.ns == 1530195435192960000
        assert samples[0].value.source_frame == "upper_dynamixel"
        assert np.isnan(samples[0].value.cov_position).all()
        assert (
            log.quirks.counts[
                "/dynamixel.transforms: RigidBodyState.timestamp.usecPerSec: missing, default used"
            ]
            == 100
        )
    with LogReader([folder / "xsens_imu_00.msg"]) as log:
        reading = next(iter(log.samples())).value
        assert reading.acc.tolist() == [-0.45818474888801575, 0.2617998421192169, 9.856483459472656]
        assert reading.timestamp.ns == 1530195436455048000
        assert any("ref_time read as timestamp" in text for text in log.quirks.counts)
    with LogReader([folder / "frames2.msg"]) as log:
        frames = [s.value for s in log.samples()]
        assert log.streams["/hcru0/pt_stereo_rect/left/image"].t0_ns == 1532433037836744000
        assert frames[0].image.shape == (772, 1032)
        assert frames[0].image[0, :5].tolist() == [235, 236, 234, 229, 227]
        assert frames[0].stamp_ns == 1532433037769027000
        assert any("nanoseconds in the place of microseconds" in text for text in log.quirks.counts)


def test_a_name_with_wildcards_replaces_only_its_own_chunks(tmp_path: Path) -> None:
    _write(tmp_path / "other.msg", 20, chunk_bytes=50_000)
    others = sorted(tmp_path.iterdir())
    _write(tmp_path / "*.msg", 1)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "*.msg", *others]
