# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The notice appears only if configuring takes longer than usual."""

from __future__ import annotations

import threading

import pytest

from cdff_dev import compilation
from cdff_dev.compilation import compilation_notice


def test_a_long_configuration_is_announced_with_the_command_that_avoids_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    announced = threading.Event()
    print_notice = compilation._print_notice

    def announce(name: str) -> None:
        print_notice(name)
        announced.set()

    monkeypatch.setattr(compilation, "_print_notice", announce)
    with compilation_notice("point_cloud_matching", after_s=0.01):
        assert announced.wait(10.0)
    message = capsys.readouterr().err
    assert message.startswith("point_cloud_matching: compiling kernels")
    assert "make warm" in message


def test_a_short_configuration_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    before = set(threading.enumerate())
    with compilation_notice("point_cloud_matching", after_s=3600.0):
        (timer,) = set(threading.enumerate()) - before
    timer.join(timeout=10.0)
    assert not timer.is_alive()
    assert capsys.readouterr().err == ""
