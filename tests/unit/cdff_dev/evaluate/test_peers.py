# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a peer is found."""

from __future__ import annotations

import sys

import pytest

from cdff_dev.evaluate._peers import peer_python


def test_the_named_environment_goes_before_this_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CDFF_PEER_PYTHON", "elsewhere/bin/python")
    assert peer_python() == peer_python("numpy") == "elsewhere/bin/python"


def test_without_one_this_interpreter_serves_where_it_has_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CDFF_PEER_PYTHON", raising=False)
    assert peer_python("numpy") == sys.executable
    assert peer_python("no_such_package_here") is None
    assert peer_python() is None
