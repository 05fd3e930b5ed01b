# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wiring of a DFPC's inputs: sources such as ``sensor/lidar/scan``, and alternatives separated by ``|``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, Self, cast

from cdff_common.errors import InputError

SourceKind = Literal["sensor", "product", "dpm"]
#: Patterns of one source and of a wiring, unanchored.
SOURCE = r"(sensor|product|dpm)/[a-z0-9_]+/[a-z0-9_]+"
WIRING = rf"{SOURCE}(\|{SOURCE})*"


@dataclass(frozen=True, slots=True)
class Source:
    """One source of an input.

    Attributes
    ----------
    kind : str
        ``sensor`` (``owner`` is the sensor, ``item`` the stream), ``product`` (DFPC and output port, of the
        same robot) or ``dpm`` (robot and product type, from the DPM).
    """

    kind: SourceKind
    owner: str
    item: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the source of ``kind/owner/item``; raises InputError."""
        if not re.fullmatch(SOURCE, text):
            raise InputError(
                f"source {text!r}: expected sensor/{{sensor}}/{{stream}}, product/{{dfpc}}/{{port}} or "
                "dpm/{robot}/{product}"
            )
        kind, owner, item = text.split("/")
        return cls(cast(SourceKind, kind), owner, item)

    def __str__(self) -> str:
        return f"{self.kind}/{self.owner}/{self.item}"


@dataclass(frozen=True, slots=True)
class Wiring:
    """Alternative sources of one input, the preferred one first."""

    sources: tuple[Source, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the wiring of ``source|source|…``; raises InputError."""
        return cls(tuple(Source.parse(part) for part in text.split("|")))

    @property
    def default(self) -> Source:
        """Source that is used unless a plan selects another."""
        return self.sources[0]

    def __str__(self) -> str:
        return "|".join(str(source) for source in self.sources)


def mode_names(text: str) -> tuple[str, ...]:
    """Return the sensor modes of ``nominal|fast``, in order of preference."""
    return tuple(text.split("|"))
