# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every InFuse name of a DFN or implementation resolves as the table of ``infuse-names.md`` states."""

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
#: Name of each InFuse DFN, and folder of its counterpart in this project or None.
TYPES = [(row[0].strip("`"), row[1].split("`")[1] if "`" in row[1] else None) for row in ROWS]
#: InFuse DFN, InFuse implementation, folder in this project, class in this project or "".
IMPLEMENTATIONS = [
    (row[0].strip("`"), name, *target.partition("/")[::2])
    for row in ROWS
    for name, target in re.findall(r"`(\w+)`: `([\w/]+)`", row[2])
]
#: InFuse implementations without counterpart; the fourth column lists names, a colon, and the reason.
ABSENT = [
    name
    for row in ROWS
    for part in re.findall(r"((?:`\w+`(?:, )?)+):", row[3])
    for name in part.split("`")[1::2]
]


def test_the_table_has_every_dfn_and_implementation_of_infuse() -> None:
    assert len(TYPES) == 39
    assert len(IMPLEMENTATIONS) + len(ABSENT) == 69


@pytest.mark.req("CDFF-CORE-030")
@pytest.mark.parametrize(("name", "folder"), TYPES)
def test_every_dfn_of_infuse_has_its_counterpart(name: str, folder: str | None) -> None:
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
def test_every_implementation_of_infuse_has_its_counterpart(
    dfn: str, name: str, folder: str, implementation: str
) -> None:
    registry = Registry.default()
    in_its_own_dfn = dict(TYPES)[dfn] == folder
    node = registry.make_dfn(dfn, name) if in_its_own_dfn else registry.make_dfn(name)
    node.configure()
    resolved_folder = (registry.dfn(dfn) if in_its_own_dfn else registry.dfn(name)).folder
    assert (resolved_folder, type(node).__name__ if implementation else "") == (folder, implementation)


@pytest.mark.parametrize("name", ABSENT)
def test_names_listed_as_missing_are_missing(name: str) -> None:
    registry = Registry.default()
    names = {
        n
        for package in registry.dfns.values()
        for n in (*package.description.implementations, package.description.name)
    }
    assert name not in names
    with pytest.raises(ConfigurationError):
        registry.resolve(name)
