# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_dev.check import requirements
from cdff_dev.generate.artefacts import due
from cdff_dev.generate.plan import GROUPS, plan
from cdff_dev.generate.tree import Tree

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.req("CDFF-DEV-042")
@pytest.mark.parametrize("group", GROUPS)
def test_generated_files_are_up_to_date(group: str) -> None:
    tree = Tree.here()
    assert [a.path.relative_to(ROOT).as_posix() for a in due(plan(tree, [group]))] == []


def test_every_built_requirement_is_named_by_a_test_and_every_id_exists() -> None:
    assert requirements.faults(ROOT) == []
