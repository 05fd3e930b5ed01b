# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Types of the array ports of DFNs, such as ``float64[n,3]``, and the check of inputs against them."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from cdff_common.errors import InputError

ARRAY_TYPE = re.compile(
    r"(?P<dtype>float32|float64|uint8|uint16|int32|int64|bool)\[(?P<shape>[a-z0-9,+* ]+)\]\Z"
)
#: Types of scalar ports of DFNs, with the numpy dtype of a value.
SCALAR_TYPES = {"float": "float64", "int": "int64", "bool": "bool", "str": "str"}

_GREY = np.dtype(np.uint8)


class ArrayPorts:
    """Check of the inputs of a DFN; sizes with the same letter must be equal.

    Parameters
    ----------
    types : mapping of str to str
        Type of each array port by attribute. Bytes are compared exactly, since grey levels and descriptors
        cannot be converted; implementations convert other numbers.
    finite, positive : collection of str
        Ports whose values must be finite, and those whose values must also be above 0.
    optional : collection of str
        Ports that may be None.
    """

    def __init__(
        self,
        types: Mapping[str, str],
        finite: Collection[str] = (),
        positive: Collection[str] = (),
        optional: Collection[str] = (),
    ) -> None:
        self._types = types
        self._optional = frozenset(optional)
        matches = {name: ARRAY_TYPE.match(text) for name, text in types.items()}
        self._dims = {name: m["shape"].split(",") for name, m in matches.items() if m}
        self._bytes = [name for name, m in matches.items() if m and m["dtype"] == "uint8"]
        self._values: list[tuple[str, Callable[[Any], Any], str]]
        self._values = [(name, np.isfinite, "finite numbers") for name in finite]
        self._values += [(name, _is_positive, "finite numbers above 0") for name in positive]
        # Shapes recur, and a comparison of all sizes takes longer than some of the DFNs.
        self._fault_of = lru_cache(maxsize=64)(self._fault)

    def check(self, inputs: Any) -> None:
        """Raise InputError with port, value and expectation where an input does not fit."""
        arrays = [getattr(inputs, name) for name in self._dims]
        try:
            fault = self._fault_of(*[None if a is None else a.shape for a in arrays])
        except AttributeError:
            others = {n: a for n, a in zip(self._dims, arrays, strict=True) if not hasattr(a, "shape")}
            name, value = next((n, a) for n, a in others.items() if a is not None)
            fault = f"{name}: {type(value).__name__}, expected an array {self._types[name]}"
        if fault:
            raise InputError(fault)
        for name in self._bytes:
            array = getattr(inputs, name)
            if array is not None and array.dtype != _GREY:
                raise InputError(f"{name} {array.shape} of {array.dtype}: expected {self._types[name]}")
        for name, is_valid, expected in self._values:
            value = getattr(inputs, name)
            if value is None and name in self._optional:
                continue
            try:
                valid = is_valid(value)
            except TypeError as error:
                raise InputError(f"{name}: {str(value)[:80]}, expected {expected}") from error
            if not np.all(valid):
                invalid_values = np.extract(~valid, value)
                raise InputError(
                    f"{name}: {invalid_values[0]:g} ({invalid_values.size} of {np.size(value)}), "
                    f"expected {expected}"
                )

    def _fault(self, *shapes: tuple[int, ...] | None) -> str | None:
        """Return the first port whose shape is not as described, as a text; None if all are."""
        sizes = {dim: (int(dim), "") for dims in self._dims.values() for dim in dims if dim.isdigit()}
        for (name, dims), shape in zip(self._dims.items(), shapes, strict=True):
            if shape is None:
                if name in self._optional:
                    continue
                return f"{name}: None, expected {self._types[name]}"
            known = {dim: sizes[dim] for dim in dims if dim in sizes and not dim.isdigit()}
            pairs = zip(dims, shape, strict=False)
            if len(dims) != len(shape) or any(sizes.setdefault(d, (n, name))[0] != n for d, n in pairs):
                others = ", ".join(f"{dim}={size} of {other}" for dim, (size, other) in known.items())
                return f"{name} {shape}: expected {self._types[name]}{others and f' with {others}'}"
        return None


class DfnInputs:
    """Base of the inputs of a DFN that have array ports or restricted values; checked at construction."""

    __slots__ = ()
    ARRAYS: ClassVar[ArrayPorts]

    def __post_init__(self) -> None:
        """Raise InputError where an input does not fit its port."""
        self.ARRAYS.check(self)


def _is_positive(value: Any) -> Any:
    return np.isfinite(value) & np.greater(value, 0)
