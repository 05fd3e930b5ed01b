# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Full files of records are compressed without losing a record, also when the process is killed."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dpm_store.changes import change_files
from dpm_store.changes.change_files import ChangeFiles

#: For each call of a function that changes files, in turn: a child process appends records to small files,
#: writes each number to a pipe after its insertion, and is killed by SIGKILL just before this call. Another
#: child continues the record. Prints the acknowledged and the found numbers as JSON.
KILLS = """
import json, os, signal, sys
from pathlib import Path
from dpm_store.changes import change_files

def arm(kill_at):
    calls = 0
    def killing(function):
        def call(*arguments, **options):
            nonlocal calls
            calls += 1
            if calls == kill_at:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **options)
        return call
    for owner, names in (
        (os, ("open", "pwrite", "fsync", "fdatasync", "ftruncate", "close")),
        (Path, ("rename", "unlink")),
        (change_files.gzip, ("open",)),
    ):
        for name in names:
            setattr(owner, name, killing(getattr(owner, name)))

def append(directory, first, kill_at):
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        arm(kill_at)
        files = change_files.ChangeFiles(directory)
        for number in range(first, first + 40):
            files.append([number.to_bytes(4, "big") * 25])
            os.write(write, f"{number} ".encode())
        files.close()
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        numbers = [int(text) for text in pipe.read().split()]
    return numbers, os.waitpid(child, 0)[1] == signal.SIGKILL

change_files.FILE_BYTES = 1000
root, stride = Path(sys.argv[1]), int(sys.argv[2])
for kill_at in range(1, 10_000, stride):
    directory = root / str(kill_at)
    first, killed = append(directory, 0, kill_at)
    second, _ = append(directory, 100, 0)
    found = [int.from_bytes(r[:4], "big") for r in change_files.ChangeFiles(directory)]
    parts = len(list(directory.glob("*.part")))
    print(json.dumps({"acknowledged": first + second, "found": found, "parts": parts}), flush=True)
    if not killed:
        break
"""


def record(number: int) -> bytes:
    return number.to_bytes(4, "big") * 25


def numbers(directory: Path) -> list[int]:
    return [int.from_bytes(r[:4], "big") for r in ChangeFiles(directory)]


@pytest.fixture
def small_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(change_files, "FILE_BYTES", 1000)


def fill(directory: Path, count: int) -> None:
    files = ChangeFiles(directory)
    for number in range(count):
        files.append([record(number)])
    files.close()


@pytest.mark.usefixtures("small_files")
def test_full_files_are_compressed_and_read_in_order(tmp_path: Path) -> None:
    fill(tmp_path, 95)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [*(f"{n:08d}.changes.gz" for n in range(1, 10)), "00000010.changes"]
    assert numbers(tmp_path) == list(range(95))
    assert ChangeFiles(tmp_path).last() == record(94)


def test_an_older_record_is_compressed_step_by_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(change_files, "FILE_BYTES", 1000)
    monkeypatch.setattr(change_files, "_COMPRESSED_AT_ONCE", 0)
    fill(tmp_path, 45)
    monkeypatch.setattr(change_files, "_COMPRESSED_AT_ONCE", 2)
    ChangeFiles(tmp_path).append([record(45)])
    assert len(list(tmp_path.glob("*.changes"))) == 3
    assert numbers(tmp_path) == list(range(46))


@pytest.mark.usefixtures("small_files")
def test_a_record_with_compressed_files_only_is_continued_in_a_new_file(tmp_path: Path) -> None:
    fill(tmp_path, 25)
    (tmp_path / "00000003.changes").unlink()
    files = ChangeFiles(tmp_path)
    files.append([record(99)])
    files.close()
    assert numbers(tmp_path) == [*range(20), 99]


@pytest.mark.usefixtures("small_files")
def test_a_full_disk_leaves_the_uncompressed_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(change_files, "fsync", full)
        fill(tmp_path, 25)
    assert "not compressed: [Errno 28]" in caplog.text
    assert {path.suffix for path in tmp_path.iterdir()} == {".changes"}
    assert numbers(tmp_path) == list(range(25))


def test_records_are_complete_if_the_system_writes_them_in_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda file, data, start: write(file, data[:70], start))
    fill(tmp_path, 3)
    files = ChangeFiles(tmp_path)
    files.append([record(3), record(4)])
    assert list(files) == [record(number) for number in range(5)]
    files.close()


def test_of_records_that_do_not_fit_on_the_disk_none_remains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.pwrite

    def write_until_full(file: int, data: memoryview, start: int) -> int:
        if start > 150:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:70], start)

    files = ChangeFiles(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", write_until_full)
        files.append([record(0)])
        with pytest.raises(OSError, match="No space left"):
            files.append([record(1)])
    assert list(files) == [record(0)]
    files.append([record(2)])
    assert list(files) == [record(0), record(2)]
    files.close()


@pytest.mark.usefixtures("small_files")
def test_a_damaged_compressed_file_ends_at_the_damage(tmp_path: Path) -> None:
    fill(tmp_path, 25)
    path = tmp_path / "00000001.changes.gz"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    read_numbers = numbers(tmp_path)
    assert read_numbers == [*range(len(read_numbers) - 15), *range(10, 25)]


@pytest.mark.parametrize("stride", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_a_kill_before_any_call_loses_no_acknowledged_record(tmp_path: Path, stride: int) -> None:
    command = [sys.executable, "-c", KILLS, str(tmp_path), str(stride)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    runs = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(runs) > 80 / stride
    assert len(runs[0]["acknowledged"]) == 40
    assert len(runs[-1]["acknowledged"]) == 80
    for run in runs:
        recovered, acknowledged = run["found"], set(run["acknowledged"])
        assert recovered == sorted(set(recovered))
        assert acknowledged <= set(recovered)
        assert len(set(recovered) - acknowledged) <= 1  # the record in writing
        assert run["parts"] == 0
