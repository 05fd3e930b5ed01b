# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""By which names a DFN is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import Found, Registry


@pytest.fixture
def registry() -> Registry:
    made = Registry()
    for name in ("X1", "V2Filter", "LaserFilter"):
        description = DfnDescription(name=name)
        made.dfns[description.folder] = Found("nowhere", Path("dfn.yaml"), description)
    return made


@pytest.mark.parametrize("name", ["X1", "V2Filter", "LaserFilter"])
def test_class_name_and_folder_name_find_the_same(registry: Registry, name: str) -> None:
    by_class = registry.dfn(name)
    assert registry.dfn(by_class.folder) is by_class
    assert registry.resolve(by_class.folder) == ("dfn", by_class.folder)
