# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The plain form of a message as JSON has it, and back: JSON has neither octets nor numbers that are not finite.

Octets are text of hexadecimal digits; what is not finite is null, and NaN when read again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cdff_common.codecs.bridge import message_node
from cdff_common.codecs.plain import from_plain
from cdff_common.codecs.schema import Alias, Choice, ListOf, Node, Octets, Struct
from cdff_common.errors import CodecError


def json_safe(value: Any) -> Any:
    """Plain data with what JSON has for octets, arrays and numbers that are not finite."""
    match value:
        case dict():
            return {str(k): json_safe(v) for k, v in value.items()}
        case list() | tuple():
            return [json_safe(v) for v in value]
        case np.ndarray():
            return json_safe(value.tolist())
        case np.generic():
            return json_safe(value.item())
        case float() if not math.isfinite(value):
            return None
        case bytes():
            return value.hex()
        case _:
            return value


def from_json(type_name: str, obj: Any) -> Any:
    """Message of what ``json_safe`` makes of its plain form, or of any plain form that JSON can hold.

    Raises
    ------
    CodecError
        If ``obj`` is not of that type; the message names the field.
    """
    node = message_node(type_name)
    return from_plain(type_name, _plain(obj, node, node.name))


def _plain(obj: Any, node: Node | Alias, where: str) -> Any:
    match node:
        case Alias():
            return _plain(obj, node.node, where)
        case Struct() | Choice() if isinstance(obj, Mapping):
            fields = node.fields if isinstance(node, Struct) else node.alternatives
            known = {name: f for f in fields for name in (f.key, f.attribute, f.name)}
            return {k: _plain(v, known[k].node, f"{where}.{k}") if k in known else v for k, v in obj.items()}
        case ListOf() if isinstance(obj, list):
            return [_plain(v, node.element, f"{where}[{i}]") for i, v in enumerate(obj)]
        case Octets() if isinstance(obj, str):
            try:
                return bytes.fromhex(obj)
            except ValueError as error:
                raise CodecError(f"{where}: expected hexadecimal digits ({error})") from error
        case _:
            return _numbers(obj)


def _numbers(obj: Any) -> Any:
    if isinstance(obj, list):
        return [_numbers(v) for v in obj]
    return math.nan if obj is None else obj
