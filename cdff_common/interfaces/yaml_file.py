# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""YAML with the booleans ``true`` and ``false`` only, so that a sensor mode can be named ``off``.

Locations are tuples of keys and list indices, such as ``("robots", 0, "id")``, with their line numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import ConfigurationError

_BOOL_TAG = "tag:yaml.org,2002:bool"

#: Keys and list indices from the top of a document.
Location = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class LocatedMapping:
    """Content of a YAML file with line numbers, counted from 1.

    Attributes
    ----------
    data : dict
    lines : mapping of Location to int
        Line of each key and list item; of a repeated key the last one, as in ``data``.
    repeated : tuple of (Location, int)
        Keys that occur again in their mapping, with the line of their earlier occurrence.
    """

    data: dict[str, Any]
    lines: dict[Location, int]
    repeated: tuple[tuple[Location, int], ...]

    def line(self, location: Location) -> int:
        """Return the line of a location, else that of the nearest enclosing item."""
        while location not in self.lines and location:
            location = location[:-1]
        return self.lines.get(location, 1)


class _Loader(yaml.CSafeLoader):
    """Safe loader of libyaml with the booleans of YAML 1.2 (``yes no on off`` are text)."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _BOOL_TAG]
    for first, resolvers in yaml.CSafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(_BOOL_TAG, re.compile(r"(?:true|True|TRUE|false|False|FALSE)\Z"), list("tTfF"))


def read_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file with one mapping.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, is not YAML, or contains something else.
    """
    return _read(path)[0]


def read_located_mapping(path: Path) -> LocatedMapping:
    """Read a YAML file with one mapping, and the line numbers of its keys; raises like ``read_mapping``."""
    data, node = _read(path)
    lines: dict[Location, int] = {}
    repeated: list[tuple[Location, int]] = []
    for location, line in _places(node, ()):
        is_nested = any(location[: len(outer)] == outer for outer, _ in repeated)
        if location in lines and not is_nested:
            repeated.append((location, lines[location]))
        lines[location] = line
    return LocatedMapping(data, lines, tuple(repeated))


def _read(path: Path) -> tuple[dict[str, Any], yaml.Node]:
    """Return the mapping of a file and its YAML node, for line numbers; raises ConfigurationError."""
    try:
        loader = _Loader(path.read_text(encoding="utf-8"))
        try:
            node = loader.get_single_node()
            data = None if node is None else loader.construct_document(node)
        finally:
            loader.dispose()
    except (yaml.MarkedYAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark is not None else str(path)
        problem = getattr(error, "problem", None) or "nested too deeply"
        raise ConfigurationError(f"{where}: is no YAML: {problem}") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if node is None or not isinstance(data, dict):
        raise ConfigurationError(f"{path}: contains a {type(data).__name__}, expected a mapping")
    return data, node


def _places(node: yaml.Node, location: Location) -> Iterator[tuple[Location, int]]:
    """Yield the location and line of each key and list item below a node."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner = (*location, str(key.value))
            yield inner, key.start_mark.line + 1
            yield from _places(value, inner)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            yield (*location, index), item.start_mark.line + 1
            yield from _places(item, (*location, index))
