# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Table of the results on measured data, next to those of other programs where a program exists.

Each evaluation with a function ``real_rows(figures) -> list[RealRow]`` adds rows. ``python -m evaluation
real`` runs these evaluations and writes ``docs/evaluation/real.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

NAME = "real"


class RealRow(NamedTuple):
    """A row of the table; texts, empty where there is no value.

    Attributes
    ----------
    quantity : str
        Data and quantity, with unit.
    previous : str
        Result before the work on real sensors, as measured then.
    cdff, peers : str
        Results of this framework and of other programs in the same run.
    required : str
        Required result.
    """

    quantity: str
    previous: str
    cdff: str
    peers: str
    required: str


def members(available: Mapping[str, ModuleType]) -> list[str]:
    """Return the names of the evaluations that have ``real_rows``."""
    return [name for name, module in available.items() if hasattr(module, "real_rows")]


def table(available: Mapping[str, ModuleType], figures: Mapping[str, dict[str, Any]]) -> str:
    """Return the table in Markdown.

    Parameters
    ----------
    available : mapping of str to module
        Evaluations by name.
    figures : mapping of str to dict
        Recorded results of each evaluation that has ``real_rows``.
    """
    lines = ["| evaluation | quantity | before | CDFF | other programs | required |", "|---" * 6 + "|"]
    for name in members(available):
        lines += [f"| `{name}` | {' | '.join(row)} |" for row in available[name].real_rows(figures[name])]
    return "\n".join(lines)
