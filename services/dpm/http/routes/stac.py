# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/stac``: STAC API 1.0, read only: core, collections, features and item search."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

import shapely
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from cdff_common.errors import InputError
from dpm_store import Query as StoreQuery
from dpm_store.history.events import ROLES
from services.dpm.http.context import Context, Ctx
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.models import (
    GEOJSON,
    GEOJSON_BODY,
    JSON,
    OPENAPI,
    Conformance,
    Feature,
    FeatureCollection,
    Form,
    Json,
    Link,
    OpenModel,
    as_json,
)
from services.dpm.http.stac.catalogue import Catalogue, FeaturePage, numbers_of, page_size, span_of
from services.dpm.http.stac.items import VERSION, ItemWriter
from services.dpm.queries.bodies import validated

router = APIRouter(prefix="/stac", tags=["stac"], dependencies=[Depends(as_json)])

_CONFORMS = [
    "https://api.stacspec.org/v1.0.0/core",
    "https://api.stacspec.org/v1.0.0/collections",
    "https://api.stacspec.org/v1.0.0/ogcapi-features",
    "https://api.stacspec.org/v1.0.0/item-search",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
]
#: Largest number of corners of a geometry in a search.
_MAX_CORNERS = 10_000
Name = Annotated[str, Path(max_length=64)]
Text = Annotated[str, Field(max_length=20_000)] | None
Limit = Annotated[int, Field(ge=1, le=2**31)]


class Catalog(OpenModel):
    """The landing page."""

    type: Literal["Catalog"] = "Catalog"
    id: str
    title: str
    description: str
    stac_version: str
    conformsTo: list[str]
    links: list[Link]


class StacCollection(OpenModel):
    """A STAC collection."""

    type: Literal["Collection"]
    id: str
    stac_version: str
    description: str
    license: str
    extent: Json
    links: list[Link]


class StacCollections(BaseModel):
    """All collections."""

    collections: list[StacCollection]
    links: list[Link]


class Item(Feature):
    """A STAC item."""

    stac_version: str
    stac_extensions: list[str]
    collection: str
    assets: Json


class ItemCollection(FeatureCollection):
    """A page of items."""

    features: list[Item]  # type: ignore[assignment]  # narrower


class PageParameters(BaseModel):
    """Parameters of a page of items."""

    model_config = ConfigDict(extra="forbid")

    bbox: Text = Field(None, description="4 or 6 numbers: degrees of the body, longitude first")
    datetime: Text = Field(None, description="RFC 3339 time, or an interval t0/t1, open with ..")
    limit: Limit | None = Field(None, description="Items per page, at most 1000")
    token: Text = Field(None, description="Token of the previous page")
    f: Form = None


class ItemsParameters(PageParameters):
    """Parameters of a page of a collection's items."""

    collections: Text = Field(None, description="The collection of the path, which pystac-client repeats")


class SearchParameters(PageParameters):
    """Parameters of a search; ``bbox`` or ``intersects``, not both."""

    collections: Text = Field(None, description="Ids, separated by commas")
    ids: Text = Field(None, description="Ids, separated by commas")
    intersects: Text = Field(None, description="A GeoJSON geometry in degrees of the body")


class SearchBody(BaseModel):
    """A search as JSON."""

    model_config = ConfigDict(extra="forbid")

    bbox: Annotated[list[float], Field(min_length=4, max_length=6)] | None = None
    datetime: Annotated[str, Field(max_length=100)] | None = None
    limit: Limit | None = None
    token: Annotated[str, Field(max_length=200)] | None = None
    collections: Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=100)] | None = None
    ids: Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=1000)] | None = None
    intersects: Json | None = None


_SEARCH_BODY = TypeAdapter(SearchBody)


