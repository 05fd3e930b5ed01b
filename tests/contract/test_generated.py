# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.interfaces.description import read_dfn_description
from cdff_dev.check import requirements
from cdff_dev.generate.artefacts import due
from cdff_dev.generate.interfaces import dfn_interface
from cdff_dev.generate.plan import GROUPS, plan
from cdff_dev.tree import Tree

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow  # `make lint` checks the same
@pytest.mark.req("CDFF-DEV-042")
@pytest.mark.parametrize("group", GROUPS)
def test_generated_files_are_up_to_date(group: str) -> None:
    tree = Tree.here()
    assert [a.path.relative_to(ROOT).as_posix() for a in due(plan(tree, [group]))] == []


def test_the_interface_of_the_example_plugin_is_the_generated_one() -> None:
    folder = ROOT / "examples/plugin_package/cdff_example_plugin/dfns/position_smoothing"
    generated = dfn_interface(Tree.here(), read_dfn_description(folder / "dfn.yaml"))
    assert (folder / "interface.py").read_text() == generated.text


def test_every_built_requirement_has_a_test_and_every_cited_id_exists() -> None:
    assert requirements.faults(ROOT) == []
