# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cache of converted payloads: once per key, quota, lost files, concurrent callers."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from services.dpm.rendering.conversion_cache import FOLDER, ConversionCache
from services.dpm.rendering.convert import Converted


def content(cache: ConversionCache, key: str, data: bytes) -> bytes:
    with cache.open(key, lambda: Converted(data, "image/tiff", "tif")).file as file:
        return file.read()


def test_a_payload_is_made_once_until_the_quota_is_exceeded(tmp_path: Path) -> None:
    cache = ConversionCache(tmp_path, max_bytes=10)
    assert content(cache, "a", b"aaaa") == b"aaaa"
    assert content(cache, "b", b"bbbb") == b"bbbb"
    assert content(cache, "a", b"new") == b"aaaa"
    assert content(cache, "c", b"cccc") == b"cccc"  # removes b, which was used least recently
    assert content(cache, "b", b"new") == b"new"
    assert sum(path.stat().st_size for path in (tmp_path / FOLDER).iterdir()) <= 10


def test_a_payload_above_the_quota_is_read_but_not_kept(tmp_path: Path) -> None:
    cache = ConversionCache(tmp_path, max_bytes=3)
    assert content(cache, "a", b"aaaa") == b"aaaa"
    assert list((tmp_path / FOLDER).iterdir()) == []


def test_an_open_file_remains_readable_after_its_removal(tmp_path: Path) -> None:
    cache = ConversionCache(tmp_path, max_bytes=4)
    first = cache.open("a", lambda: Converted(b"aaaa", "image/tiff", "tif"))
    assert content(cache, "b", b"bbbb") == b"bbbb"
    with first.file as file:
        assert file.read() == b"aaaa"


def test_files_of_an_earlier_run_and_lost_files_are_made_again(tmp_path: Path) -> None:
    assert content(ConversionCache(tmp_path), "a", b"old") == b"old"
    cache = ConversionCache(tmp_path)
    assert content(cache, "a", b"aaaa") == b"aaaa"
    for path in (tmp_path / FOLDER).iterdir():
        path.unlink()
    assert content(cache, "a", b"new") == b"new"


def test_concurrent_callers_wait_for_one_conversion(tmp_path: Path) -> None:
    cache, conversions, started = ConversionCache(tmp_path), [], threading.Barrier(8)

    def make() -> Converted:
        conversions.append(1)
        return Converted(b"data", "image/tiff", "tif")

    def ask(_: int) -> bytes:
        started.wait(10)
        with cache.open("a", make).file as file:
            return file.read()

    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(ask, range(8))) == {b"data"}
    assert len(conversions) == 1


def test_a_failed_conversion_is_tried_again(tmp_path: Path) -> None:
    cache = ConversionCache(tmp_path)

    def fail() -> Converted:
        raise ValueError("no such format")

    with pytest.raises(ValueError, match="no such format"):
        cache.open("a", fail)
    assert content(cache, "a", b"data") == b"data"
