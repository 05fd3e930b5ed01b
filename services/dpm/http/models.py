# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What answers look like in the OpenAPI document, shared by several routes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field

#: Media type of the OpenAPI document.
OPENAPI = "application/vnd.oai.openapi+json;version=3.1"
#: Nanoseconds as a decimal (contract §6).
StampNs = Annotated[str, Field(pattern=r"^-?\d{1,19}$")]
Json = dict[str, Any]


class Open(BaseModel):
    """Fields that are not named here may come too: headers of products grow."""

    model_config = ConfigDict(extra="allow")


class Problem(Open):
    """RFC 9457."""

    type: str
    title: str
    status: Annotated[int, Field(ge=400, le=599)]
    detail: str
    code: str | None = None


class Link(Open):
    """RFC 8288, as STAC and OGC write it."""

    href: str
    rel: str
    type: str | None = None
    title: str | None = None
    method: Literal["GET", "POST"] | None = None
    body: Json | None = None
    merge: bool | None = None


Form = Annotated[
    Literal["json"] | None, Field(description="Form of the answer: json (GeoJSON for features), which is the only one")
]


def as_json(
    f: Annotated[Literal["json"] | None, Query(description="Form of the answer: json, the only one")] = None,
) -> None:
    """Let ``f=json`` be said, as clients of OGC interfaces customarily do; another form is refused."""


class Conformance(BaseModel):
    """URIs of the requirements classes that are met."""

    conformsTo: list[str]


class Feature(Open):
    """A GeoJSON feature."""

    type: Literal["Feature"]
    id: str
    geometry: Json | None
    properties: Json
    links: list[Link] = []


class FeatureCollection(Open):
    """A page of GeoJSON features."""

    type: Literal["FeatureCollection"]
    features: list[Feature]
    links: list[Link]
    numberReturned: int
    timeStamp: str | None = None
