# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import DiscoveredPackage, Registry
from services import warm

SETUP = Path(__file__).resolve().parents[3] / "scripts" / "setup"


class Node:
    """DFN double that counts its configurations."""

    configured = 0

    def configure(self) -> None:
        type(self).configured += 1


def test_a_dfn_with_a_missing_library_is_reported_and_the_others_are_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    registry = Registry()
    for name in ("First", "Heavy", "Last"):
        registry.dfns[name.lower()] = DiscoveredPackage(
            "nowhere", Path("dfn.yaml"), DfnDescription(name=name, implementations=(name,))
        )

    def make(name: str, _implementation: str) -> Any:
        if name == "heavy":
            raise ImportError("libGL.so.1: cannot open shared object file")
        return Node()

    monkeypatch.setattr(Registry, "make_dfn", lambda self, name, implementation: make(name, implementation))
    monkeypatch.setattr(Registry, "default", classmethod(lambda cls: registry))
    reasons = [warm.compile_task(task) for task in warm.algorithm_tasks()]
    assert Node.configured == 2
    assert reasons == ["", "ImportError: libGL.so.1: cannot open shared object file", ""]


def test_each_dfpc_of_a_profile_is_compiled_once() -> None:
    tasks = warm.profile_tasks("two_rovers")
    assert tasks
    assert len({task.name for task in tasks}) == len(tasks)


def test_set_up_compiles_a_profile_and_continues_after_a_failure() -> None:
    lines = SETUP.read_text(encoding="utf-8").splitlines()
    (index,) = [i for i, text in enumerate(lines) if "-m services.warm" in text]
    assert "--profile rover_traverse ||" in lines[index]
    assert "echo" in lines[index - 1]
    assert "echo" in lines[index + 1]
