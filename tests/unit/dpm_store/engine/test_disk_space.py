# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reserve and low water of the disk of a store, each at its limit; the free space is scripted."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest

from cdff_common.errors import StorageError
from dpm_store.engine import disk_space
from dpm_store.engine.disk_space import DiskSpace

MB = 1 << 20
RESERVE = disk_space.RESERVE_BYTES


class Disk:
    """Disk with a given number of free bytes."""

    free = 1000 * MB

    def set(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(DiskSpace, "free_bytes", lambda _: self.free)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk()
    disk.set(monkeypatch)
    return disk


def space(folder: Path, reserve_bytes: int = MB) -> DiskSpace:
    return DiskSpace(folder, low_water_bytes=64 * MB, reserve_bytes=reserve_bytes)


def reserve(folder: Path) -> int | None:
    """Return the size of the reserve file; None without."""
    file = folder / "store.reserve"
    return file.stat().st_size if file.exists() else None


def test_payloads_are_admitted_down_to_the_low_water(tmp_path: Path, disk: Disk) -> None:
    volume = space(tmp_path)
    disk.free = 70 * MB
    assert volume.holds(6 * MB)
    assert not volume.holds(6 * MB + 1)
    volume.admit(6 * MB)
    with pytest.raises(StorageError, match=f"{6 * MB + 1} bytes not stored: the disk has {70 * MB} left"):
        volume.admit(6 * MB + 1)


def test_space_is_low_below_twice_the_low_water(tmp_path: Path, disk: Disk) -> None:
    s = space(tmp_path)
    disk.free = 128 * MB
    assert not s.is_low()
    disk.free -= 1
    assert s.is_low()


@pytest.mark.parametrize(
    ("free_bytes", "size"), [(33 * MB, MB), (33 * MB - 1, None), (RESERVE, None), (RESERVE - 1, None)]
)
def test_the_reserve_is_created_where_half_the_low_water_remains(
    tmp_path: Path, disk: Disk, free_bytes: int, size: int | None
) -> None:
    disk.free = free_bytes
    space(tmp_path)
    assert reserve(tmp_path) == size


@pytest.mark.parametrize(("free_bytes", "stays"), [(RESERVE, True), (RESERVE - 1, False)])
def test_an_existing_reserve_is_removed_at_the_start_on_a_full_disk(
    tmp_path: Path, disk: Disk, free_bytes: int, stays: bool
) -> None:
    space(tmp_path)
    disk.free = free_bytes
    space(tmp_path)
    assert (reserve(tmp_path) is not None) == stays


def test_without_a_size_there_is_no_reserve(tmp_path: Path, disk: Disk) -> None:
    space(tmp_path, reserve_bytes=0)
    assert reserve(tmp_path) is None


@pytest.mark.parametrize(("free_bytes", "stays"), [(64 * MB, True), (64 * MB - 1, False)])
def test_a_deletion_on_a_nearly_full_disk_uses_the_reserve_and_creates_it_again(
    tmp_path: Path, disk: Disk, free_bytes: int, stays: bool
) -> None:
    s = space(tmp_path)
    disk.free = free_bytes
    with s.deletion():
        assert (reserve(tmp_path) is not None) == stays
        with s.deletion():
            disk.free = 500 * MB
        assert (reserve(tmp_path) is not None) == stays  # another deletion still needs the space
    assert reserve(tmp_path) == MB


def test_the_reserve_is_created_again_after_a_deletion_that_failed(tmp_path: Path, disk: Disk) -> None:
    s = space(tmp_path)
    disk.free = 10 * MB
    with suppress(ValueError), s.deletion():
        disk.free = 500 * MB
        raise ValueError
    assert reserve(tmp_path) == MB


def test_a_reserve_that_cannot_be_written_is_reported_and_removed(
    tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(disk_space.os, "posix_fallocate", full)
    space(tmp_path)
    assert reserve(tmp_path) is None
    assert caplog.messages == ["no reserve for a full disk"]
