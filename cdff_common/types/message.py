# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Base classes of the generated types: validation, equality, a short ``repr``, ASN.1 name and extent."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cdff_common.errors import InputError
from cdff_common.types.extents import POSITIONS, Box, box_around
from cdff_common.types.rows import check_message
from cdff_common.types.schema import fields_of
from cdff_common.types.schema_table import CHOICES, LARGE, MESSAGES
from cdff_common.types.validation import Check, check_of, same

_REPR_ELEMENTS = 16


class Message:
    """Base of every type: immutable, compared by value, not hashable."""

    __slots__ = ()
    #: Name of the type in the ASN.1 modules.
    ASN1_NAME: ClassVar[str] = ""
    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    def __post_init__(self) -> None:
        """Validate the fields by the schema of the type, then their consistency; raises InputError."""
        for attribute, where, check in _checks(self.ASN1_NAME):
            value = getattr(self, attribute)
            checked = check(value, where)
            if checked is not value:
                object.__setattr__(self, attribute, checked)
        self._check_consistency()

    def __eq__(self, other: object) -> bool:
        """Compare type and fields: arrays by shape and element, NaN equal to NaN."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor and arguments, so that the arrays of copies and pickles are read-only too."""
        return type(self), tuple(getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        """Return the fields, large arrays as dtype and shape."""
        parts = ", ".join(f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({parts})"

    def _check_consistency(self) -> None:
        """Check the conditions on several fields, after the validation of each."""
        check_message(self)

    def extent_m(self) -> Box | None:
        """Return the box ``xmin ymin zmin xmax ymax zmax`` of the content in its frame, metres, or None."""
        path = POSITIONS.get(self.ASN1_NAME)
        return None if path is None else box_around(attrgetter(path)(self))


class ChoiceMessage(Message):
    """Base of the types of a CHOICE, with the fields ``kind`` and ``value``."""

    __slots__ = ()
    if TYPE_CHECKING:
        kind: str
        value: Any

    def __post_init__(self) -> None:
        """Validate the value by the schema of its kind; raises InputError."""
        alternatives = {attribute: (where, check) for attribute, where, check in _checks(self.ASN1_NAME)}
        if self.kind not in alternatives:
            expected = ", ".join(alternatives)
            raise InputError(f"{type(self).__name__}.kind={self.kind!r}: expected one of {expected}")
        where, check = alternatives[self.kind]
        object.__setattr__(self, "value", check(self.value, where))


@cache
def _checks(name: str) -> tuple[tuple[str, str, Check], ...]:
    """Return attribute, path for error messages and check of each field or alternative of a type."""
    node = CHOICES.get(name) or MESSAGES[LARGE.get(name, name)]
    return tuple((f.attribute, f"{node.class_name}.{f.attribute}", check_of(f.node)) for f in fields_of(node))


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= _REPR_ELEMENTS else f"<{value.dtype} {value.shape}>"
    if isinstance(value, tuple) and len(value) > _REPR_ELEMENTS:
        return f"<tuple of {len(value)}>"
    return repr(value)
