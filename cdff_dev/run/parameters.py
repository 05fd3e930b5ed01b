# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters from a file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import ConfigurationError


def parameters(path: str | None, settings: list[str]) -> dict[str, Any]:
    """Merge the mapping of a YAML or JSON file with ``KEY=VALUE`` settings, which win.

    Parameters
    ----------
    path : str or None
    settings : list of str
        The value is YAML: a number, true, text, ``[1, 2]``. Dots in the key reach into mappings.

    Raises
    ------
    ConfigurationError
        Naming the file or setting that cannot be understood.
    """
    merged: dict[str, Any] = {} if path is None else _mapping(Path(path))
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not all(key.split(".")):
            raise ConfigurationError(f"--set {setting!r}: expected KEY=VALUE")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigurationError(f"--set {setting!r}: the value is no YAML: {error}") from error
        *parents, last = key.split(".")
        node = merged
        for parent in parents:
            node = node.setdefault(parent, {})
            if not isinstance(node, dict):
                raise ConfigurationError(
                    f"--set {setting!r}: {parent} holds a {type(node).__name__}, expected a mapping"
                )
        node[last] = value
    return merged


def _mapping(path: Path) -> dict[str, Any]:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if data is None:
        return {}
    if not isinstance(data, dict) or not all(isinstance(key, str) for key in data):
        raise ConfigurationError(f"{path}: expected a mapping of parameter names to values")
    return data
