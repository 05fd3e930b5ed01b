# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The page on drivers: its bytes, and the C++ and Node programs, are samples as the hosts read them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, Message
from cdff_common.interfaces.product import Header, Status
from cdff_common.types import IMUSensors, Time
from cdff_dev.ports import free_port
from services.dfpc_host.inputs import decode_sample

_ROOT = Path(__file__).resolve().parents[2]
_PAGE = (_ROOT / "docs" / "how-to" / "write-a-driver.md").read_text(encoding="utf-8")
_ENCODING = "application/vnd.cdff+msgpack;IMUSensors/1"
_STAMP_NS = 1_700_000_000_123_456_000
_READING = IMUSensors(Time.from_ns(_STAMP_NS), np.array([0, 0, 9.81]), np.array([0, 0, 0.1]))


def check_sample(attachment: bytes, payload: bytes) -> None:
    sample = decode_sample(Message("key", payload, _ENCODING, attachment), "imu", "IMUSensors")
    assert sample.value == _READING
    assert (sample.seq, sample.stamp_ns, sample.frame) == (7, _STAMP_NS, "mana/imu")
    assert sample.quality.status is Status.OK


def test_the_bytes_on_the_page_are_a_complete_header_at_the_stated_offsets() -> None:
    rows = re.findall(r"^\| (\d+) \| `([0-9a-f ]+)` \|", _PAGE, re.MULTILINE)
    data = b""
    for offset, octets in rows:
        assert int(offset) == len(data)
        data += bytes.fromhex(octets)
    header = Header.from_attachment(data, strict=True)
    assert (header.seq, header.t0_ns, header.t1_ns) == (7, _STAMP_NS, _STAMP_NS)
    assert (header.frame, header.producer) == ("mana/imu", "imu")


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is missing")
def test_the_cpp_program_writes_a_sample(tmp_path: Path) -> None:
    program = tmp_path / "imu_sample"
    source = _ROOT / "examples" / "driver" / "imu_sample.cpp"
    options = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wno-unused-result"]
    subprocess.run(["g++", *options, "-o", str(program), str(source)], check=True, timeout=120)
    check_sample(*_run(tmp_path, str(program)))


@pytest.mark.skipif(shutil.which("node") is None, reason="node is missing")
def test_the_node_program_writes_a_sample(tmp_path: Path) -> None:
    check_sample(*_run(tmp_path, "node", str(_ROOT / "examples" / "driver" / "imu_sample.mjs")))


def test_the_snippets_of_the_page_run(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setenv("CDFF_CONNECT", endpoint)
    snippets = re.findall(r"```python\n(.*?)```", _PAGE, re.DOTALL)
    assert len(snippets) == 2
    with Bus.open_router(endpoint):
        exec(compile(snippets[0], "write-a-driver.md", "exec"), {})
    names: dict[str, object] = {}
    exec(compile(snippets[1], "write-a-driver.md", "exec"), names)
    mount, same = names["mount"], names["same_mount"]
    np.testing.assert_allclose(mount.matrix, same.matrix, atol=1e-4)  # type: ignore[attr-defined]


def _run(folder: Path, *command: str) -> tuple[bytes, bytes]:
    paths = [folder / "attachment.bin", folder / "payload.bin"]
    subprocess.run([*command, *map(str, paths)], check=True, timeout=60)
    return paths[0].read_bytes(), paths[1].read_bytes()
