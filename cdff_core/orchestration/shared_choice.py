# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choice of one value for a subject that several holders share: the mode of a sensor, the implementation of a
DFPC.

It is a value that serves all holders if there is one, otherwise one that serves the holders of the highest
priority, among equals the earliest; the others are displaced.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

Subject = TypeVar("Subject", bound=tuple[str, str])


class _Demand(NamedTuple):
    """Demand of a holder: planned value, all acceptable values, priority, order of arrival."""

    value: str
    accepts: frozenset[str]
    priority: int
    number: int


@dataclass(slots=True)
class SharedChoices(Generic[Subject]):
    """Demands of holders, and the selected value of each subject."""

    _demands: dict[Subject, dict[str, _Demand]] = field(default_factory=dict)  # by subject and holder
    _selected: dict[Subject, str] = field(default_factory=dict)
    _avoided: dict[Subject, frozenset[str]] = field(default_factory=dict)

    def demand(
        self, subject: Subject, holder: str, value: str, accepts: Iterable[str], priority: int, number: int
    ) -> None:
        """Add the demand of a holder, and select a value."""
        demand = _Demand(value, frozenset({value, *accepts}), priority, number)
        self._demands.setdefault(subject, {})[holder] = demand
        self._select(subject)

    def release(self, holder: str) -> list[Subject]:
        """Remove all demands of a holder; return their subjects."""
        subjects = [s for s, demands in self._demands.items() if holder in demands]
        for subject in subjects:
            del self._demands[subject][holder]
            self._select(subject)
        return subjects

    def remove_robot(self, robot: str) -> None:
        """Remove the subjects of a robot."""
        for by_subject in (self._demands, self._selected, self._avoided):
            for subject in [s for s in by_subject if s[0] == robot]:
                del by_subject[subject]

    def without(self, holder: str) -> SharedChoices[Subject]:
        """Return the choices of all other holders."""
        demands = {
            subject: {h: d for h, d in held.items() if h != holder} if holder in held else held
            for subject, held in self._demands.items()
        }
        others = SharedChoices(demands, dict(self._selected), self._avoided)
        for subject, held in self._demands.items():
            if holder in held:
                others._select(subject)
        return others

    def avoid(self, values: Mapping[Subject, Iterable[str]]) -> None:
        """Select these values, which are impossible now, only if no other value serves the holders."""
        self._avoided = {subject: frozenset(names) for subject, names in values.items()}
        for subject in self._avoided.keys() & self._demands.keys():
            self._select(subject)

    @property
    def selected(self) -> Mapping[Subject, str]:
        """Selected value of each subject with a holder."""
        return self._selected

    def serving(self, subject: Subject, priority: int = -1) -> frozenset[str] | None:
        """Return the values that serve all holders of at least ``priority``; None without a holder."""
        accepted = [d.accepts for d in self._compatible(subject) if d.priority >= priority]
        return None if not accepted else frozenset.intersection(*accepted)

    def displaced(self, holder: str, subjects: Iterable[Subject] | None = None) -> dict[Subject, str]:
        """Return the subjects, by default of all, whose value a holder does not accept, with this value."""
        return {
            s: self._selected[s]
            for s in (self._demands if subjects is None else subjects)
            if (demand := self._demands.get(s, {}).get(holder)) and self._selected[s] not in demand.accepts
        }

    def _compatible(self, subject: Subject) -> list[_Demand]:
        """Return the demands that one value can serve, by descending priority; others are omitted."""
        common: frozenset[str] | None = None
        compatible = []
        for demand in sorted(self._demands.get(subject, {}).values(), key=lambda d: (-d.priority, d.number)):
            shared = demand.accepts if common is None else common & demand.accepts
            if shared:
                common = shared
                compatible.append(demand)
        return compatible

    def _select(self, subject: Subject) -> None:
        """Select a value that serves the demands: the current one, else the last planned one, else any."""
        compatible = self._compatible(subject)
        if not compatible:
            del self._demands[subject]
            self._selected.pop(subject, None)
            return
        common = frozenset.intersection(*(d.accepts for d in compatible))
        common = common - self._avoided.get(subject, frozenset()) or common
        if self._selected.get(subject) not in common:
            planned = [d.value for d in sorted(compatible, key=lambda d: -d.number) if d.value in common]
            self._selected[subject] = planned[0] if planned else min(common)
