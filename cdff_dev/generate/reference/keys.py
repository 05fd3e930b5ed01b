# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``keys.md``: all key expressions, from the functions of ``cdff_common.bus.keys``."""

from __future__ import annotations

import inspect
import re

from cdff_common.bus import keys
from cdff_dev.generate.python_source import render

#: Argument for a product id, which must be a UUID; it is replaced by ``{product_id}`` on the page.
_EXAMPLE_ID = "00000000-0000-5000-8000-000000000000"


def page() -> str:
    """Return the page of all keys."""
    functions = [f for _, f in inspect.getmembers(keys, inspect.isfunction) if f.__module__ == keys.__name__]
    public = sorted(
        (f for f in functions if not f.__name__.startswith("_")), key=lambda f: f.__code__.co_firstlineno
    )
    rows = []
    for function in public:
        names = list(inspect.signature(function).parameters)
        if "wiring" in names:
            continue  # the function returns one of the keys above
        rows.append(
            (function.__name__, _pattern(function(*map(_argument, names)), names), inspect.getdoc(function))
        )
    return render("keys.md.j2", rows=rows, clock=keys.CLOCK)


def _argument(name: str) -> str:
    return _EXAMPLE_ID if name == "product_id" else f"x_{name}_x"


def _pattern(key: str, names: list[str]) -> str:
    for name in names:
        key = re.sub(re.escape(_argument(name)), f"{{{name}}}", key)
    return key
