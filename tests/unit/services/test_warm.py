# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import Found, Registry
from services import warm

SETUP = Path(__file__).resolve().parents[3] / "scripts" / "setup"


class Node:
    """Stands for a DFN; counts how often one was configured."""

    configured = 0

    def configure(self) -> None:
        type(self).configured += 1


def test_a_library_that_is_missing_leaves_one_dfn_cold_and_no_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    registry = Registry(failures={"broken": "broken/dfn.yaml: name is missing"})
    for name in ("First", "Heavy", "Last"):
        registry.dfns[name.lower()] = Found(
            "nowhere", Path("dfn.yaml"), DfnDescription(name=name, implementations=(name,))
        )

    def make(name: str, _implementation: str) -> Any:
        if name == "heavy":
            raise ImportError("libGL.so.1: cannot open shared object file")
        return Node()

    monkeypatch.setattr(Registry, "make_dfn", lambda self, name, implementation: make(name, implementation))
    monkeypatch.setattr(Registry, "default", classmethod(lambda cls: registry))
    monkeypatch.setattr(warm, "warm_wire", lambda: None)
    assert warm.main(["--algorithms"]) == 0
    said = capsys.readouterr()
    assert Node.configured == 2
    assert "not warmed: heavy.Heavy: ImportError: libGL.so.1" in said.err
    assert "not warmed: broken" in said.err
    assert "2 implementations" in said.out


def test_set_up_compiles_all_and_goes_on_where_that_is_not_possible() -> None:
    lines = SETUP.read_text(encoding="utf-8").splitlines()
    (line,) = [i for i, text in enumerate(lines) if "-m services.warm" in text]
    assert "--algorithms ||" in lines[line]
    assert "echo" in lines[line - 1]
    assert "echo" in lines[line + 1]
