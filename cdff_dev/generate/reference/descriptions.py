# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dfns.md`` and ``dfpcs.md``: descriptions with the parameters of what implements them."""

from __future__ import annotations

from pathlib import Path

from cdff_common.interfaces.parameters import ParameterRow, parameter_rows
from cdff_common.interfaces.registry import Registry
from cdff_dev.generate.python_source import render


def dfns() -> str:
    """Page of all DFNs."""
    registry = Registry.default()
    rows: dict[str, dict[str, list[ParameterRow]]] = {
        name: {i: parameter_rows(type(registry.make_dfn(name, i)).Config) for i in found.description.implementations}
        for name, found in registry.dfns.items()
    }
    descriptions = {name: found.description for name, found in sorted(registry.dfns.items())}
    return render("dfns.md.j2", dfns=descriptions, rows=rows)


def dfpcs(pages: Path) -> str:
    """Page of all DFPCs; where ``pages`` holds a page of one's own name, it is linked."""
    registry = Registry.default()
    rows = {name: parameter_rows(type(registry.make_dfpc(name)).Config) for name in registry.dfpcs}
    descriptions = {name: found.description for name, found in sorted(registry.dfpcs.items())}
    written = {name for name in descriptions if (pages / f"{name}.md").is_file()}
    return render("dfpcs.md.j2", dfpcs=descriptions, rows=rows, written=written)
