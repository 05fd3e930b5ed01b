# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The checks that every generated type runs on its fields.

Each takes a value and where it belongs (``Type.field``) and returns the value in its one canonical form: arrays
C-contiguous, little-endian and read-only. An array of the right dtype is not copied: it is handed over, the
message holds a read-only view of it. What does not fit raises ``InputError`` with the place, the value and what
was expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError

Bounds = tuple[int, int]
E = TypeVar("E", bound=IntEnum)
T = TypeVar("T")

#: Octets start at a multiple of this address, so that views of them as numbers are aligned.
_ALIGNMENT = 8


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} array of shape {value.shape}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _size_text(bounds: Bounds) -> str:
    low, high = bounds
    return str(low) if low == high else f"{low}..{high}"


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A C-contiguous, read-only view of an array (a copy only where it is not contiguous)."""
    array = np.ascontiguousarray(array)
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def _numbers(value: object, where: str, kinds: str, expected: str) -> NDArray[Any]:
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"{where}={_brief(value)}: expected {expected} ({error})") from error
    if array.dtype.kind not in kinds and array.size:
        raise InputError(f"{where}={_brief(value)}: dtype {array.dtype}, expected {expected}")
    return array


def _shaped(array: NDArray[Any], where: str, dims: tuple[Bounds, ...]) -> NDArray[Any]:
    if array.size == 0 and array.ndim != len(dims) and dims[0][0] == 0:
        array = array.reshape((0, *(high if low == high else 0 for low, high in dims[1:])))
    fits = array.ndim == len(dims) and all(low <= n <= high for n, (low, high) in zip(array.shape, dims, strict=True))
    if not fits:
        raise InputError(f"{where}: shape {array.shape}, expected ({', '.join(_size_text(b) for b in dims)})")
    return array


def real_array(value: object, where: str, dims: tuple[Bounds, ...]) -> NDArray[np.float64]:
    """Array of float64 with a size within bounds in each dimension."""
    array = value if isinstance(value, np.ndarray) else _numbers(value, where, "fiu", "real numbers")
    if array.dtype != np.float64:
        if array.dtype.kind not in "fiu" and array.size:
            raise InputError(f"{where}={_brief(value)}: dtype {array.dtype}, expected real numbers")
        array = array.astype(np.float64)
    return read_only(_shaped(array, where, dims))


def integer_array(value: object, where: str, dims: tuple[Bounds, ...], low: int, high: int, dtype: str) -> NDArray[Any]:
    """Array of integers of ``dtype``, each within low..high."""
    array = _numbers(value, where, "iu", f"integers {low}..{high}")
    target = np.dtype(dtype)
    if array.size and array.dtype != target and not (low <= int(array.min()) and int(array.max()) <= high):
        raise InputError(f"{where}: values {array.min()}..{array.max()}, expected {low}..{high}")
    array = array.astype(target, copy=False)
    if (
        array.size
        and (low > np.iinfo(target).min or high < np.iinfo(target).max)
        and (int(array.min()) < low or int(array.max()) > high)
    ):
        raise InputError(f"{where}: values {array.min()}..{array.max()}, expected {low}..{high}")
    return read_only(_shaped(array, where, dims))


def boolean_array(value: object, where: str, dims: tuple[Bounds, ...]) -> NDArray[np.bool_]:
    """Array of booleans."""
    array = _numbers(value, where, "b", "booleans").astype(np.bool_, copy=False)
    return read_only(_shaped(array, where, dims))


def octets(value: object, where: str, high: int) -> NDArray[np.uint8]:
    """Octets as a ``(n,)`` uint8 array, from bytes or a uint8 array."""
    if isinstance(value, bytes | bytearray | memoryview):
        array: NDArray[Any] = np.frombuffer(value, dtype=np.uint8)
    else:
        array = _numbers(value, where, "u", "bytes or uint8 numbers")
        if array.dtype != np.uint8:
            if array.size:
                raise InputError(f"{where}={_brief(value)}: dtype {array.dtype}, expected bytes or a uint8 array")
            array = array.astype(np.uint8)
    if array.ctypes.data % _ALIGNMENT:
        array = array.copy()
    return read_only(_shaped(array, where, ((0, high),)))


def typed_octets(value: object, where: str, high: int, dtype: str, columns: int) -> NDArray[Any]:
    """Little-endian array ``(n,)`` or ``(n, columns)`` of ``dtype`` whose octets travel as an OCTET STRING."""
    target = np.dtype(dtype)
    array = _numbers(value, where, "fiu" if target.kind == "f" else "iu", f"{target.name} numbers")
    if array.dtype != target:
        if target.kind in "iu" and array.size:
            info = np.iinfo(target)
            if int(array.min()) < info.min or int(array.max()) > info.max:
                raise InputError(f"{where}: values {array.min()}..{array.max()}, expected {info.min}..{info.max}")
        array = array.astype(target)
    rows = high // (target.itemsize * max(columns, 1))
    dims: tuple[Bounds, ...] = ((0, rows), (columns, columns)) if columns else ((0, rows),)
    return read_only(_shaped(array, where, dims))


def integer(value: object, where: str, low: int, high: int) -> int:
    """An integer within low..high."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise InputError(f"{where}={_brief(value)}: expected an integer {low}..{high}")
    number = int(value)
    if not low <= number <= high:
        raise InputError(f"{where}={number}: expected {low}..{high}")
    return number


