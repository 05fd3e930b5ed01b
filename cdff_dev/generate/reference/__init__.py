# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generated pages of ``docs/reference/``: one module for each kind of page."""

from __future__ import annotations

import re

from cdff_dev.generate.artefacts import Artefact
from cdff_dev.generate.reference import (
    command_line,
    descriptions,
    endpoints,
    keys,
    profile,
    ros_messages,
    sensor_faults,
    states,
    types,
)
from cdff_dev.tree import Tree


def pages(tree: Tree) -> list[Artefact]:
    """Return the generated reference pages of the installed packages."""
    texts = {
        **descriptions.dfns(),
        **descriptions.dfpcs(tree.root / "docs" / "dfpcs"),
        **types.pages(),
        **ros_messages.pages(),
        "keys.md": keys.page(),
        "profile.md": profile.page(),
        "sensor-faults.md": sensor_faults.page(),
        "orbit-scenarios.md": sensor_faults.orbit_page(),
        "endpoints.md": endpoints.page(),
        "cli.md": command_line.page(),
        "state-machines.md": states.page(),
    }
    return [
        Artefact(tree.root / "docs" / "reference" / name, _normalise_page(text))
        for name, text in texts.items()
    ]


def _normalise_page(text: str) -> str:
    """Return the page without repeated blank lines, and with one newline at its end."""
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"
