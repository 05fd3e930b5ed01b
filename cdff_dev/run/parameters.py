# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters from a configuration file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.yaml_file import read_mapping


def parameters(path: str | None, settings: list[str]) -> dict[str, Any]:
    """Return the mapping of a YAML or JSON file, changed by ``KEY=VALUE`` settings.

    Parameters
    ----------
    path : str or None
    settings : list of str
        The value is YAML, such as a number, ``true``, a text or ``[1, 2]``. Dots in the key address nested
        mappings.

    Raises
    ------
    ConfigurationError
        If the file or a setting is invalid.
    """
    merged: dict[str, Any] = {} if path is None else read_mapping(Path(path))
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not all(key.split(".")):
            raise ConfigurationError(f"--set {setting!r}: expected KEY=VALUE")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigurationError(f"--set {setting!r}: the value is not valid YAML: {error}") from error
        *parents, last = key.split(".")
        node = merged
        for parent in parents:
            node = node.setdefault(parent, {})
            if not isinstance(node, dict):
                raise ConfigurationError(
                    f"--set {setting!r}: {parent} is a {type(node).__name__}, expected a mapping"
                )
        node[last] = value
    return merged
