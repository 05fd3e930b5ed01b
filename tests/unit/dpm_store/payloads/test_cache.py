# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local copies of objects stay within their quota, also after a restart and on a full disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from dpm_store.payloads import cache as cache_module
from dpm_store.payloads.cache import ObjectCache


def content(cache: ObjectCache, name: str) -> bytes | None:
    file = cache.open(name)
    if file is None:
        return None
    with file:
        return file.read()


def test_the_copy_that_was_not_used_for_the_longest_time_is_removed(tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path, 30)
    for name in "abc":
        cache.add(name, name.encode() * 10)
    assert content(cache, "a") == b"a" * 10
    cache.add("d", b"d" * 10)
    assert [name for name in "abcd" if name in cache] == ["a", "c", "d"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "c", "d"]
    assert cache.total_bytes == 30


def test_a_copy_larger_than_the_quota_is_not_kept(tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path, 30)
    cache.add("a", b"a" * 31)
    assert content(cache, "a") is None
    assert cache.total_bytes == 0


def test_copies_are_found_after_a_restart_and_incomplete_ones_are_removed(tmp_path: Path) -> None:
    ObjectCache(tmp_path, 30).add("a", b"a" * 10)
    (tmp_path / "x.part").write_bytes(b"incomplete")
    cache = ObjectCache(tmp_path, 30)
    assert content(cache, "a") == b"a" * 10
    assert cache.total_bytes == 10
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_removed_copy_and_a_lost_file_are_not_found(tmp_path: Path) -> None:
    cache = ObjectCache(tmp_path, 30)
    for name in "ab":
        cache.add(name, b"1")
    cache.remove("a")
    (tmp_path / "b").unlink()
    assert content(cache, "a") is None
    assert content(cache, "b") is None


def test_a_full_disk_keeps_no_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    cache = ObjectCache(tmp_path, 30)
    monkeypatch.setattr(cache_module.os, "fdopen", full)
    cache.add("a", b"a")
    assert "a" not in cache
    assert not list(tmp_path.iterdir())
