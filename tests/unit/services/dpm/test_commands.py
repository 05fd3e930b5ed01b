# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import argparse
import json
from pathlib import Path

import pytest

from dpm_store.products import INLINE_BYTES
from services.dpm.commands import register
from services.dpm.operations import Dpm

from .conftest import cloud, parcel


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["dpm", *arguments])
    code: int = args.run(args)
    return code


def test_verify_tells_a_sound_store_from_one_that_the_disk_changed(
    dpm: Dpm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, header = dpm.put(*parcel(cloud(5000), "pointcloud"))
    record = dpm.store.get(header.id)
    assert record.size > INLINE_BYTES
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
