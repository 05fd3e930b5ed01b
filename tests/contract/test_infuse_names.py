# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each name of InFuse's DFNs and implementations finds what its table says, or nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.registry import Registry

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "infuse-names.md"
ROWS = [
    [cell.strip() for cell in line.strip().strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| `")
]
#: DFN, folder.
TYPES = [(row[0].strip("`"), row[1].split("`")[1] if "`" in row[1] else None) for row in ROWS]
#: DFN, implementation, folder, class or "".
IMPLEMENTATIONS = [
    (row[0].strip("`"), name, *target.partition("/")[::2])
    for row in ROWS
    for name, target in re.findall(r"`(\w+)`: `([\w/]+)`", row[2])
]
#: Names before a colon are not here.
ABSENT = [
    name for row in ROWS for part in re.findall(r"((?:`\w+`(?:, )?)+):", row[3]) for name in part.split("`")[1::2]
]


def test_the_table_has_every_dfn_and_implementation_of_infuse() -> None:
    assert len(TYPES) == 39
    assert len(IMPLEMENTATIONS) + len(ABSENT) == 69


@pytest.mark.req("CDFF-CORE-030")
@pytest.mark.parametrize(("name", "folder"), TYPES)
def test_a_dfn_of_infuse_finds_what_does_the_same(name: str, folder: str | None) -> None:
    registry = Registry.default()
    if folder is None:
        with pytest.raises(ConfigurationError):
            registry.resolve(name)
    elif folder in registry.dfns:
        assert registry.dfn(name).folder == folder
        registry.make_dfn(name).configure()
    else:
        assert registry.resolve(name) == ("dfpc", folder)
        registry.make_dfpc(name).configure({})


@pytest.mark.parametrize(("dfn", "name", "folder", "implementation"), IMPLEMENTATIONS)
def test_an_implementation_of_infuse_finds_what_does_the_same(
    dfn: str, name: str, folder: str, implementation: str
) -> None:
    registry = Registry.default()
    known = dict(TYPES)[dfn] == folder
    made = registry.make_dfn(dfn, name) if known else registry.make_dfn(name)
    made.configure()
    found = (registry.dfn(dfn) if known else registry.dfn(name)).folder
    assert (found, type(made).__name__ if implementation else "") == (folder, implementation)


@pytest.mark.parametrize("name", ABSENT)
def test_what_the_table_says_is_not_here_is_not(name: str) -> None:
    registry = Registry.default()
    names = {
        n for found in registry.dfns.values() for n in (*found.description.implementations, found.description.name)
    }
    assert name not in names
    with pytest.raises(ConfigurationError):
        registry.resolve(name)
