# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of a file that ends before their ``.meta``: types by the fields, times of the samples."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from cdff_common.codecs.dict_form import from_dict_form
from cdff_common.errors import CodecError, InputError
from cdff_common.types.schema_table import LARGE, MESSAGES


def type_by_fields(sample: Any) -> str:
    """Return the type of a sample in dictionary form: the one whose fields, by their names in InFuse logs, it
    has.

    Raises
    ------
    InputError
        If no type has them, or several have them with as few deviations.
    """
    larger = set(LARGE.values())
    deviations: dict[str, int] = {}
    for name in MESSAGES.keys() - larger:
        quirks: list[str] = []
        try:
            from_dict_form(name, sample, quirks.append)
        except (InputError, ValueError, TypeError):
            continue
        if not any(re.fullmatch(r"[^.]+\.[^.]+: missing, .*", quirk) for quirk in quirks):
            deviations[name] = len(quirks)
    fewest = min(deviations.values(), default=0)
    type_names = sorted(name for name, count in deviations.items() if count == fewest)
    if len(type_names) != 1:
        fields = ", ".join(map(str, sample)) if isinstance(sample, dict) else type(sample).__name__
        raise InputError(f"{len(type_names)} types have the fields {fields}: expected one")
    return type_names[0]


def own_stamps_ns(values: Iterable[Any]) -> list[int]:
    """Return the stamps that messages contain.

    Raises
    ------
    InputError
        If their type has none, or none is set.
    """
    stamps = []
    for value in values:
        try:
            stamps.append(int(value.stamp_ns) // 1000 * 1000)
        except (AttributeError, CodecError) as error:
            raise InputError(f"a {type(value).ASN1_NAME} has no time") from error
    if not any(stamps):
        raise InputError("its samples have no times")
    return stamps
