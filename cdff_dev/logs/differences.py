# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Differences between two values: the fields that are not equal."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from cdff_common.types.message import ChoiceMessage, Message

#: Relative and absolute difference within which numbers are equal after a conversion, for example of a
#: rotation from a quaternion to a matrix and back.
ROUNDING = (1e-9, 1e-12)
#: Relative and absolute difference of equal numbers without rounding.
EXACT = (0.0, 0.0)


def differing_fields(a: Any, b: Any, tolerance: tuple[float, float] = EXACT) -> list[str]:
    """Return the paths of the fields that differ between two values, such as ``data.points``.

    Parameters
    ----------
    a, b : Any
        Messages of ``cdff_common.types``.
    tolerance : tuple of float
        Relative and absolute difference up to which numbers are equal. NaN is equal to NaN.

    Returns
    -------
    list of str
        In the order of the fields; ``type`` if the types differ; elements of sequences have the same path.
    """
    paths: dict[str, None] = {}
    _compare(a, b, "", tolerance, paths)
    return list(paths)


def _compare(a: Any, b: Any, path: str, tolerance: tuple[float, float], paths: dict[str, None]) -> None:
    """Add the path of each field that differs between two values to ``paths``."""
    if isinstance(a, Message) and type(a) is type(b):
        names = ("kind", "value") if isinstance(a, ChoiceMessage) else [f.name for f in fields(a)]  # type: ignore[arg-type]
        for name in names:
            _compare(getattr(a, name), getattr(b, name), f"{path}.{name}" if path else name, tolerance, paths)
    elif isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        for x, y in zip(a, b, strict=True):
            _compare(x, y, path, tolerance, paths)
    elif not _equal(a, b, tolerance):
        paths[path or "type"] = None


def _equal(a: Any, b: Any, tolerance: tuple[float, float]) -> bool:
    """Return whether two values are equal, numbers within a tolerance; NaN equals NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        if a.shape != b.shape:
            return False
        is_float = a.dtype.kind == "f" and b.dtype.kind == "f"
        if np.array_equal(a, b) or (is_float and np.array_equal(a, b, equal_nan=True)):
            return True
        return is_float and np.allclose(a, b, *tolerance, equal_nan=True)
    if isinstance(a, float) and isinstance(b, float):
        return bool(np.isclose(a, b, *tolerance, equal_nan=True))
    return type(a) is type(b) and bool(a == b)
