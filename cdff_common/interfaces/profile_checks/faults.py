# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of a profile: file, line, key, value, expectation and the nearest known name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from cdff_common.interfaces.yaml_file import Location

Severity = Literal["error", "warning"]
#: Longest text of a value, and number of expected names in a message.
_LONGEST_VALUE, _MOST_NAMES = 60, 12
#: Least similarity of a name that is suggested (``difflib``): one wrong letter in four.
_LEAST_SIMILARITY = 0.7


@dataclass(frozen=True, slots=True)
class Finding:
    """Fault at a location of the data, before its line is known.

    Attributes
    ----------
    location : Location
    problem : str
        Problem and expectation.
    value : Any
        Wrong value; ``ABSENT`` if there is none to show.
    nearest : str
        Known name that is closest to a wrong one; empty if none is close.
    """

    location: Location
    problem: str
    value: Any = None
    nearest: str = ""
    severity: Severity = "error"


#: Value of a finding without a value to show.
ABSENT = object()


@dataclass(frozen=True, slots=True)
class ProfileFault:
    """Fault or implausible value of a profile.

    Attributes
    ----------
    file, line, key
        Place; ``key`` has the names of list items, e.g. ``robots.mana.sensors.imu.kind``.
    value : str
        Text of the value; empty if there is none.
    problem : str
        Problem and expectation.
    nearest : str
        Known name that was probably meant; empty if none is close.
    """

    file: str
    line: int
    key: str
    value: str
    problem: str
    nearest: str
    severity: Severity

    def __str__(self) -> str:
        value = f" = {self.value}" if self.value else ""
        hint = f"; did you mean {self.nearest!r}?" if self.nearest else ""
        kind = "warning: " if self.severity == "warning" else ""
        return f"{self.file}:{self.line}: {kind}{self.key}{value}: {self.problem}{hint}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        return asdict(self)


def nearest_name(name: object, known: Iterable[str]) -> str:
    """Return the known name that is closest to a wrong one, or an empty string."""
    names = {known_name.lower(): known_name for known_name in known}
    matches = difflib.get_close_matches(str(name).lower(), names, n=1, cutoff=_LEAST_SIMILARITY)
    return names[matches[0]] if matches and names[matches[0]] != name else ""


def nearest_frame(frame: str, known: Iterable[str]) -> str:
    """Return the known frame whose last part is closest to that of a wrong frame, or an empty string."""
    last_parts = {name.rsplit("/", maxsplit=1)[-1]: name for name in sorted(known)}
    last = frame.rsplit("/", maxsplit=1)[-1]
    return last_parts.get(last) or last_parts.get(nearest_name(last, last_parts), "")


def one_of(known: Iterable[str]) -> str:
    """Return ``one of a, b, c`` for a message, at most twelve of the names."""
    names = list(known)
    remainder = f", … ({len(names)} in all)" if len(names) > _MOST_NAMES else ""
    return f"one of {', '.join(names[:_MOST_NAMES]) or 'none'}{remainder}"


def unknown_name(location: Location, name: object, kind: str, known: Iterable[str]) -> Finding:
    """Return the finding of a name that is not known."""
    names = list(known)
    return Finding(location, f"no such {kind}; expected {one_of(names)}", name, nearest_name(name, names))


def short(value: Any) -> str:
    """Return the text of a value, at most 60 characters; empty for ``ABSENT`` and collections."""
    if value is ABSENT or value is None or isinstance(value, dict):
        return ""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 1] + "…"


def key_text(data: Any, location: Location) -> str:
    """Return a location as text; list items with ``id`` or ``name`` are shown by it."""
    parts: list[str] = []
    for key in location:
        item = _item(data, key)
        if isinstance(key, int) and parts:
            name = (item.get("id") or item.get("name")) if isinstance(item, dict) else None
            if isinstance(name, str):
                parts.append(name)
            else:
                parts[-1] += f"[{key}]"
        else:
            parts.append(str(key))
        data = item
    return ".".join(parts) or "profile"


def _item(data: Any, key: str | int) -> Any:
    try:
        return data[key]
    except (KeyError, IndexError, TypeError):
        return None
