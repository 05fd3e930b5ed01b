# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of a single acquisition, such as the direction of a mast: ``pan_deg:30,tilt_deg:-10``, or
``now``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from cdff_common.contract.names import NAME
from cdff_common.errors import InputError

#: Text of an acquisition without parameters.
NOW = "now"
#: Largest number of parameters.
_MAX_PARAMETERS = 16
_PAIR = re.compile(rf"({NAME}):([+-]?[0-9.eE+-]+)")


@dataclass(frozen=True, slots=True)
class AcquisitionParameters:
    """Values by name, sorted by name; hashable."""

    values: tuple[tuple[str, float], ...] = ()

    @classmethod
    def parse(cls, text: str, name: str = "acquire") -> AcquisitionParameters:
        """Return the parameters in a text; raises InputError with ``name``, the value and the expectation."""
        expected = f"{name}={text[:80]!r}: expected now, or NAME:NUMBER separated by commas, as pan_deg:30"
        if text == NOW:
            return cls()
        pairs: dict[str, float] = {}
        for part in text.split(",", _MAX_PARAMETERS):
            match = _PAIR.fullmatch(part)
            if match is None or match[1] in pairs or len(pairs) == _MAX_PARAMETERS:
                raise InputError(expected)
            try:
                pairs[match[1]] = float(match[2])
            except ValueError as error:
                raise InputError(expected) from error
            if not math.isfinite(pairs[match[1]]):
                raise InputError(expected)
        return cls(tuple(sorted(pairs.items())))

    @classmethod
    def of(cls, values: Mapping[str, float]) -> AcquisitionParameters:
        """Return the parameters of a mapping."""
        return cls(tuple(sorted(values.items())))

    def to_dict(self) -> dict[str, float]:
        """Return the values by name."""
        return dict(self.values)

    def __str__(self) -> str:
        return ",".join(f"{name}:{value!r}" for name, value in self.values) or NOW
