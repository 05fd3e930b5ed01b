# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of the fields of a profile; the valid part remains for the checks across fields.

All wrong values are found at once: each is removed, with the item that cannot exist without it, until the
rest is valid.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from cdff_common.interfaces.profile import LENIENT, Profile
from cdff_common.interfaces.profile_checks.expectations import finding_of
from cdff_common.interfaces.profile_checks.faults import ABSENT, Finding
from cdff_common.interfaces.yaml_file import Location

#: Passes after which no valid part is left to expect.
_MOST_PASSES = 50


@dataclass(slots=True)
class Reading:
    """Valid part of a profile and the findings of the other part.

    Attributes
    ----------
    profile : Profile or None
        Valid part; None if nothing is valid.
    findings : list of Finding
        One for each wrong value.
    removed : set of Location
        Locations in the data that are not in ``profile``.
    """

    data: dict[str, Any]
    profile: Profile | None = None
    findings: list[Finding] = field(default_factory=list)
    removed: set[Location] = field(default_factory=set)
    _origins: dict[Location, list[int]] = field(default_factory=dict)

    def origin(self, location: Location) -> Location:
        """Return the location in the data of a location in the valid part."""
        original: Location = ()
        for depth, key in enumerate(location):
            indices = self._origins.get(location[:depth])
            is_moved = isinstance(key, int) and indices is not None and key < len(indices)
            original = (*original, indices[key] if is_moved else key)  # type: ignore[index]
        return original

    def is_unreadable(self, *location: str | int) -> bool:
        """Return True if a value at, above or below a location of the valid part was removed."""
        place = self.origin(location)
        return any(r[: len(place)] == place or place[: len(r)] == r for r in self.removed)

    def prune(self) -> dict[str, Any]:
        """Return the data without the removed locations."""
        self._origins.clear()
        return {"name": "unnamed", **self._prune(self.data, (), ())}

    def _prune(self, data: Any, original: Location, place: Location) -> Any:
        """Return the data without the removed entries, and record the original indices of lists."""
        if isinstance(data, dict):
            return {
                key: self._prune(value, (*original, key), (*place, key))
                for key, value in data.items()
                if (*original, str(key)) not in self.removed
            }
        if isinstance(data, list):
            indices = [i for i in range(len(data)) if (*original, i) not in self.removed]
            self._origins[place] = indices
            return [self._prune(data[i], (*original, i), (*place, new)) for new, i in enumerate(indices)]
        return data


def read(data: dict[str, Any]) -> Reading:
    """Validate the fields of a profile."""
    reading = Reading(data)
    if "name" not in data:
        reading.findings.append(Finding(("name",), "missing, expected a name of the mission", ABSENT))
    for _ in range(_MOST_PASSES):
        pruned = reading.prune()
        try:
            reading.profile = Profile.model_validate(pruned, context={LENIENT: True})
        except ValidationError as error:
            errors = [(e, *_in_data(pruned, e["loc"])) for e in error.errors()]
            places = [place for _, place, _ in errors]
            removable = [
                _remove(reading, e, place)
                for e, place, is_exact in errors
                # The length of a list with wrong items and the other alternatives of a union are no faults.
                if (is_exact and e["type"] != "too_short")
                or not any(len(p) > len(place) and p[: len(place)] == place for p in places)
            ]
            if () in removable:  # the top level itself is not usable
                break
            reading.removed.update(removable)
        else:
            break
    return reading


def _remove(reading: Reading, error: ErrorDetails, place: Location) -> Location:
    """Add the finding of an error, unless a removal caused it; return the location to remove."""
    place = reading.origin(place)
    if error["type"] == "missing":
        missing = (*place, str(error["loc"][-1]))
        if missing not in reading.removed:
            reading.findings.append(finding_of(error, missing, reading.data))
        return place
    if error["type"] == "too_short" and any(r[:-1] == place for r in reading.removed):
        return place  # all items of the list are removed
    finding = finding_of(error, place, reading.data)
    same = next((f for f in reading.findings if f.location == place), None)
    if same is None:
        reading.findings.append(finding)
    elif finding.problem not in same.problem:
        joined = f"{same.problem}, or {finding.problem.removeprefix('expected ')}"
        reading.findings[reading.findings.index(same)] = replace(same, problem=joined)
    return place


def _in_data(data: Any, location: tuple[int | str, ...]) -> tuple[Location, bool]:
    """Return the part of the location of an error that is in the data, and whether it is all of it.

    The location of an error also names the alternatives of a union and marks keys.
    """
    place: Location = ()
    is_exact = True
    for key in location:
        try:
            inner = data[key]
        except (KeyError, IndexError, TypeError):
            is_exact = is_exact and key == "[key]"
            continue
        place = (*place, key if isinstance(data, list) else str(key))
        data = inner
    return place, is_exact
