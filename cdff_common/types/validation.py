# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of message fields against the schema.

A check takes a value and its path (``Type.field``) and returns the value in canonical form: arrays are
C-contiguous, little-endian and read-only. An array of the right dtype is not copied; the message holds a
read-only view of it. A value that does not fit raises ``InputError`` with the path, the value and the
expectation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types.schema import (
    Array,
    Boolean,
    Bounds,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    OctetString,
    Real,
    Struct,
    Text,
)

Check = Callable[[Any, str], Any]
E = TypeVar("E", bound=IntEnum)

#: Byte arrays start at a multiple of this address, so that views of them as numbers are aligned.
_ALIGNMENT = 8


def class_of(class_name: str) -> Any:
    """Return the Python class of a node."""
    from cdff_common import types

    return getattr(types, class_name)


@cache
def check_of(node: Node) -> Check:
    """Return the function that validates the values of a node."""
    match node:
        case Real():
            return lambda value, where: value if type(value) is float else _real(value, where)
        case Integer(low, high):
            return lambda value, where: (
                value if type(value) is int and low <= value <= high else _integer(value, where, low, high)
            )
        case Boolean():
            return lambda value, where: value if type(value) is bool else _boolean(value, where)
        case Text(high):
            return lambda value, where: (
                value
                if type(value) is str and len(value) <= high and value.isascii() and value[-1:] != "\0"
                else _text(value, where, high)
            )
        case OctetString(high, "|u1"):
            return lambda value, where: _bytes_array(value, where, high)
        case OctetString(high, dtype_name, columns):
            dtype = np.dtype(dtype_name)
            rows = (0, high // (dtype.itemsize * max(columns, 1)))
            shape: tuple[Bounds, ...] = (rows, (columns, columns)) if columns else (rows,)
            return lambda value, where: _packed_array(value, where, dtype, shape)
        case Array(Integer(low, high), dims):
            target = node.dtype
            return lambda value, where: _integer_array(value, where, dims, low, high, target)
        case Array(Real(), dims):
            return lambda value, where: _real_array(value, where, dims)
        case Array(Boolean(), dims):
            return lambda value, where: read_only(
                _with_shape(_numbers(value, where, "b", "booleans").astype(np.bool_, copy=False), where, dims)
            )
        case ListOf(element, low, high):
            check = check_of(element)
            return lambda value, where: _items(value, where, low, high, check)
        case Enumeration(class_name):
            members = class_of(class_name)
            return lambda value, where: (
                value if type(value) is members else _enumeration(value, where, members)
            )
        case Struct() | Choice():
            cls = class_of(node.class_name)
            return lambda value, where: value if type(value) is cls else _instance(value, where, cls)
    raise TypeError(f"{node}: expected a node of the schema")


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} array of shape {value.shape}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _size_text(bounds: Bounds) -> str:
    low, high = bounds
    return str(low) if low == high else f"{low}..{high}"


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a C-contiguous, read-only view of an array, or a copy if it is not contiguous."""
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


def _with_shape(array: NDArray[Any], where: str, dims: tuple[Bounds, ...]) -> NDArray[Any]:
    """Return an array if its shape is within the bounds; raises InputError."""
    if array.size == 0 and array.ndim != len(dims) and dims[0][0] == 0:
        array = array.reshape((0, *(high if low == high else 0 for low, high in dims[1:])))
    fits = array.ndim == len(dims) and all(
        low <= n <= high for n, (low, high) in zip(array.shape, dims, strict=True)
    )
    if not fits:
        raise InputError(f"{where}: shape {array.shape}, expected ({', '.join(_size_text(b) for b in dims)})")
    return array


def _real_array(value: object, where: str, dims: tuple[Bounds, ...]) -> NDArray[np.float64]:
    array = value if isinstance(value, np.ndarray) else _numbers(value, where, "fiu", "real numbers")
    if array.dtype != np.float64:
        if array.dtype.kind not in "fiu" and array.size:
            raise InputError(f"{where}={_brief(value)}: dtype {array.dtype}, expected real numbers")
        array = array.astype(np.float64)
    return read_only(_with_shape(array, where, dims))


def _check_range(array: NDArray[Any], where: str, low: int, high: int) -> None:
    if array.size and not (low <= int(array.min()) and int(array.max()) <= high):
        raise InputError(f"{where}: values {array.min()}..{array.max()}, expected {low}..{high}")


def _integer_array(
    value: object, where: str, dims: tuple[Bounds, ...], low: int, high: int, dtype: np.dtype[Any]
) -> NDArray[Any]:
    array = _numbers(value, where, "iu", f"integers {low}..{high}")
    info = np.iinfo(dtype)
    if array.dtype != dtype or low > info.min or high < info.max:
        _check_range(array, where, low, high)
    return read_only(_with_shape(array.astype(dtype, copy=False), where, dims))


def _bytes_array(value: object, where: str, high: int) -> NDArray[np.uint8]:
    """Return a ``(n,)`` uint8 array of bytes or of a uint8 array."""
    if isinstance(value, bytes | bytearray | memoryview):
        array: NDArray[Any] = np.frombuffer(value, dtype=np.uint8)
    else:
        array = _numbers(value, where, "u", "bytes or uint8 numbers")
        if array.dtype != np.uint8:
            if array.size:
                raise InputError(
                    f"{where}={_brief(value)}: dtype {array.dtype}, expected bytes or a uint8 array"
                )
            array = array.astype(np.uint8)
    if array.ctypes.data % _ALIGNMENT:
        array = array.copy()
    return read_only(_with_shape(array, where, ((0, high),)))


def _packed_array(value: object, where: str, dtype: np.dtype[Any], dims: tuple[Bounds, ...]) -> NDArray[Any]:
    """Return a little-endian array whose bytes are the content of an OCTET STRING."""
    array = _numbers(value, where, "fiu" if dtype.kind == "f" else "iu", f"{dtype.name} numbers")
    if array.dtype != dtype:
        if dtype.kind in "iu":
            _check_range(array, where, int(np.iinfo(dtype).min), int(np.iinfo(dtype).max))
        array = array.astype(dtype)
    return read_only(_with_shape(array, where, dims))


def _integer(value: object, where: str, low: int, high: int) -> int:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise InputError(f"{where}={_brief(value)}: expected an integer {low}..{high}")
    number = int(value)
    if not low <= number <= high:
        raise InputError(f"{where}={number}: expected {low}..{high}")
    return number


def _real(value: object, where: str) -> float:
    """Return a float; NaN and the infinities are valid."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{where}={_brief(value)}: expected a real number")
    try:
        return float(value)
    except OverflowError as error:
        raise InputError(f"{where}={_brief(value)}: expected a number that float64 can hold") from error


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{where}={_brief(value)}: expected True or False")
    return bool(value)


