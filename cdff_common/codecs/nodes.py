# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of the schema by the names of types, and arrays in octets."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cdff_common.errors import CodecError
from cdff_common.types.schema import Message, OctetString
from cdff_common.types.schema_table import LARGE, MESSAGES


@cache
def _by_name() -> dict[str, Message]:
    """Return all messages by ASN.1 name and class name; a class name refers to the smaller size variant."""
    larger = set(LARGE.values())
    return {**{m.class_name: m for name, m in MESSAGES.items() if name not in larger}, **MESSAGES}


def message_node(type_name: str) -> Message:
    """Return the node of a type by ASN.1 or class name, also in InFuse's form (``asn1Scc`` prefix, ``_`` for
    ``-``).

    Raises
    ------
    CodecError
        If there is no such type.
    """
    names = _by_name()
    plain = type_name.removeprefix("asn1Scc")
    for name in (plain, plain.replace("_", "-")):
        if name in names:
            return names[name]
    raise CodecError(f"type {type_name!r}: expected a type of the ASN.1 modules, e.g. Pointcloud")


def array_of_bytes(data: Any, node: OctetString) -> np.ndarray[Any, Any]:
    """Return the array in the bytes of an OCTET STRING, without a copy if they are aligned.

    Raises
    ------
    CodecError
        If the size is not a multiple of the row size.
    """
    row = np.dtype(node.dtype).itemsize * max(node.columns, 1)
    if len(data) % row:
        raise CodecError(f"OCTET STRING of {len(data)} bytes: expected a multiple of {row} ({node.dtype})")
    array = np.frombuffer(data, dtype=np.uint8)
    if array.size and array.ctypes.data % 8:
        array = array.copy()
    typed = array.view(node.dtype)
    return typed.reshape(-1, node.columns) if node.columns else typed
