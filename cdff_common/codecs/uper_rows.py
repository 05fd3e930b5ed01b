# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unaligned PER of lists of messages that hold nothing but REALs, as correspondences and poses: one run of numbers.

A SEQUENCE and a list of fixed size have no octets of their own, so that such a list is, behind its length, all numbers
of all elements one after the other. They go through the compiled loops at once; each message is a view of its row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.codecs.bridge import class_of
from cdff_common.codecs.schema import Array, Node, Real, Struct
from cdff_common.types.message import Message
from cdff_common.types.validation import read_only

PutRows = Callable[[BitWriter, tuple[Any, ...]], None]
GetRows = Callable[[BitReader, int], list[Any]]
#: Below this many elements the plain way is as fast.
LONG = 16


def widths(node: Node) -> list[tuple[str, tuple[int, ...] | None]] | None:
    """Attributes of a SEQUENCE of REALs with their shapes, None for a number; None where it holds other things."""
    if not isinstance(node, Struct):
        return None
    found: list[tuple[str, tuple[int, ...] | None]] = []
    for field in node.fields:
        if isinstance(field.node, Real):
            found.append((field.attribute, None))
        elif isinstance(field.node, Array) and isinstance(field.node.element, Real):
            if any(low != high for low, high in field.node.dims):
                return None
            found.append((field.attribute, tuple(low for low, _ in field.node.dims)))
        else:
            return None
    # What a class checks over several fields would be left out.
    return found if class_of(node.class_name)._check_together is Message._check_together else None


def rows_of(node: Node, fields: list[tuple[str, tuple[int, ...] | None]]) -> tuple[PutRows, GetRows]:
    """Functions that write many such messages, and read ``count`` of them."""
    sizes = [1 if shape is None else int(np.prod(shape)) for _, shape in fields]
    ends = np.cumsum(sizes).tolist()
    width = ends[-1]
    names = [name for name, _ in fields]
    assert isinstance(node, Struct)
    class_name = node.class_name

    def put(writer: BitWriter, items: tuple[Any, ...]) -> None:
        table = np.empty((len(items), width))
        for name, size, end in zip(names, sizes, ends, strict=True):
            table[:, end - size : end] = np.array([getattr(i, name) for i in items]).reshape(len(items), size)
        writer.put_reals(table.reshape(-1))

    def get(reader: BitReader, count: int) -> list[Any]:
        table = read_only(reader.get_reals(count * width).reshape(count, width))
        columns = [
            _column(table[:, end - size : end], shape)
            for (_, shape), size, end in zip(fields, sizes, ends, strict=True)
        ]
        make = class_of(class_name)
        new, put_field = object.__new__, object.__setattr__
        items = []
        # The numbers are what the class would make of them: its checks have nothing to find.
        for row in zip(*columns, strict=True):
            item = new(make)
            for name, value in zip(names, row, strict=True):
                put_field(item, name, value)
            items.append(item)
        return items

    return put, get


def _column(part: NDArray[np.float64], shape: tuple[int, ...] | None) -> Any:
    """One value for each row: numbers, or read-only views."""
    return part[:, 0].tolist() if shape is None else list(read_only(part).reshape(-1, *shape))
