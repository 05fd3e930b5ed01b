# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import fcntl
import json
import socket
from pathlib import Path

import pytest

from cdff_common import cli
from cdff_common.errors import CdffError
from cdff_dev.doctor import checks
from cdff_dev.ports import split_address


def _raise(error: Exception) -> object:
    raise error


def test_too_new_a_python_version_is_an_error_with_advice() -> None:
    assert checks.python_version((3, 13)).state == "ok"
    finding = checks.python_version((3, 14))
    assert finding.state == "error"
    assert "3.11 to 3.13" in finding.advice


def test_a_missing_system_library_is_an_error_with_its_package_as_advice() -> None:
    findings = list(checks.system_libraries(lambda name: _raise(OSError(f"{name}: cannot open"))))
    assert {f.advice for f in findings} == {f"apt-get install {p}" for p in checks.SYSTEM_LIBRARIES.values()}
    assert {f.state for f in findings} == {"error"}


def test_a_missing_optional_module_is_a_warning_and_a_missing_base_module_an_error() -> None:
    states = {f.check: f.state for f in checks.modules(lambda name: _raise(ImportError(name)))}
    assert states["open3d"] == "warning"
    assert states["zenoh"] == "error"


def test_an_unexpected_exception_of_a_module_is_not_hidden() -> None:
    with pytest.raises(MemoryError):
        list(checks.modules(lambda name: _raise(MemoryError(name))))


def test_the_installed_versions_satisfy_the_requirements() -> None:
    assert {f.state for f in checks.distributions()} == {"ok"}


def test_a_missing_data_folder_is_checked_at_its_nearest_parent_and_not_created(tmp_path: Path) -> None:
    assert checks.data_folder(tmp_path / "a" / "b").state in ("ok", "warning")
    assert not (tmp_path / "a").exists()


def test_a_store_locked_by_a_process_is_reported(tmp_path: Path) -> None:
    assert checks.store_lock(tmp_path).state == "ok"
    path = tmp_path / "store.lock"
    with path.open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert checks.store_lock(tmp_path).state == "warning"
    assert checks.store_lock(tmp_path).state == "ok"


def test_a_store_lock_that_cannot_be_opened_is_reported(tmp_path: Path) -> None:
    (tmp_path / "store.lock").mkdir()
    finding = checks.store_lock(tmp_path)
    assert finding.state == "warning"
    assert "Is a directory" in finding.detail


def test_a_port_in_use_and_a_listening_router_are_detected() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert checks.http_port(f"127.0.0.1:{port}").state == "warning"
        assert checks.router(f"tcp/127.0.0.1:{port}").state == "ok"
    assert checks.http_port(f"127.0.0.1:{port}").state == "ok"
    assert checks.router(f"tcp/127.0.0.1:{port}").state == "warning"


@pytest.mark.parametrize("address", ["8080", "host", ":1", "host:99999", "host:x"])
def test_an_invalid_address_is_refused(address: str) -> None:
    with pytest.raises(CdffError, match="expected host:port"):
        split_address(address)


def test_a_clock_before_the_start_of_the_project_is_an_error() -> None:
    assert checks.clock(0).state == "error"
    assert checks.clock(checks.EARLIEST_NS).state == "ok"


def test_the_command_prints_the_findings_as_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(checks, "MODULES", {"numpy": True})
    monkeypatch.setattr(checks, "SYSTEM_LIBRARIES", {})
    code = cli.main(["doctor", "--json", "--data-dir", str(tmp_path), "--connect", "tcp/127.0.0.1:1"])
    findings = json.loads(capsys.readouterr().out)
    assert {"check", "state", "detail", "advice"} == set(findings[0])
    assert code == (1 if any(f["state"] == "error" for f in findings) else 0)
    assert next(f for f in findings if f["check"] == "router")["state"] == "warning"