def real(value: object, where: str) -> float:
    """A real number; NaN and the infinities are values."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{where}={_brief(value)}: expected a real number")
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(f"{where}={_brief(value)}: expected a number that float64 can hold") from error


def boolean(value: object, where: str) -> bool:
    """A truth value."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{where}={_brief(value)}: expected True or False")
    return bool(value)


def text(value: object, where: str, high: int) -> str:
    """Text of at most ``high`` octets of UTF-8; trailing NULs, which some robots count, are dropped."""
    if not isinstance(value, str):
        raise InputError(f"{where}={_brief(value)}: expected text")
    clean = value.rstrip("\0")
    try:
        size = len(clean.encode("utf-8", "surrogateescape"))
    except UnicodeEncodeError as error:
        raise InputError(f"{where}={_brief(value)}: expected text that UTF-8 can hold ({error.reason})") from error
    if size > high:
        raise InputError(f"{where}={_brief(value)}: {size} octets of UTF-8, expected at most {high}")
    return clean


def enumeration(value: object, where: str, cls: type[E]) -> E:
    """A member of an enumeration, from it or its number."""
    if isinstance(value, cls):
        return value
    if not isinstance(value, bool) and isinstance(value, int | np.integer):
        try:
            return cls(int(value))
        except ValueError:
            pass
    names = ", ".join(f"{m.name}={m.value}" for m in cls)
    raise InputError(f"{where}={_brief(value)}: expected one of {names}")


def instance(value: object, where: str, cls: type[T]) -> T:
    """An object of a message type."""
    if not isinstance(value, cls):
        raise InputError(f"{where}: {_brief(value)} is a {type(value).__name__}, expected {cls.__name__}")
    return value


def items(value: object, where: str, low: int, high: int, check: Callable[[Any, str], T]) -> tuple[T, ...]:
    """A tuple of low..high checked elements, from a list or tuple."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{where}={_brief(value)}: expected a list or tuple")
    if not low <= len(value) <= high:
        raise InputError(f"{where}: {len(value)} elements, expected {low}..{high}")
    return tuple(check(item, f"{where}[{i}]") for i, item in enumerate(value))


def same(a: object, b: object) -> bool:
    """Equality of two field values: arrays by shape and element, NaN equal to NaN, -0 equal to 0."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f")
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return type(a) is type(b) and bool(a == b)
