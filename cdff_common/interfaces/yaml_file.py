# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""YAML with the booleans ``true`` and ``false`` only, so that a sensor mode can be named ``off``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from cdff_common.errors import ConfigurationError

_BOOL_TAG = "tag:yaml.org,2002:bool"


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
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)  # a subclass of CSafeLoader
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: contains a {type(data).__name__}, expected a mapping")
    return data
