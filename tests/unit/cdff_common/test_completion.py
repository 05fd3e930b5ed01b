# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The completion scripts complete command lines in the shells themselves."""

from __future__ import annotations

import os
import pty
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cdff_common.completion import SHELLS

PATIENCE_S = 60.0
PYTHON = Path(sys.executable).parent
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if not name.startswith("_ARGCOMPLETE")},
    "PATH": f"{PYTHON}{os.pathsep}{os.environ['PATH']}",
    "TERM": "dumb",
}


@pytest.fixture(autouse=True)
def _needs_cdff() -> None:
    if not (PYTHON / "cdff").exists():
        pytest.skip("cdff is not installed as a command")


def shell(name: str) -> str:
    """Return a shell; skip the test if it is not installed."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def output_of(*command: str) -> str:
    result = subprocess.run(
        command, env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("name", SHELLS)
def test_the_script_is_valid_in_its_shell(name: str, tmp_path: Path) -> None:
    path = tmp_path / "script"
    path.write_text(output_of(str(PYTHON / "cdff"), "completion", name), encoding="utf-8")
    assert "cdff" in path.read_text(encoding="utf-8")
    output_of(shell(name), "-n", str(path))


def test_bash_completes_commands_and_options() -> None:
    lines = [
        'eval "$(cdff completion bash)"',
        'run() { COMP_LINE="$1"; COMP_POINT=${#1}; COMP_TYPE=9; COMP_WORDS=($1); COMP_CWORD=$2;',
        "  _python_argcomplete cdff; printf '%s\\n' \"${COMPREPLY[@]}\"; }",
        "run 'cdff req' 1; run 'cdff play log --st' 3",
    ]
    words = output_of(shell("bash"), "--norc", "-c", "\n".join(lines)).split()
    assert words[0] == "request"
    assert set(words[1:]) == {"--start", "--step"}


def test_fish_completes_commands_and_options() -> None:
    script = "cdff completion fish | source; complete -C 'cdff req'; complete -C 'cdff play log --st'"
    words = [line.split()[0] for line in output_of(shell("fish"), "--no-config", "-c", script).splitlines()]
    assert words == ["request", "--start", "--step"]


def test_zsh_completes_a_command_that_is_typed(tmp_path: Path) -> None:
    """The completion of zsh runs in its line editor: the keys come from a terminal."""
    zsh = shell("zsh")
    keyboard, end = pty.openpty()
    environment = {**ENVIRONMENT, "HOME": str(tmp_path), "ZDOTDIR": str(tmp_path), "TERM": "vt100"}
    process = subprocess.Popen(
        [zsh, "-f", "-i"], stdin=end, stdout=end, stderr=end, env=environment, start_new_session=True
    )
    os.close(end)
    os.set_blocking(keyboard, False)
    shown = ""

    def expect(text: str) -> None:
        nonlocal shown
        deadline_s = time.monotonic() + PATIENCE_S
        while text not in shown:
            if time.monotonic() > deadline_s:
                pytest.fail(f"{text!r} was not shown: {shown!r}")
            try:
                shown += os.read(keyboard, 4096).decode(errors="replace")
            except BlockingIOError:
                time.sleep(0.02)
        shown = ""

    try:
        start = 'autoload -U compinit; compinit -u; eval "$(cdff completion zsh)"; PS1=; echo is-"ready"\n'
        os.write(keyboard, start.encode())
        expect("is-ready")
        os.write(keyboard, b"cdff compl\t")
        expect("etion")
    finally:
        process.kill()
        process.wait()
        os.close(keyboard)
