# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Python interpreter that runs a peer."""

from __future__ import annotations

import sys

import pytest

from evaluation.peers.environments import peer_python


def test_the_named_environment_precedes_the_current_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CDFF_PEER_PYTHON", "elsewhere/bin/python")
    assert peer_python() == peer_python("numpy") == "elsewhere/bin/python"


def test_the_current_interpreter_is_used_if_it_has_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("CDFF_PEER_PYTHON", raising=False)
    assert peer_python("numpy") == sys.executable
    assert peer_python("no_such_package_here") is None
    assert peer_python() is None
