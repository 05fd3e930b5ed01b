# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters from a file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.yaml_file import read_mapping


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
        If a file or setting is invalid; the message states which.
    """
    merged: dict[str, Any] = {} if path is None else read_mapping(Path(path))
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
