# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Budgets of a robot that DFPCs and sensors share: memory, CPU time, power, heat and data volume.

A limit of the profile (``limits``) is a budget. The power of a DFPC is that of its CPU time, which all
becomes heat; a sensor has power, heat and data volume in each mode.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

#: Limits of a robot that are budgets, with their units.
BUDGET_UNITS = {
    "memory_mb": "MB",
    "cpu_cores": "cores",
    "power_w": "W",
    "heat_w": "W of heat",
    "data_mb_h": "MB/h",
}
#: Amounts by budget.
Amounts: TypeAlias = Mapping[str, float]

#: Relative tolerance of a comparison of sums.
_TOLERANCE = 1e-9


def added(amounts: Iterable[Amounts]) -> dict[str, float]:
    """Return the sum of amounts, by budget."""
    total: dict[str, float] = {}
    for amount in amounts:
        for budget, value in amount.items():
            total[budget] = total.get(budget, 0.0) + value
    return total


def excess(needed: Amounts, free: Amounts) -> tuple[str, float, float] | None:
    """Return the first budget that is exceeded, with the needed and the free amount; None if all fit.

    Budgets without a limit are not in ``free``.
    """
    for budget, limit in free.items():
        value = needed.get(budget, 0.0)
        if value > 0.0 and value > limit + abs(limit) * _TOLERANCE:
            return budget, value, limit
    return None


def excess_fraction(needed: Amounts, free: Amounts) -> float:
    """Return by how much the budgets are exceeded: the sum of the excess of each, relative to its limit."""
    excesses = ((needed.get(budget, 0.0) - limit) / (abs(limit) or 1.0) for budget, limit in free.items())
    return sum(max(value, 0.0) for value in excesses)
