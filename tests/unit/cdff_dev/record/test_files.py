# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of a recording: splits by size and mission time, existing logs, a disk that cannot be written."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.codecs import encode_payload
from cdff_common.errors import InputError, StorageError
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.source import recorded_header
from cdff_dev.record.files import RecordingFiles
from cdff_dev.record.recorder import Recorder

STREAM, PERIOD_NS, SIZE = "/mana/imu.sample", 100_000_000, 100


def imu(n: int) -> IMUSensors:
    return IMUSensors(Time.from_ns(n * PERIOD_NS), np.full(3, n), np.zeros(3), np.zeros(3))


def record(files: RecordingFiles, count: int) -> list[Path]:
    for n in range(count):
        stamp_ns = n * PERIOD_NS
        files.write(STREAM, imu(n), stamp_ns, recorded_header(STREAM, n, stamp_ns), SIZE)
    files.close()
    return files.paths


@pytest.mark.parametrize("name", ["run.msg", "run.mcap", "run.bag"])
@pytest.mark.parametrize("limits", [{"max_bytes": 10 * SIZE}, {"max_s": 1.0}], ids=["size", "time"])
def test_each_part_of_a_split_recording_opens_and_none_is_lost(
    tmp_path: Path, name: str, limits: dict[str, Any]
) -> None:
    paths = record(RecordingFiles(tmp_path / name, **limits), 25)
    stem, suffix = name.split(".")
    assert paths == [tmp_path / f"{stem}_{k:03d}.{suffix}" for k in range(3)]
    read = []
    for path in paths:
        with open_log(path) as log:
            read.append([int(sample.value.acc[0]) for sample in log.samples([STREAM])])
    assert read == [list(range(10)), list(range(10, 20)), list(range(20, 25))]


@pytest.mark.parametrize("name", ["run.msg", "run.mcap", "run.bag", "run"])
def test_a_log_is_written_by_another_thread_than_that_which_made_it(tmp_path: Path, name: str) -> None:
    files = RecordingFiles(tmp_path / name)
    thread = threading.Thread(target=record, args=(files, 5))
    thread.start()
    thread.join()
    with open_log(tmp_path / name) as log:
        assert log.streams[STREAM].count == 5


@pytest.mark.parametrize("limit", [{"max_bytes": 0}, {"max_s": 0.0}, {"max_s": float("nan")}])
def test_limits_that_are_not_above_zero_are_refused(tmp_path: Path, limit: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="expected above 0"):
        RecordingFiles(tmp_path / "run.msg", **limit)


def test_a_recording_in_chunks_is_not_replaced(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.msg", chunk_bytes=200) as writer:
        for n in range(10):
            writer.write(STREAM, imu(n), n * PERIOD_NS)
    assert not (tmp_path / "run.msg").exists()
    chunks = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(chunks) > 1
    with pytest.raises(InputError, match=r"run_000000000\.msg exists"):
        RecordingFiles(tmp_path / "run.msg")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == chunks


class _Bus:
    """A bus that passes messages to the subscriber in the thread of the test."""

    def subscribe(self, _: str, callback: Callable[[Any], None], *, depth: int) -> Any:
        self.publish = callback
        return SimpleNamespace(dropped=0, finish=lambda _: depth)

    def alive(self, _: str) -> list[str]:
        return []


def test_a_log_that_cannot_be_continued_ends_the_recording_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "run_001.mcap").write_bytes(b"another recording")
    bus, ended = _Bus(), threading.Event()
    files = RecordingFiles(tmp_path / "run.mcap", max_s=0.5)
    recorder = Recorder(bus, ["**"], files, on_fault=ended.set)  # type: ignore[arg-type]
    for n in range(8):
        payload, encoding = encode_payload(imu(n))
        header = recorded_header(STREAM, n, n * PERIOD_NS)
        message = SimpleNamespace(
            key="cdff/@v1/mana/sensor/imu/sample",
            payload=payload,
            encoding=encoding,
            attachment=header.to_attachment(),
        )
        bus.publish(message)
        assert ended.is_set() == (n >= 5)
    with pytest.raises(StorageError, match=r"run_001\.mcap exists.*; of 5 samples.*run_000\.mcap"):
        recorder.close()
    assert (tmp_path / "run_001.mcap").read_bytes() == b"another recording"
    with open_log(tmp_path / "run_000.mcap") as log:
        assert log.streams[STREAM].count == 5
