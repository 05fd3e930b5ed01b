# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of running DFPCs that requests adjust: cell size, range and period.

The description of a DFPC lists its adjustable parameters (``adjustable``). A request for a finer resolution,
a distant region or more frequent products sets them for the DFPCs of its plan; several requests share the
union of their values, and without a request the parameters of the profile apply again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

#: Values that follow from a request, and whether the smallest one serves several requests (else the largest).
REQUESTED = {"resolution_m": True, "range_m": False, "period_s": True}


@dataclass(frozen=True, slots=True)
class Adjustable:
    """An adjustable parameter of a DFPC on a robot.

    Attributes
    ----------
    parameter, follows : str
        Name of the parameter, and the value of a request that sets it, a key of ``REQUESTED``.
    configured : float
        Value in the profile, else the default.
    least, greatest : float
        Bounds of the adjustment.
    """

    parameter: str
    follows: str
    configured: float
    least: float
    greatest: float

    def setting(self, requested: float) -> float | None:
        """Return the allowed value nearest to a requested one; None if the configured one fulfils the
        request.
        """
        value = min(max(requested, self.least), self.greatest)
        is_fulfilled = self.configured <= value if REQUESTED[self.follows] else self.configured >= value
        return None if is_fulfilled else value


def adjustables_of(description: Mapping[str, Any]) -> tuple[Adjustable, ...]:
    """Return the adjustable parameters in a description; raises KeyError, TypeError or ValueError."""
    return tuple(
        Adjustable(
            str(a["parameter"]),
            str(a["follows"]),
            float(a["configured"]),
            float(a["least"]),
            float(a["greatest"]),
        )
        for a in description.get("adjustable", ())
        if a["follows"] in REQUESTED
    )


def settings_for(adjustables: Iterable[Adjustable], requested: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of a DFPC that the values of a request set."""
    settings = {
        a.parameter: value
        for a in adjustables
        if a.follows in requested and (value := a.setting(requested[a.follows])) is not None
    }
    return dict(sorted(settings.items()))


def union(adjustables: Iterable[Adjustable], settings: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the settings that serve all holders of a DFPC: the smallest or largest of each parameter."""
    values: dict[str, list[float]] = {}
    for held in settings:
        for parameter, value in held.items():
            values.setdefault(parameter, []).append(value)
    prefers_smallest = {a.parameter: REQUESTED[a.follows] for a in adjustables}
    return {
        parameter: (min if prefers_smallest.get(parameter, True) else max)(held)
        for parameter, held in sorted(values.items())
    }
