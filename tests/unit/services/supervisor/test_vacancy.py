# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A second system on the addresses or data of a running one ends before it starts a process."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from cdff_common.cli import main
from cdff_common.errors import UnavailableError
from cdff_common.process import lock_file
from services.supervisor.vacancy import check_vacant


@pytest.fixture
def served() -> Iterator[str]:
    """``host:port`` at which a process listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture
def free() -> str:
    """``host:port`` at which no process listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"127.0.0.1:{server.getsockname()[1]}"


def test_an_endpoint_or_http_address_in_use_is_named(served: str, free: str, tmp_path: Path) -> None:
    check_vacant(f"tcp/{free}", None, tmp_path)
    with pytest.raises(UnavailableError, match=f"router tcp/{served}: another process listens there"):
        check_vacant(f"tcp/{served}", None, tmp_path)
    port = served.rpartition(":")[2]
    with pytest.raises(UnavailableError, match=r"router tcp/0\.0\.0\.0"):
        check_vacant(f"tcp/0.0.0.0:{port}", None, tmp_path)
    with pytest.raises(UnavailableError, match=f"HTTP {served}: .* --http"):
        check_vacant(f"tcp/{free}", served, tmp_path)


def test_a_data_directory_in_use_is_named_with_its_process(free: str, tmp_path: Path) -> None:
    lock = lock_file(tmp_path / "store.lock", str(os.getpid()), str)
    with pytest.raises(UnavailableError, match=f"in use by process {os.getpid()}"):
        check_vacant(f"tcp/{free}", free, tmp_path)
    os.close(lock)
    check_vacant(f"tcp/{free}", free, tmp_path)


def test_a_second_up_on_one_router_ends_with_the_message_and_starts_nothing(
    served: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--profile", "explorer", "--connect", f"tcp/{served}", "--data-dir", str(tmp_path / "data")]
    assert main(["up", *arguments]) == 1
    assert "another process listens there, such as a running `cdff up`" in capsys.readouterr().err


def test_up_refuses_a_profile_with_all_its_faults_one_line_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("name: wrong\nbody: {name: mooon}\nrobots:\n- id: pico\n  limits: {max_slope: 20}\n")
    assert main(["up", "--profile", str(path), "--data-dir", str(tmp_path / "data")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[1] for line in lines] == [f"{path}:2", f"{path}:5"]
    assert "did you mean 'moon'?" in lines[0]
    assert "did you mean 'max_slope_deg'?" in lines[1]
    assert not (tmp_path / "data").exists()