@router.get("", response_model_exclude_none=True)
def landing(context: Ctx, request: Request) -> Catalog:
    """Return the landing page: a catalog with its collections as children."""
    root, stac = str(request.base_url), stac_url(request)
    links = [
        Link(rel="self", type=JSON, href=stac),
        Link(rel="root", type=JSON, href=stac),
        Link(rel="conformance", type=JSON, href=f"{stac}/conformance"),
        Link(rel="data", type=JSON, href=f"{stac}/collections"),
        Link(rel="search", type=GEOJSON, href=f"{stac}/search", method="GET"),
        Link(rel="search", type=GEOJSON, href=f"{stac}/search", method="POST"),
        Link(rel="service-desc", type=OPENAPI, href=f"{root}openapi.json"),
        Link(rel="service-doc", type="text/html", href=f"{root}docs"),
        *(
            Link(rel="child", type=JSON, href=f"{stac}/collections/{c.id}", title=c.title)
            for c in Catalogue(context).collections()
        ),
    ]
    return Catalog(
        id="cdff",
        title="CDFF data products",
        description="Maps, clouds, poses and images of robots.",
        stac_version=VERSION,
        conformsTo=_CONFORMS,
        links=links,
    )


@router.get("/conformance")
def conformance() -> Conformance:
    """Return the conformance classes."""
    return Conformance(conformsTo=_CONFORMS)


@router.get("/collections", response_model_exclude_none=True)
def collections(context: Ctx, request: Request) -> StacCollections:
    """Return a collection for each product type."""
    catalogue = Catalogue(context)
    writer = ItemWriter(str(request.base_url), catalogue.places)
    stac = stac_url(request)
    links = [
        Link(rel="self", type=JSON, href=f"{stac}/collections"),
        Link(rel="root", type=JSON, href=stac),
    ]
    all_collections = [StacCollection(**writer.collection(c)) for c in catalogue.collections()]
    return StacCollections(collections=all_collections, links=links)


@router.get("/collections/{collection}", response_model_exclude_none=True)
def collection(context: Ctx, request: Request, collection: Name) -> StacCollection:
    """Return one collection."""
    catalogue = Catalogue(context)
    described = ItemWriter(str(request.base_url), catalogue.places).collection(
        catalogue.collection(collection)
    )
    return StacCollection(**described)


@router.get("/collections/{collection}/items", response_model=ItemCollection, responses=GEOJSON_BODY)
def items(
    context: Ctx, request: Request, collection: Name, parameters: Annotated[ItemsParameters, Query()]
) -> Response:
    """Return the items of a collection, newest first."""
    Catalogue(context).extents(collection)
    if parameters.collections is not None and collection not in (_names(parameters.collections) or ()):
        raise InputError(
            f"collections={parameters.collections[:80]!r}: expected {collection!r}, as in the path"
        )
    body = _search_body(parameters, collections=[collection])
    url = f"{stac_url(request)}/collections/{collection}/items"
    return _answer(context, request, body, url, parameters.model_dump(exclude_none=True))


@router.get("/collections/{collection}/items/{item}", response_model=Item, responses=GEOJSON_BODY)
def item(context: Ctx, request: Request, collection: Name, item: Name) -> Response:
    """Return one item."""
    catalogue = Catalogue(context)
    writer = ItemWriter(str(request.base_url), catalogue.places)
    (item_data,) = writer.items([catalogue.get(collection, item)])
    return Response(json.dumps(item_data, allow_nan=False), media_type=GEOJSON)


@router.get("/search", response_model=ItemCollection, responses=GEOJSON_BODY)
def search(context: Ctx, request: Request, parameters: Annotated[SearchParameters, Query()]) -> Response:
    """Search the items of all collections."""
    body = _search_body(
        parameters,
        collections=_names(parameters.collections),
        ids=_names(parameters.ids),
        intersects=None if parameters.intersects is None else _json(parameters.intersects),
    )
    return _answer(
        context, request, body, f"{stac_url(request)}/search", parameters.model_dump(exclude_none=True)
    )


@router.post("/search", response_model=ItemCollection, responses=GEOJSON_BODY, openapi_extra=allowed(*ROLES))
def search_body(context: Ctx, request: Request, body: SearchBody) -> Response:
    """Search the items of all collections by a JSON body."""
    return _answer(context, request, body, f"{stac_url(request)}/search", None)


