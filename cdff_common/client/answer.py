# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What comes back for a request: the product with its header, and what of the wish was delivered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.interfaces.product import Header, Status


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A product in hand.

    Attributes
    ----------
    value : Any
        A ``cdff_common.types`` object, numpy inside; None where a file format was asked: then ``data`` holds the file.
    header : Header
        Who made it, when, from what, and its quality.
    type_name : str
        ASN.1 type of ``value``; the media type of a file.
    data : bytes
        The payload as it came.
    encoding : str
    robot : str
    delivered : mapping
        ``frame resolution_m coverage age_s oldest_age_s differences …`` of a request; empty for a product got by id.
    job, request : str
        Of a request.
    asked : mapping
        The request as the orchestrator understood it; empty for a product got by id.
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
        """Whether its quality is less than OK; ``header.quality.reasons`` says why."""
        return self.header.quality.status is not Status.OK

    def summary(self) -> dict[str, Any]:
        """Everything but the value, as plain data."""
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
