# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Packs in an object store, here a double of it: locations, sizes and numbers of packs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cdff_common.errors import StorageError
from dpm_store.payloads import objects
from dpm_store.payloads.blobs import chunk_sums
from dpm_store.payloads.cache import ObjectCache
from dpm_store.payloads.objects import ObjectPacks
from dpm_store.payloads.packs import pack_of

SIZE = 1000


class Objects:
    """The methods of ``ObjectStore`` that packs use, on a dictionary."""

    def __init__(self) -> None:
        self.contents: dict[str, bytes] = {}

    def create(self, key: str, content: bytes) -> bool:
        return self.contents.setdefault(key, content) is content

    def get_range(self, key: str, start: int, length: int) -> bytes:
        return self.contents[key][start : start + length]

    def remove(self, key: str) -> None:
        self.contents.pop(key, None)

    def list(self, prefix: str, after: str | None = None) -> Iterator[list[tuple[str, int]]]:
        for key in sorted(self.contents):
            if key.startswith(prefix) and key > (after or ""):
                yield [(key, len(self.contents[key]))]


def payload(number: int) -> bytes:
    return bytes([number]) * SIZE


def packs_of(store: Objects, cache: Path) -> ObjectPacks:
    return ObjectPacks(store, ObjectCache(cache, 0))  # type: ignore[arg-type]  # double


def test_the_payloads_of_a_transaction_share_packs_until_these_are_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(objects, "PACK_BYTES", 2 * SIZE + 1)
    store = Objects()
    packs = packs_of(store, tmp_path)
    payloads = [payload(number) for number in range(5)]
    locations = packs.append(payloads)
    assert [pack_of(location) for location in locations] == [1, 1, 1, 2, 2]
    for location, content in zip(locations, payloads, strict=True):
        assert packs.read((location, SIZE), chunk_sums(content), "it") == content
    assert [pack_of(location) for location in packs.append([payload(7)])] == [3]
    assert (packs.numbers(), packs.allocated_bytes()) == ([1, 2, 3], 6 * SIZE)


def test_without_payloads_there_is_no_pack(tmp_path: Path) -> None:
    store = Objects()
    assert packs_of(store, tmp_path).append([]) == []
    assert store.contents == {}


def test_processes_that_append_at_once_use_different_packs(tmp_path: Path) -> None:
    store = Objects()
    first, second = (packs_of(store, tmp_path / name) for name in ("first", "second"))
    numbers = []
    for number, packs in enumerate([first, first, second, first, second, second]):
        (location,) = packs.append([payload(number)])
        numbers.append(pack_of(location))
        assert first.read((location, SIZE), chunk_sums(payload(number)), "it") == payload(number)
    assert numbers == [1, 2, 3, 4, 5, 6]


def test_a_pack_is_removed_when_no_payload_in_it_is_used(tmp_path: Path) -> None:
    packs = packs_of(Objects(), tmp_path)
    (location,) = packs.append([payload(1)])
    assert packs.reclaim(1, [(location, SIZE)])
    assert packs.numbers() == [1]
    assert packs.reclaim(1, [])
    assert packs.numbers() == []


def test_a_truncated_pack_is_reported(tmp_path: Path) -> None:
    store = Objects()
    packs = packs_of(store, tmp_path)
    locations = packs.append([payload(1), payload(2)])
    (key,) = store.contents
    store.contents[key] = store.contents[key][:1500]
    with pytest.raises(StorageError, match="it: its pack ends at byte 1500, expected 2000"):
        packs.read((locations[1], SIZE), chunk_sums(payload(2)), "it")
