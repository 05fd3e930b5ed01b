# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of answers that several routes share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import orjson
from fastapi import Query, Response
from pydantic import BaseModel, ConfigDict, Field

#: Media types; the last one is that of the OpenAPI document.
JSON, GEOJSON = "application/json", "application/geo+json"
OPENAPI = "application/vnd.oai.openapi+json;version=3.1"
#: Media type and link relation of the properties that filters may use.
SCHEMA = "application/schema+json"
QUERYABLES = "http://www.opengis.net/def/rel/ogc/1.0/queryables"
SCHEMA_RELATION = "http://www.opengis.net/def/rel/ogc/1.0/schema"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: Conformance classes of OGC API Features part 3 (19-079r2) and CQL2 (21-065r2) that are met.
FILTER_CLASSES = (
    "http://www.opengis.net/spec/ogcapi-features-3/1.0/conf/queryables",
    "http://www.opengis.net/spec/ogcapi-features-3/1.0/conf/filter",
    "http://www.opengis.net/spec/ogcapi-features-3/1.0/conf/features-filter",
    "http://www.opengis.net/spec/cql2/1.0/conf/cql2-text",
    "http://www.opengis.net/spec/cql2/1.0/conf/cql2-json",
    "http://www.opengis.net/spec/cql2/1.0/conf/basic-cql2",
    "http://www.opengis.net/spec/cql2/1.0/conf/advanced-comparison-operators",
    "http://www.opengis.net/spec/cql2/1.0/conf/case-insensitive-comparison",
    "http://www.opengis.net/spec/cql2/1.0/conf/basic-spatial-functions",
    "http://www.opengis.net/spec/cql2/1.0/conf/basic-spatial-functions-plus",
)
#: Nanoseconds as a decimal string, because JavaScript numbers have 53 bits.
StampNs = Annotated[str, Field(pattern=r"^-?\d{1,19}$")]
Json = dict[str, Any]
#: Responses of a route that answers with GeoJSON.
GEOJSON_BODY: dict[int | str, Json] = {
    200: {"content": {GEOJSON: {}, "text/html": {}}, "description": "GeoJSON, or a page"}
}

#: Further media type of the answers of a route.
PAGE: dict[int | str, Json] = {200: {"content": {"text/html": {}}, "description": "The answer, or a page"}}
#: Responses of a route that answers with JSON Schema.
SCHEMA_BODY: dict[int | str, Json] = {
    200: {"content": {SCHEMA: {}, "text/html": {}}, "description": "JSON Schema, or a page"}
}


class OpenModel(BaseModel):
    """Base of answers that may have further fields."""

    model_config = ConfigDict(extra="allow")


class Problem(OpenModel):
    """A problem document (RFC 9457)."""

    type: str
    title: str
    status: Annotated[int, Field(ge=400, le=599)]
    detail: str
    code: str | None = None


class Link(OpenModel):
    """A link (RFC 8288) with the fields of STAC and OGC."""

    href: str
    rel: str
    type: str | None = None
    title: str | None = None
    method: Literal["GET", "POST"] | None = None
    body: Json | None = None
    merge: bool | None = None


Form = Annotated[
    Literal["json", "html"] | None,
    Field(description="Form of the answer: json (GeoJSON for features) or html; default: as Accept prefers"),
]


def as_json(
    f: Annotated[
        Literal["json", "html", "jsonfg", "gpkg", "parquet"] | None,
        Query(description="Form of the answer: json or html; of features also jsonfg, gpkg or parquet"),
    ] = None,
) -> None:
    """Check the parameter ``f`` of OGC clients; an unknown form is refused."""


class Conformance(BaseModel):
    """URIs of the requirements classes that are met."""

    conformsTo: list[str]


class Feature(OpenModel):
    """A GeoJSON feature."""

    type: Literal["Feature"]
    id: str
    geometry: Json | None
    properties: Json
    links: list[Link] = []


class FeatureCollection(OpenModel):
    """A page of GeoJSON features."""

    type: Literal["FeatureCollection"]
    features: list[Feature]
    links: list[Link]
    numberMatched: int | None = None
    numberReturned: int
    timeStamp: str | None = None


def geojson_response(body: Json, headers: Mapping[str, str] | None = None) -> Response:
    """Return GeoJSON; numbers that are not finite are null."""
    return Response(
        orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY), media_type=GEOJSON, headers=headers
    )


def schema_response(body: Json) -> Response:
    """Return a JSON Schema."""
    return Response(orjson.dumps(body), media_type=SCHEMA)
