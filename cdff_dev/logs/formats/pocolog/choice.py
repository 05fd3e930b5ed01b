# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choice of the conversions of a port by the type of its samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cdff_dev.logs.formats.pocolog.decoding import Type, Vector, field_names
from services.rock_types.conversions import CONVERSIONS, NO_CONVERSION
from services.rock_types.values import Conversion


@dataclass(frozen=True, slots=True)
class Choice:
    """Conversions of a port.

    Attributes
    ----------
    conversions : tuple of Conversion
        Each makes a stream; none if the port is not converted.
    is_split : bool
        Whether they convert the elements of a vector.
    lost : mapping of str to str
        Fields that no conversion uses, with the reason.
    reason : str
        Reason if the port is not converted.
    """

    conversions: tuple[Conversion, ...] = ()
    is_split: bool = False
    lost: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""


def choose(type_name: str, kinds: Sequence[Type]) -> Choice:
    """Return the conversions of a type; ``kinds`` are its definitions in the files of a log."""
    reason = NO_CONVERSION.get(_base_name(type_name), "no CDFF type has its content")
    known = CONVERSIONS.get(_base_name(type_name)) or CONVERSIONS.get(_base_name(kinds[0].name))
    if known:
        return _fitting(known, kinds, is_split=False)
    elements = [kind.element for kind in kinds if isinstance(kind, Vector)]
    if len(elements) == len(kinds) and (known := CONVERSIONS.get(_base_name(elements[0].name))):
        return _fitting(known, elements, is_split=True)
    return Choice(reason=reason)


def _base_name(type_name: str) -> str:
    """Return a type name without the suffix ``_m``, which marks the types that represent opaque types in
    files.
    """
    return type_name.removesuffix("_m")


def _fitting(known: Sequence[Conversion], kinds: Sequence[Type], *, is_split: bool) -> Choice:
    """Return, for each suffix, the first conversion whose fields are in all definitions."""
    names = set.intersection(*(set(field_names(kind)) for kind in kinds))
    chosen: dict[str, Conversion] = {}
    for conversion in known:
        if names.issuperset(conversion.fields):
            chosen.setdefault(conversion.suffix, conversion)
    if not chosen:
        missing = ", ".join(sorted(set(known[0].fields) - names))
        return Choice(reason=f"without the expected fields {missing}")
    converted_fields = {
        name for conversion in chosen.values() for name in (*conversion.fields, *conversion.optional)
    }
    reason_by_field = dict.fromkeys(sorted(names - converted_fields), "the CDFF type has no such field")
    return Choice(tuple(chosen.values()), is_split, reason_by_field)
