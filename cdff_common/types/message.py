# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What all generated types share: equality, a short ``repr``, their ASN.1 name, their extent."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from cdff_common.types.validation import same

#: ``xmin ymin zmin xmax ymax zmax``, metres.
Box = tuple[float, float, float, float, float, float]

_REPR_ELEMENTS = 16


class Message:
    """Base of every type: immutable, compared by value, not hashable."""

    __slots__ = ()
    #: Name of the type in the ASN.1 modules.
    ASN1_NAME: ClassVar[str] = ""
    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    def __eq__(self, other: object) -> bool:
        """Same type and same fields; arrays by shape and element, NaN equal to NaN."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made anew, so that their arrays are read-only too."""
        return type(self), tuple(getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        """Fields with large arrays as dtype and shape."""
        parts = ", ".join(f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self))  # type: ignore[arg-type]
        return f"{type(self).__name__}({parts})"

    def _check_together(self) -> None:
        """Check what several fields must satisfy together, after each was checked by itself."""

    def extent_m(self) -> Box | None:
        """Box ``xmin ymin zmin xmax ymax zmax`` around the content in its frame, metres; None where it has none."""
        return None


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return repr(value.tolist()) if value.size <= _REPR_ELEMENTS else f"<{value.dtype} {value.shape}>"
    if isinstance(value, tuple) and len(value) > _REPR_ELEMENTS:
        return f"<tuple of {len(value)}>"
    return repr(value)
