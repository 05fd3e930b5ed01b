# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages from the JSON form of their dict form.

Bytes are hexadecimal text; NaN and the infinities are null, which is read as NaN.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cdff_common.codecs.dict_form import from_dict_form
from cdff_common.codecs.wire_types import message_node
from cdff_common.errors import CodecError
from cdff_common.types.schema import Alias, Choice, ListOf, Node, OctetString, Struct, fields_of


def from_json(type_name: str, obj: Any) -> Any:
    """Return the message of a JSON form, i.e. of the ``jsonable`` dict form.

    Raises
    ------
    CodecError
        If ``obj`` is not of that type; the message names the field.
    """
    node = message_node(type_name)
    return from_dict_form(type_name, _dict_form(obj, node, node.name))


def _dict_form(obj: Any, node: Node | Alias, where: str) -> Any:
    """Return the dictionary form of a JSON value: octet strings, hexadecimal text in JSON, become bytes."""
    match node:
        case Alias():
            return _dict_form(obj, node.node, where)
        case Struct() | Choice() if isinstance(obj, Mapping):
            known = {name: f for f in fields_of(node) for name in (f.key, f.attribute, f.name)}
            return {
                k: _dict_form(v, known[k].node, f"{where}.{k}") if k in known else v for k, v in obj.items()
            }
        case ListOf() if isinstance(obj, list):
            return [_dict_form(v, node.element, f"{where}[{i}]") for i, v in enumerate(obj)]
        case OctetString() if isinstance(obj, str):
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
