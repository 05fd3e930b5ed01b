# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dfns.md``, ``dfpcs.md`` and a page for each DFN and DFPC: description, ports and parameters."""

from __future__ import annotations

from pathlib import Path

from cdff_common.interfaces.parameters import parameter_rows
from cdff_common.interfaces.registry import Registry
from cdff_dev.generate.python_source import render


def dfns() -> dict[str, str]:
    """Return the text of the index and of the page of each DFN, by path below ``docs/reference``."""
    registry = Registry.default()
    descriptions = {name: entry.description for name, entry in sorted(registry.dfns.items())}
    texts = {"dfns.md": render("dfns.md.j2", dfns=descriptions)}
    for name, dfn in descriptions.items():
        rows = {i: parameter_rows(type(registry.make_dfn(name, i)).Config) for i in dfn.implementations}
        texts[f"dfns/{name}.md"] = render("dfn.md.j2", name=name, dfn=dfn, rows=rows)
    return texts


def dfpcs(pages: Path) -> dict[str, str]:
    """Return the text of the index and of the page of each DFPC, by path below ``docs/reference``.

    The page has a link to the page of the DFPC in the folder ``pages``, if there is one.
    """
    registry = Registry.default()
    descriptions = {name: entry.description for name, entry in sorted(registry.dfpcs.items())}
    texts = {"dfpcs.md": render("dfpcs.md.j2", dfpcs=descriptions)}
    for name, dfpc in descriptions.items():
        rows = parameter_rows(registry.make_dfpc(name).config_model())
        has_page = (pages / f"{name}.md").is_file()
        texts[f"dfpcs/{name}.md"] = render("dfpc.md.j2", name=name, dfpc=dfpc, rows=rows, has_page=has_page)
    return texts
