# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff eval``: one verb for each module of ``cdff_dev.evaluate.verbs``.

A verb's module has a function ``add(verbs)`` that adds its parser and sets ``run``, and imports nothing heavy.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from cdff_dev.evaluate import verbs as package


def register(nouns: Any) -> None:
    """Add ``cdff eval`` with its verbs."""
    parser = nouns.add_parser("eval", help="compare results with truth")
    parser.set_defaults(parser=parser)
    verbs = parser.add_subparsers(metavar="VERB")
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda i: i.name):
        importlib.import_module(f"{package.__name__}.{info.name}").add(verbs)