def _text(value: object, where: str, high: int) -> str:
    """Return text of at most ``high`` UTF-8 bytes without the trailing NULs that some robots send."""
    if not isinstance(value, str):
        raise InputError(f"{where}={_brief(value)}: expected text")
    clean = value.rstrip("\0")
    try:
        size = len(clean.encode("utf-8", "surrogateescape"))
    except UnicodeEncodeError as error:
        raise InputError(
            f"{where}={_brief(value)}: expected text that UTF-8 can hold ({error.reason})"
        ) from error
    if size > high:
        raise InputError(f"{where}={_brief(value)}: {size} bytes of UTF-8, expected at most {high}")
    return clean


def _enumeration(value: object, where: str, cls: type[E]) -> E:
    """Return a member of an enumeration, given as member or number."""
    if isinstance(value, cls):
        return value
    if not isinstance(value, bool) and isinstance(value, int | np.integer):
        try:
            return cls(int(value))
        except ValueError:
            pass
    names = ", ".join(f"{m.name}={m.value}" for m in cls)
    raise InputError(f"{where}={_brief(value)}: expected one of {names}")


def _instance(value: object, where: str, cls: type) -> object:
    if not isinstance(value, cls):
        raise InputError(f"{where}: {_brief(value)} is a {type(value).__name__}, expected {cls.__name__}")
    return value


def _items(value: object, where: str, low: int, high: int, check: Check) -> tuple[Any, ...]:
    """Return checked items as a tuple; raises InputError if their number is out of bounds."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{where}={_brief(value)}: expected a list or tuple")
    if not low <= len(value) <= high:
        raise InputError(f"{where}: {len(value)} elements, expected {low}..{high}")
    return tuple(check(item, f"{where}[{i}]") for i, item in enumerate(value))


def same(a: object, b: object) -> bool:
    """Return whether two field values are equal: arrays by shape and element, NaN equal to NaN, -0 to 0."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f")
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return type(a) is type(b) and bool(a == b)
