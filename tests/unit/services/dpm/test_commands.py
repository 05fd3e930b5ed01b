# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import argparse
import json
from pathlib import Path

import pytest

from cdff_common import cli
from cdff_common.errors import StorageError
from dpm_store import open_store
from dpm_store.payloads.payloads import PACKED_BYTES
from services.dpm.cli.commands import register
from services.dpm.operations.dpm import Dpm

from .conftest import cloud, put_arguments


def run(*arguments: str) -> int:
    """Run ``cdff dpm`` with arguments; return the exit code."""
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["dpm", *arguments])
    code: int = args.run(args)
    return code


def test_verify_distinguishes_an_intact_store_from_a_corrupt_one(
    dpm: Dpm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, header = dpm.writer.put(*put_arguments(cloud(5000), "pointcloud"))
    record = dpm.store.get(header.id)
    assert record.size > PACKED_BYTES
    dpm.store.close()
    assert run("verify", "--data-dir", str(tmp_path)) == 0
    path = tmp_path / "blobs" / record.sha256[:2] / record.sha256[2:]
    data = bytearray(path.read_bytes())
    data[1000] ^= 1
    path.write_bytes(data)
    capsys.readouterr()
    assert run("verify", "--data-dir", str(tmp_path), "--json") == 1
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert record.sha256 in problem["where"]


STAMP_NS = 1_700_000_000_123_456_000


class ClientDouble:
    """Client double whose DPM has one product."""

    data = b"payload"

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> "ClientDouble":
        return self

    def __exit__(self, *_: object) -> None: ...

    def search(self, *_: object, **__: object) -> list[dict[str, object]]:
        return [{"id": "a", "t0_ns": STAMP_NS, "t1_ns": STAMP_NS}]

    def get(self, *_: object) -> "ClientDouble":
        return self


def test_json_search_has_stamps_as_decimal_strings(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cdff_common.client.Client", ClientDouble)
    assert run("search", "--json") == 0
    assert json.loads(capsys.readouterr().out) == [
        {"id": "a", "t0_ns": str(STAMP_NS), "t1_ns": str(STAMP_NS)}
    ]


def test_a_payload_file_that_cannot_be_written_is_reported_in_one_line_with_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cdff_common.client.Client", ClientDouble)
    assert cli.main(["dpm", "get", "a", "--out", str(tmp_path / "none" / "x")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "there is no folder" in line


def test_a_backup_of_an_open_store_is_restored(
    dpm: Dpm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dpm.writer.put(*put_arguments(cloud(5000), "pointcloud"))
    backup, restored = tmp_path / "copy", tmp_path / "new"
    assert run("backup", str(backup), "--data-dir", str(tmp_path), "--json") == 0
    assert json.loads(capsys.readouterr().out)["products"] == 1
    assert run("restore", str(backup), "--data-dir", str(restored), "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"products": 1, "problems": [], "unnamed_files": 0}


def test_an_open_store_is_migrated_and_later_changes_by_a_second_call(
    dpm: Dpm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dpm.writer.put(*put_arguments(cloud(5000), "pointcloud"))
    target = f"sqlite:///{tmp_path}/migrated"
    assert run("migrate", str(tmp_path), target, "--json") == 0
    first = json.loads(capsys.readouterr().out)
    assert (first["products"], first["lost"], first["problems"]) == (1, [], [])
    dpm.writer.put(*put_arguments(cloud(4000), "pointcloud", seq=2))
    assert run("migrate", str(tmp_path), target) == 0
    assert capsys.readouterr().out.strip().endswith("1 changes copied; 2 products, verified")


def test_a_store_without_its_database_is_an_error_until_it_is_rebuilt(
    dpm: Dpm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, header = dpm.writer.put(*put_arguments(cloud(5000), "pointcloud"))
    dpm.store.close()
    for path in tmp_path.glob("store.sqlite*"):
        path.unlink()
    with pytest.raises(StorageError, match="cdff dpm rebuild"):
        run("verify", "--data-dir", str(tmp_path))
    assert run("rebuild", "--data-dir", str(tmp_path), "--json") == 0
    assert json.loads(capsys.readouterr().out)["products"] == 1
    assert run("verify", "--data-dir", str(tmp_path)) == 0
    with open_store(f"sqlite:///{tmp_path}") as store:
        assert store.get(header.id).size > PACKED_BYTES
