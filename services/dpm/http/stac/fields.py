# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the fields of items: STAC API - Fields Extension (stac-api-extensions/fields).

Without a selection, items of a list contain what lists of results show; ``DETAILS`` are fields that only a
single item contains, or a list if they are included.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from cdff_common.errors import InputError

#: Fields that a selection contains unless the client excludes them.
_ALWAYS = [
    "id",
    "type",
    "geometry",
    "bbox",
    "links",
    "assets",
    "collection",
    "stac_version",
    "stac_extensions",
    "properties.datetime",
]
#: Largest number of names in a selection, and length of a name.
_MOST, _LONGEST = 100, 200


@dataclass(frozen=True, slots=True)
class Fields:
    """Names of fields to add to the smallest item, and to remove from it.

    Names are paths with dots; those of properties may omit ``properties.``.
    """

    include: frozenset[str]
    exclude: frozenset[str]

    @classmethod
    def of(cls, include: Iterable[str], exclude: Iterable[str]) -> Fields:
        """Return a selection; raises InputError if it is too long."""
        selection = cls(frozenset(map(_path, include)), frozenset(map(_path, exclude)))
        names = selection.include | selection.exclude
        if len(names) > _MOST or any(len(name) > _LONGEST for name in names):
            raise InputError(
                f"fields: {len(names)} names, expected at most {_MOST} of at most {_LONGEST} characters"
            )
        return selection

    @classmethod
    def parse(cls, text: str) -> Fields:
        """Return the selection of a query parameter: names with commas, those to remove after ``-``."""
        names = [name.strip() for name in text.split(",") if name.strip()]
        removed = [name[1:] for name in names if name.startswith("-")]
        return cls.of((name.lstrip("+") for name in names if not name.startswith("-")), removed)

    def applied(self, item: dict[str, Any]) -> dict[str, Any]:
        """Return the selected fields of an item."""
        included = self.include.union(_ALWAYS) - self.exclude
        selected = {
            name: value
            for name, value in item.items()
            if name not in self.exclude and (name in included or name == "properties")
        }
        if "properties" in selected and "properties" not in included:
            selected["properties"] = {
                name: value for name, value in item["properties"].items() if f"properties.{name}" in included
            }
        for path in self.exclude:
            _remove(selected, path.split("."))
        return selected


def _path(name: str) -> str:
    """Return the path of a name, which may omit ``properties.``."""
    first = name.partition(".")[0]
    return name if first in _TOP else f"properties.{name}"


_TOP = frozenset(name.partition(".")[0] for name in _ALWAYS)


def _remove(data: dict[str, Any], path: list[str]) -> None:
    """Remove the value at a path from nested data, whose changed parts are copied."""
    name, *subpath = path
    if name not in data:
        return
    if not subpath:
        del data[name]
    elif isinstance(data[name], dict):
        data[name] = dict(data[name])
        _remove(data[name], subpath)
