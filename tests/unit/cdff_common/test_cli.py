# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import errno
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any

import pytest

from cdff_common import cli
from cdff_common.errors import DegenerateGeometryError, InputError


def _register(nouns: Any) -> None:
    parser = nouns.add_parser("fake", help="return the given exit code")
    parser.add_argument("--how", default="succeed")
    parser.set_defaults(run=_run)


def _run(args: Any) -> int:
    match args.how:
        case "succeed":
            return 0
        case "known":
            raise InputError("points: 3 given,\nexpected at least 10")
        case "refused":
            raise DegenerateGeometryError("a plane", directions=["x"])
        case "interrupted":
            raise KeyboardInterrupt
        case _:
            raise ZeroDivisionError("a bug")


class _Entry:
    def __init__(self, name: str, load: Callable[[], Any]) -> None:
        self.name, self.value, self.load = name, f"somewhere:{name}", load


def _broken() -> None:
    raise ImportError("no module named nothing")


def _unwanted() -> None:
    raise AssertionError("a command was loaded that was not requested")


@pytest.fixture
def entries(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def use(**loads: Callable[[], Any]) -> None:
        monkeypatch.setattr(cli, "entry_points", lambda group: [_Entry(n, f) for n, f in loads.items()])

    return use


@pytest.mark.parametrize(
    ("how", "code"), [("succeed", 0), ("known", 1), ("refused", 3), ("crash", 70), ("interrupted", 130)]
)
def test_the_exit_code_states_the_kind_of_failure(entries: Callable[..., None], how: str, code: int) -> None:
    entries(fake=lambda: _register)
    assert cli.main(["fake", "--how", how]) == code


def test_known_error_is_one_line_without_a_traceback(
    entries: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    entries(fake=lambda: _register)
    cli.main(["fake", "--how", "known"])
    assert capsys.readouterr().err == "cdff: points: 3 given, expected at least 10\n"


def test_bug_shows_its_traceback(entries: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    entries(fake=lambda: _register)
    cli.main(["fake", "--how", "crash"])
    assert "ZeroDivisionError: a bug" in capsys.readouterr().err


def test_unknown_noun_is_a_usage_error(
    entries: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    entries(fake=lambda: _register)
    assert cli.main(["nonsense"]) == 2
    assert "fake" in capsys.readouterr().err


def test_no_noun_shows_help_and_is_a_usage_error(
    entries: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    entries(fake=lambda: _register)
    assert cli.main([]) == 2
    assert "fake" in capsys.readouterr().err


def test_only_the_requested_noun_is_loaded(entries: Callable[..., None]) -> None:
    entries(fake=lambda: _register, other=_unwanted)
    assert cli.main(["fake"]) == 0


def test_a_noun_registered_by_an_entry_with_another_name_is_found(entries: Callable[..., None]) -> None:
    entries(several=lambda: _register)
    assert cli.main(["fake"]) == 0


def test_a_broken_command_is_reported_and_the_others_work(
    entries: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    entries(fake=lambda: _register, broken=_broken)
    assert cli.main(["--help"]) == 0
    captured = capsys.readouterr()
    assert "fake" in captured.out
    assert "'broken' (somewhere:broken) did not load: no module named nothing" in captured.err
    assert cli.main(["broken"]) == 1


def test_installed_commands_all_load() -> None:
    for entry in cli.entry_points(group=cli.GROUP):
        assert isinstance(entry, EntryPoint)
        assert callable(entry.load()), entry


def test_help_imports_no_heavy_module() -> None:
    heavy = ["numpy", "zenoh", "open3d", "cv2", "fastapi", "sqlalchemy", "numba", "scipy", "rasterio"]
    code = (
        "import sys; from cdff_common import cli; cli.main(['--help']); "
        f"print([m for m in {heavy!r} if m in sys.modules], file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stderr.strip() == "[]"


def test_a_missing_library_is_a_known_error_and_another_missing_module_a_bug(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def missing(name: str) -> int:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    assert cli.run_safely(lambda: missing("cv2")) == cli.EXIT_ERROR
    assert capsys.readouterr().err == "cdff: cv2 is not installed: pip install 'cdff[core]'\n"
    assert cli.run_safely(lambda: missing("cdff_core.nowhere")) == cli.EXIT_BUG


def test_a_file_without_permission_is_a_known_error(capsys: pytest.CaptureFixture[str]) -> None:
    def read() -> int:
        raise PermissionError(errno.EACCES, "Permission denied", "/data/scans")

    assert cli.run_safely(read) == cli.EXIT_ERROR
    assert capsys.readouterr().err == "cdff: /data/scans: Permission denied\n"


def test_an_interrupted_kernel_is_no_bug(capsys: pytest.CaptureFixture[str]) -> None:
    def compute() -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interruption:
            raise SystemError("returned a result with an exception set") from interruption

    assert cli.run_safely(compute) == 130
    assert capsys.readouterr().err == ""
