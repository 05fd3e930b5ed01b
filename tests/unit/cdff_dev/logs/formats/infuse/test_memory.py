# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs larger than memory are written and read with bounded memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import StorageError
from cdff_common.types import Frame
from cdff_dev.logs import LogWriter, open_log

_IMAGE = np.arange(1 << 18, dtype=np.uint32).astype(np.uint8).reshape(512, 512)


def _log(folder: Path, images: int, chunk_bytes: int) -> Path:
    path = folder / f"log{images}.msg"
    with LogWriter(path, chunk_bytes=chunk_bytes) as log:
        for i in range(images):
            log.write("/mana/navcam.frame", Frame.from_image(_IMAGE, stamp_ns=i * 1000), i * 1000)
    return path if path.exists() else folder / f"log{images}_*.msg"


def _peak_mb(work: object) -> float:
    assert callable(work)
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def _read(path: Path, count: int) -> None:
    with open_log(path) as log:
        assert sum(s.value.image.size > 0 for s in log.samples()) == count


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    _read(_log(tmp_path, 4, 1 << 20), 4)
    writing = _peak_mb(lambda: _log(tmp_path, 160, 1 << 20))
    reading = _peak_mb(lambda: _read(tmp_path / "log160_*.msg", 160))
    assert writing < 4.0
    assert reading < 4.0


def test_a_large_file_is_indexed_and_read_sample_by_sample(tmp_path: Path) -> None:
    path = _log(tmp_path, 300, 1 << 30)
    assert path.stat().st_size > 70_000_000
    assert _peak_mb(lambda: _read(path, 300)) < 4.0


def test_a_file_truncated_after_indexing_is_reported(tmp_path: Path) -> None:
    path = _log(tmp_path, 4, 1 << 30)
    with open_log(path) as log:
        path.write_bytes(path.read_bytes()[: 1 << 19])
        with pytest.raises(StorageError, match="became shorter"):
            list(log.samples())


def test_a_log_of_many_chunks_keeps_few_files_open(tmp_path: Path) -> None:
    log = open_log(_log(tmp_path, 60, 1 << 18))
    assert sum(1 for _ in log.samples()) == 60
    assert len(list(tmp_path.iterdir())) == 60
    log.close()
