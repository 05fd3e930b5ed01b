# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unaligned PER of lists of messages with REALs only, such as correspondences and poses.

A SEQUENCE and a list of fixed size have no header, so that such a list consists of its length and the numbers
of all elements in sequence. They are processed by the compiled loops at once; each message is a view of its
row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.types.message import COLUMNS, Message
from cdff_common.types.schema import Array, Node, Real, Struct
from cdff_common.types.validation import class_of, read_only

PutRows = Callable[[BitWriter, tuple[Any, ...]], None]
GetRows = Callable[[BitReader, int], list[Any]]
#: Lists shorter than this are processed element by element.
LONG = 16


def widths(node: Node) -> list[tuple[str, tuple[int, ...] | None]] | None:
    """Return the attributes of a SEQUENCE of REALs with their shapes (None for a number), or None for other
    nodes.
    """
    if not isinstance(node, Struct):
        return None
    shapes: list[tuple[str, tuple[int, ...] | None]] = []
    for field in node.fields:
        if isinstance(field.node, Real):
            shapes.append((field.attribute, None))
        elif isinstance(field.node, Array) and isinstance(field.node.element, Real):
            if any(low != high for low, high in field.node.dims):
                return None
            shapes.append((field.attribute, tuple(low for low, _ in field.node.dims)))
        else:
            return None
    # The consistency check of a class would be skipped.
    is_checked = class_of(node.class_name)._check_consistency is not Message._check_consistency
    return None if is_checked or node.class_name in COLUMNS else shapes


def rows_of(node: Node, fields: list[tuple[str, tuple[int, ...] | None]]) -> tuple[PutRows, GetRows]:
    """Return the functions that write many such messages, and read ``count`` of them."""
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
        # The values are already in canonical form; validation is not needed.
        for row in zip(*columns, strict=True):
            item = new(make)
            for name, value in zip(names, row, strict=True):
                put_field(item, name, value)
            items.append(item)
        return items

    return put, get


def _column(part: NDArray[np.float64], shape: tuple[int, ...] | None) -> Any:
    """Return one value per row: numbers, or read-only views."""
    return part[:, 0].tolist() if shape is None else list(read_only(part).reshape(-1, *shape))
