# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The generated pages of ``docs/reference/``: one module per page or pair of pages."""

from __future__ import annotations

import re

from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.reference import command_line, descriptions, endpoints, keys, states, types
from cdff_dev.generate.tree import Tree


def pages(tree: Tree) -> list[Artefact]:
    """Every generated reference page, made from what is installed."""
    texts = {
        "dfns.md": descriptions.dfns(),
        "dfpcs.md": descriptions.dfpcs(tree.root / "docs" / "dfpcs"),
        **types.pages(),
        "keys.md": keys.page(),
        "endpoints.md": endpoints.page(),
        "cli.md": command_line.page(),
        "state-machines.md": states.page(),
    }
    return [Artefact(tree.root / "docs" / "reference" / name, _tidy(text)) for name, text in texts.items()]


def _tidy(text: str) -> str:
    """The page with one blank line where templates left several, and one line end at its end."""
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"