def _search_body(parameters: PageParameters, **other: Any) -> SearchBody:
    """Return a search in the URL as a search with a body, which has the same bounds; raises InputError."""
    shared = {"datetime": parameters.datetime, "limit": parameters.limit, "token": parameters.token}
    return validated(_SEARCH_BODY, {"bbox": numbers_of(parameters.bbox), **shared, **other}, "search")


def stac_url(request: Request) -> str:
    """Return the URL of this interface as requested by the caller."""
    return f"{request.base_url}stac"


def find(context: Context, parameters: SearchBody) -> tuple[FeaturePage, Catalogue]:
    """Return the products of a search.

    Raises
    ------
    InputError
        If the box, geometry, time or token is malformed.
    """
    if parameters.bbox is not None and parameters.intersects is not None:
        raise InputError("bbox and intersects: give one of the two")
    catalogue = Catalogue(context)
    intersects = None if parameters.intersects is None else geometry_of(parameters.intersects)
    t0_ns, t1_ns = span_of(parameters.datetime)
    types = tuple(parameters.collections or ())
    query = StoreQuery(
        types=types, t0_ns=t0_ns, t1_ns=t1_ns, limit=page_size(parameters.limit), cursor=parameters.token
    )
    if parameters.ids is not None:
        return catalogue.find_ids(
            parameters.ids, query, bbox=parameters.bbox, intersects=intersects
        ), catalogue
    return catalogue.find(query, bbox=parameters.bbox, intersects=intersects), catalogue


def geometry_of(data: Json) -> Any:
    """Return a GeoJSON geometry; raises InputError if it is none, too large, or intersects itself."""
    try:
        geometry = shapely.from_geojson(json.dumps(data))
    except (shapely.errors.GEOSException, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"intersects: expected a GeoJSON geometry: {error}") from error
    if geometry is None or geometry.is_empty or data.get("type") in ("Feature", "FeatureCollection"):
        raise InputError("intersects: expected a GeoJSON geometry with coordinates")
    coordinates = shapely.get_coordinates(geometry)
    if len(coordinates) > _MAX_CORNERS:
        raise InputError(f"intersects: {len(coordinates)} corners, expected at most {_MAX_CORNERS}")
    if not bool((abs(coordinates) <= [540.0, 90.0]).all()):
        raise InputError("intersects: expected degrees, longitude first, latitude within ±90")
    if not geometry.is_valid:
        raise InputError(f"intersects: {shapely.is_valid_reason(geometry)}")
    return geometry


def _answer(
    context: Context, request: Request, parameters: SearchBody, url: str, query: Json | None
) -> Response:
    """Return a page of items; ``query`` are the parameters of a GET, None for a POST."""
    result, catalogue = find(context, parameters)
    writer = ItemWriter(str(request.base_url), catalogue.places)
    features = writer.items(result.items)
    href = url if not query else f"{url}?{urlencode(query)}"
    links: list[Json] = [
        {"rel": "self", "type": GEOJSON, "href": href},
        {"rel": "root", "type": JSON, "href": stac_url(request)},
    ]
    headers = {}
    if result.cursor is not None:
        if query is None:
            body = parameters.model_dump(exclude_none=True) | {"token": result.cursor}
            links.append({"rel": "next", "type": GEOJSON, "href": url, "method": "POST", "body": body})
        else:
            href = f"{url}?{urlencode(query | {'token': result.cursor})}"
            links.append({"rel": "next", "type": GEOJSON, "href": href, "method": "GET"})
            headers["Link"] = f'<{href}>; rel="next"; type="{GEOJSON}"'
    page: Json = {"type": "FeatureCollection", "features": features, "links": links}
    if result.count is not None:
        page["numberMatched"] = result.count
    page["numberReturned"] = len(features)
    return Response(json.dumps(page, allow_nan=False), media_type=GEOJSON, headers=headers)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name for name in text.split(",") if name][:1000]


def _json(text: str) -> Json:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"intersects: expected GeoJSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"intersects: a {type(data).__name__}, expected a GeoJSON geometry")
    return data
