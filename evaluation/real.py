# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Results on real sensors: one table of all evaluations that compare with other programs on measured data.

An evaluation takes part by a function ``real_rows(figures) -> list[RealRow]``. ``python -m evaluation real``
runs all of them and writes ``docs/evaluation/real.md``.
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
    """Return the names of the evaluations that take part."""
    return [name for name, module in available.items() if hasattr(module, "real_rows")]


def table(available: Mapping[str, ModuleType], figures: Mapping[str, dict[str, Any]]) -> str:
    """Return the table of all rows; ``figures`` are the results by evaluation."""
    lines = ["| evaluation | quantity | before | CDFF | other programs | required |", "|---" * 6 + "|"]
    for name in members(available):
        lines += [f"| `{name}` | {' | '.join(row)} |" for row in available[name].real_rows(figures[name])]
    return "\n".join(lines)
