# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The answer to a request: a product with its header, and the delivered properties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.interfaces.product import Header, Status
from cdff_common.types.summary import html_table
from cdff_common.value_text import value_lines


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A product with its header.

    Attributes
    ----------
    value : Any
        A ``cdff_common.types`` object; None for a file format, of which ``data`` is the file.
    header : Header
        Producer, times, inputs and quality.
    type_name : str
        ASN.1 type of ``value``; the media type of a file.
    data : bytes
        The received payload.
    encoding : str
    robot : str
    delivered : mapping
        ``frame resolution_m coverage age_s oldest_age_s differences …`` of a request; empty for a product
        retrieved by id.
    job, request : str
        Ids of the job and of the request; empty for a product retrieved by id.
    asked : mapping
        The request as parsed by the orchestrator; empty for a product retrieved by id.
    """

    value: Any
    header: Header
    type_name: str
    data: bytes
    encoding: str
    robot: str = ""
    delivered: Mapping[str, Any] = field(default_factory=dict)
    job: str = ""
    request: str = ""
    asked: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_degraded(self) -> bool:
        """True if the quality is not OK; the reasons are in ``header.quality.reasons``."""
        return self.header.quality.status is not Status.OK

    def __repr__(self) -> str:
        name = f"{self.type_name} of {self.robot}" if self.robot else self.type_name
        return f"Answer({name}, {len(self.data)} bytes as {self.encoding}, {self.header.quality.status})"

    def _repr_html_(self) -> str:
        """Return the value in words, its delivered properties and its quality, for notebooks."""
        quality = self.header.quality
        rows = {"captured": f"{self.header.captured}", "quality": str(quality.status)}
        rows |= {"reasons": ", ".join(quality.reasons)} if quality.reasons else {}
        rows |= {name: str(value) for name, value in self.delivered.items() if value not in (None, [])}
        return html_table(repr(self), [] if self.value is None else value_lines(self.value), rows)

    def summary(self) -> dict[str, Any]:
        """Return all fields except the value, as plain data."""
        return {
            "type": self.type_name,
            "robot": self.robot,
            "encoding": self.encoding,
            "size": len(self.data),
            "job": self.job,
            "request": self.request,
            "asked": dict(self.asked),
            "delivered": dict(self.delivered),
            "header": self.header.to_dict(),
        }
