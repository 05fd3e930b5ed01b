# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import errno
import threading
from pathlib import Path

import pytest

from services.gateway_ccsds import spool as spool_module
from services.gateway_ccsds.spool import Spool


def test_a_payload_in_json_and_its_sidecar_are_different_files(tmp_path: Path) -> None:
    spool = Spool(tmp_path, 100)
    spool.add(1, 1, "mana-pose-1-x", "json", b"{}", {"id": "x"})
    payload, sidecar = spool.files()
    assert payload.read_bytes() == b"{}"
    assert spool.is_ready(payload)
    assert not spool.is_ready(sidecar)
    spool.remove(payload)
    assert spool.is_ready(sidecar)
    spool.remove(sidecar)
    assert spool.size() == (0, 0)


def test_a_product_that_could_not_be_written_is_added_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = Spool(tmp_path, 100)

    def fail(path: Path, data: bytes, *, sync: bool = False) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as context:
        context.setattr(spool_module, "replace_file", fail)
        with pytest.raises(OSError, match="No space"):
            spool.add(1, 1, "x", "tif", b"abc", {})
    assert list(tmp_path.iterdir()) == []
    assert spool.add(1, 1, "x", "tif", b"abc", {})


def test_a_restart_removes_unfinished_and_empty_folders(tmp_path: Path) -> None:
    (tmp_path / "0123.part").mkdir()
    (tmp_path / "1-000000000001-x").mkdir()  # a kill after the removal of the sidecar
    spool = Spool(tmp_path, 100)
    assert spool.size() == (0, 0)
    assert spool.add(1, 1, "x", "tif", b"abc", {})


def test_a_product_that_two_threads_add_waits_once(tmp_path: Path) -> None:
    spool, start, results = Spool(tmp_path, 100), threading.Barrier(2), []

    def add(priority: int) -> None:
        for number in range(50):
            start.wait(10.0)
            results.append(spool.add(number, priority, f"x{number}", "tif", b"abc", {}))

    threads = [threading.Thread(target=add, args=(priority,)) for priority in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results.count(True) == 50
    assert spool.size()[0] == 50


def test_the_size_is_available_while_files_are_removed(tmp_path: Path) -> None:
    spool = Spool(tmp_path, 10)
    for number in range(60):
        spool.add(number, 1, f"x{number}", "tif", bytes(50), {})

    def remove() -> None:
        for path in spool.files():
            spool.remove(path)

    thread = threading.Thread(target=remove)
    thread.start()
    sizes = []
    while thread.is_alive():
        sizes.append(spool.size())
    thread.join()
    assert sizes == sorted(sizes, reverse=True)
    assert spool.size() == (0, 0)
