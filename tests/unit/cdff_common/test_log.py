# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Repeated warnings are suppressed and counted."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cdff_common import log
from cdff_common.log import RepetitionFilter, TextLines, configure_logging


def record(template: str, *arguments: object, level: int = logging.WARNING) -> logging.LogRecord:
    return logging.LogRecord("bus", level, "", 0, template, arguments, None)


def test_a_flood_of_warnings_is_limited_and_counted() -> None:
    now_s = 0.0
    filter_ = RepetitionFilter(limit=3, period_s=60.0, now_s=lambda: now_s)
    passed = [filter_.filter(record("malformed message on %s", i)) for i in range(1000)]
    assert passed == [True] * 3 + [False] * 997
    assert filter_.filter(record("another message")), "each template has its own limit"
    assert all(filter_.filter(record("sensor mode", level=logging.INFO)) for _ in range(100))
    now_s = 61.0
    following = record("malformed message on %s", "key")
    assert filter_.filter(following)
    assert following.__dict__["suppressed"] == 997


def test_the_log_file_of_a_process_has_a_bounded_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log, "LOG_BYTES", 2000)
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    try:
        configure_logging("mapping", "INFO", tmp_path)
        for number in range(200):
            logging.getLogger("test").info("line %d", number)
        root.handlers[0].close()
    finally:
        root.handlers[:] = handlers
        root.setLevel(level)
    sizes = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    assert set(sizes) == {"mapping.log", "mapping.log.1", "mapping.log.2", "mapping.log.3"}
    assert max(sizes.values()) <= 2000
    lines = (tmp_path / "mapping.log").read_text().splitlines()
    assert json.loads(lines[-1])["message"] == "line 199"


SERVICE = """
import logging
from cdff_common.process import run_service
raise SystemExit(run_service("probe", lambda stop: logging.getLogger("test").info("ready")))
"""


def run_probe(folder: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"CDFF_LOG_DIR": str(folder)}
    command = [sys.executable, "-c", SERVICE]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_service_writes_its_log_into_the_folder_of_the_environment(tmp_path: Path) -> None:
    result = run_probe(tmp_path / "logs")
    assert (result.returncode, result.stderr) == (0, "")
    assert json.loads((tmp_path / "logs" / "probe.log").read_text())["message"] == "ready"


def test_a_folder_of_logs_that_cannot_be_made_ends_the_service_with_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run_probe(tmp_path / "file" / "logs")
    assert result.returncode == 1
    assert str(tmp_path / "file" / "logs") in json.loads(result.stderr)["message"]


def test_lines_for_people_have_time_level_service_and_message() -> None:
    line = TextLines("dpm").format(record("malformed message on %s", "key"))
    assert line[8:] == " WARNING  dpm: malformed message on key"
