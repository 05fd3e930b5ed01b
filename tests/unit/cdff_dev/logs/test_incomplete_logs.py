# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs that cannot be completed: a full disk, a file that is too large, Ctrl-C."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import StorageError
from cdff_common.types import LidarScan
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.source import recorded_header
from cdff_dev.record.files import RecordingFiles

STREAM, COUNT, LIMIT_BYTES = "/mana/lidar.scan", 40, 3_000_000
TARGETS = ["run.msg", "run.bag", "run.mcap", "run"]


def scan(n: int) -> LidarScan:
    points_m = np.full((10_000, 3), n, np.float32)
    stamp_ns = n * 100_000_000
    return LidarScan.from_arrays(
        points_m, np.zeros(10_000, np.uint32), frame="mana/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of 40 scans, 5 MB."""
    path = tmp_path_factory.mktemp("source") / "source.msg"
    with LogWriter(path) as writer:
        for n in range(COUNT):
            writer.write(STREAM, scan(n), n * 100_000_000)
    return path


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file of this process may be larger than 3 MB, as on a disk of this size."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT_BYTES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", TARGETS)
def test_a_conversion_to_a_full_disk_leaves_no_file_and_the_earlier_log(
    log: Path, tmp_path: Path, name: str, full_disk: None, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / name
    if target.suffix:
        target.write_bytes(b"an earlier log")
    assert main(["log", "convert", str(log), str(target)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert str(target.with_suffix("")) in line
    assert [path.name for path in tmp_path.iterdir()] == ([name] if target.suffix else [])
    assert not target.suffix or target.read_bytes() == b"an earlier log"


@pytest.mark.parametrize("words", [["log", "cut", "LOG", "--out"], ["log", "merge", "LOG", "--out"]])
def test_a_copy_that_is_interrupted_leaves_no_file_and_the_earlier_log(
    log: Path, tmp_path: Path, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "run.msg"
    target.write_bytes(b"an earlier log")
    written = []

    def write(writer: LogWriter, *_: object) -> None:
        written.append(writer)
        if len(written) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(LogWriter, "write", write)
    assert main([str(log) if word == "LOG" else word for word in words] + [str(target)]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["run.msg"]
    assert target.read_bytes() == b"an earlier log"


@pytest.mark.parametrize("name", TARGETS[1:])
def test_a_recording_to_a_full_disk_keeps_the_samples_before(
    tmp_path: Path, name: str, full_disk: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cdff_dev.logs.formats.ros.storage._COMMIT_BYTES", 500_000)
    files = RecordingFiles(tmp_path / name)

    def record() -> None:
        for n in range(COUNT):
            stamp_ns = n * 100_000_000
            files.write(STREAM, scan(n), stamp_ns, recorded_header(STREAM, n, stamp_ns), 1)

    with pytest.raises(StorageError):
        record()
    with suppress(StorageError):  # the metadata of a ROS 2 bag can still be written
        files.close()
    assert files.existing() == [tmp_path / name] == list(tmp_path.iterdir())
    with open_log(tmp_path / name) as recording:
        values = [sample.value.points_m[0, 0] for sample in recording.samples()]
    assert 10 < len(values) < COUNT
    assert values == list(range(len(values)))
