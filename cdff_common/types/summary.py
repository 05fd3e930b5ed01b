# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Short text and HTML of messages: large arrays as dtype, shape and range."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CdffError

#: Largest numbers of elements of an array and of a tuple, and of characters of a text, that are shown whole.
_ELEMENTS, _ITEMS, _CHARACTERS = 16, 4, 120


def message_text(message: Any) -> str:
    """Return the name of the type with its fields, in one line."""
    parts = ", ".join(f"{field.name}={brief(getattr(message, field.name))}" for field in fields(message))
    return f"{type(message).__name__}({parts})"


def brief(value: Any) -> str:
    """Return a value as text: large arrays as dtype, shape and range, long tuples as their length."""
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= _ELEMENTS else array_text(value)
    if isinstance(value, tuple):
        if len(value) > _ITEMS:
            return f"<{len(value)} x {type(value[0]).__name__}>"
        return f"({', '.join(brief(item) for item in value)}{',' if len(value) == 1 else ''})"
    text = repr(value)
    if isinstance(value, (str, bytes)) and len(text) > _CHARACTERS:
        return f"<{type(value).__name__} of {len(value)}>"
    return text


def array_text(array: NDArray[Any]) -> str:
    """Return dtype, shape and the range of the finite elements, such as ``<float32 (3, 4) -1.5..2>``."""
    if array.dtype.kind not in "biuf" or not array.size:
        return f"<{array.dtype} {array.shape}>"
    finite = array[np.isfinite(array)]
    spread = f"{finite.min():.4g}..{finite.max():.4g}" if finite.size else "none finite"
    unknown = f", {array.size - finite.size} not finite" if 0 < finite.size < array.size else ""
    return f"<{array.dtype} {array.shape} {spread}{unknown}>"


def html_table(title: str, lines: list[str], rows: Mapping[str, str]) -> str:
    """Return HTML for notebooks: a title, lines of text and a table of names and values."""
    text = "".join(f"<br>{escape(line)}" for line in lines)
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<div><b>{escape(title)}</b>{text}<table>{cells}</table></div>"


def message_html(message: Any) -> str:
    """Return a message as HTML: its content in words, then its fields."""
    from cdff_common.value_text import value_lines  # imports all types

    name = type(message).__name__
    lines: list[str] = []
    with suppress(CdffError):  # an incomplete message, such as a map without a frame, has only its fields
        lines = [line for line in value_lines(message) if line != name]
    return html_table(name, lines, {f.name: brief(getattr(message, f.name)) for f in fields(message)})
