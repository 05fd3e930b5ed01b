# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/stac``: STAC API 1.0, read only: core, collections, features, searches with filter, sort and fields."""

from __future__ import annotations

from typing import Annotated, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import InputError
from dpm_store.history.events import ROLES
from services.dpm.http.context import Context, Ctx
from services.dpm.http.cql2.queryables import STAC, schema
from services.dpm.http.geoparquet import MEDIA_TYPE as GEOPARQUET
from services.dpm.http.geoparquet import MOST_EXPORTED, check_support, write_items
from services.dpm.http.html_pages import NegotiatedRoute
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.models import (
    FILTER_CLASSES,
    GEOJSON,
    GEOJSON_BODY,
    JSON,
    OPENAPI,
    PAGE,
    QUERYABLES,
    SCHEMA,
    SCHEMA_BODY,
    Conformance,
    Feature,
    FeatureCollection,
    Form,
    Json,
    Link,
    OpenModel,
    as_json,
    geojson_response,
    schema_response,
)
from services.dpm.http.stac.catalogue import Catalogue, OutlinedProduct, numbers_of, selected_collections
from services.dpm.http.stac.items import VERSION, ItemWriter
from services.dpm.http.stac.searches import (
    ItemsParameters,
    Limit,
    SearchBody,
    SearchParameters,
    Text,
    find,
    json_in,
    names_in,
    search_body,
)

router = APIRouter(
    prefix="/stac",
    tags=["stac"],
    dependencies=[Depends(as_json)],
    route_class=NegotiatedRoute,
    responses=PAGE,
)

_CONFORMS = [
    "https://api.stacspec.org/v1.0.0/core",
    "https://api.stacspec.org/v1.0.0/collections",
    "https://api.stacspec.org/v1.0.0/ogcapi-features",
    "https://api.stacspec.org/v1.0.0/item-search",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
    *FILTER_CLASSES,
    "https://api.stacspec.org/v1.0.0/item-search#filter",
    "https://api.stacspec.org/v1.0.0/item-search#sort",
    "https://api.stacspec.org/v1.0.0/ogcapi-features#sort",
    "https://api.stacspec.org/v1.0.0/item-search#fields",
    "https://api.stacspec.org/v1.0.0/ogcapi-features#fields",
    "https://api.stacspec.org/v1.0.0-rc.1/collection-search",
    "https://api.stacspec.org/v1.0.0-rc.1/collection-search#free-text",
    "http://www.opengis.net/spec/ogcapi-common-2/1.0/conf/simple-query",
]
ITEMS_BODY: dict[int | str, Json] = {
    200: {
        "content": {GEOJSON: {}, "text/html": {}, GEOPARQUET: {}},
        "description": "GeoJSON, or the form of f",
    }
}
Name = Annotated[str, Path(max_length=64)]


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
    numberMatched: int
    numberReturned: int


class Item(Feature):
    """A STAC item."""

    stac_version: str
    stac_extensions: list[str]
    collection: str
    assets: Json


class ItemCollection(FeatureCollection):
    """A page of items."""

    features: list[Item]  # type: ignore[assignment]  # narrower


class CollectionsParameters(BaseModel):
    """Parameters of a search of collections."""

    model_config = ConfigDict(extra="forbid")

    bbox: Text = Field(None, description="4 or 6 numbers: degrees of the body, longitude first")
    datetime: Text = Field(None, description="RFC 3339 time, or an interval t0/t1, open with ..")
    limit: Limit | None = Field(None, description="Collections per page")
    q: Text = Field(None, description="Words with commas, of which one is in the title or description")
    token: Annotated[int, Field(ge=0, le=10_000)] = Field(0, description="Token of the previous page")
    f: Form = None


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
        Link(rel=QUERYABLES, type=SCHEMA, href=f"{stac}/queryables"),
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
def collections(
    context: Ctx, request: Request, parameters: Annotated[CollectionsParameters, Query()]
) -> StacCollections:
    """Return a collection for each product type, or those in a box and time with a word in their text."""
    catalogue = Catalogue(context)
    writer = ItemWriter(str(request.base_url), catalogue.places)
    stac = stac_url(request)
    selected = selected_collections(
        catalogue.collections(), numbers_of(parameters.bbox), parameters.datetime, parameters.q
    )
    first, count = parameters.token, parameters.limit or len(selected)
    links = [
        Link(rel="self", type=JSON, href=f"{stac}/collections"),
        Link(rel="root", type=JSON, href=stac),
    ]
    if first + count < len(selected):
        query = parameters.model_dump(exclude_none=True) | {"token": first + count}
        links.append(Link(rel="next", type=JSON, href=f"{stac}/collections?{urlencode(query)}"))
    page = [StacCollection(**writer.collection(c)) for c in selected[first : first + count]]
    return StacCollections(
        collections=page, links=links, numberMatched=len(selected), numberReturned=len(page)
    )


@router.get("/collections/{collection}", response_model_exclude_none=True)
def collection(context: Ctx, request: Request, collection: Name) -> StacCollection:
    """Return one collection."""
    catalogue = Catalogue(context)
    described = ItemWriter(str(request.base_url), catalogue.places).collection(
        catalogue.collection(collection)
    )
    return StacCollection(**described)


@router.get("/queryables", response_model=Json, responses=SCHEMA_BODY)
def queryables(request: Request) -> Response:
    """Return the properties that filters may use, as JSON Schema."""
    return schema_response(schema(STAC, f"{stac_url(request)}/queryables", "Properties of items"))


@router.get("/collections/{collection}/queryables", response_model=Json, responses=SCHEMA_BODY)
def collection_queryables(context: Ctx, request: Request, collection: Name) -> Response:
    """Return the properties that filters of a collection's items may use."""
    title = Catalogue(context).collection(collection).title
    url = f"{stac_url(request)}/collections/{collection}/queryables"
    return schema_response(schema(STAC, url, title))


@router.get("/collections/{collection}/items", response_model=ItemCollection, responses=ITEMS_BODY)
def items(
    context: Ctx, request: Request, collection: Name, parameters: Annotated[ItemsParameters, Query()]
) -> Response:
    """Return the items of a collection, newest first."""
    Catalogue(context).extents(collection)
    if parameters.collections is not None and collection not in (names_in(parameters.collections) or ()):
        raise InputError(
            f"collections={parameters.collections[:80]!r}: expected {collection!r}, as in the path"
        )
    body = search_body(parameters, collections=[collection])
    if parameters.f == "parquet":
        return _geoparquet(context, request, body, collection)
    url = f"{stac_url(request)}/collections/{collection}/items"
    return _answer(context, request, body, url, parameters.model_dump(by_alias=True, exclude_none=True))


@router.get("/collections/{collection}/items/{item}", response_model=Item, responses=GEOJSON_BODY)
def item(context: Ctx, request: Request, collection: Name, item: Name) -> Response:
    """Return one item with all its fields."""
    catalogue = Catalogue(context)
    writer = ItemWriter(str(request.base_url), catalogue.places)
    (item_data,) = writer.items([catalogue.get(collection, item)], detailed=True)
    return geojson_response(item_data)


@router.get("/search", response_model=ItemCollection, responses=ITEMS_BODY)
def search(context: Ctx, request: Request, parameters: Annotated[SearchParameters, Query()]) -> Response:
    """Search the items of all collections."""
    body = search_body(
        parameters,
        collections=names_in(parameters.collections),
        ids=names_in(parameters.ids),
        intersects=None if parameters.intersects is None else json_in(parameters.intersects),
    )
    if parameters.f == "parquet":
        return _geoparquet(context, request, body, "items")
    query = parameters.model_dump(by_alias=True, exclude_none=True)
    return _answer(context, request, body, f"{stac_url(request)}/search", query)


@router.post("/search", response_model=ItemCollection, responses=GEOJSON_BODY, openapi_extra=allowed(*ROLES))
def search_by_body(context: Ctx, request: Request, body: SearchBody) -> Response:
    """Search the items of all collections by a JSON body."""
    return _answer(context, request, body, f"{stac_url(request)}/search", None)


def stac_url(request: Request) -> str:
    """Return the URL of this interface as requested by the caller."""
    return f"{request.base_url}stac"


def _answer(
    context: Context, request: Request, parameters: SearchBody, url: str, query: Json | None
) -> Response:
    """Return a page of items; ``query`` are the parameters of a GET, None for a POST."""
    catalogue = Catalogue(context)
    result = find(catalogue, parameters)
    writer, selection = ItemWriter(str(request.base_url), catalogue.places), parameters.selection
    if selection is None:
        features = writer.items(result.items)
    else:
        features = [selection.applied(i) for i in writer.items(result.items, detailed=True)]
    href = url if not query else f"{url}?{urlencode(query)}"
    links: list[Json] = [
        {"rel": "self", "type": GEOJSON, "href": href},
        {"rel": "root", "type": JSON, "href": stac_url(request)},
    ]
    headers = {}
    if result.cursor is not None:
        if query is None:
            body = parameters.model_dump(by_alias=True, exclude_none=True) | {"token": result.cursor}
            links.append({"rel": "next", "type": GEOJSON, "href": url, "method": "POST", "body": body})
        else:
            href = f"{url}?{urlencode(query | {'token': result.cursor})}"
            links.append({"rel": "next", "type": GEOJSON, "href": href, "method": "GET"})
            headers["Link"] = f'<{href}>; rel="next"; type="{GEOJSON}"'
    page: Json = {"type": "FeatureCollection", "features": features, "links": links}
    if result.count is not None:
        page["numberMatched"] = result.count
    page["numberReturned"] = len(features)
    return geojson_response(page, headers)


def _geoparquet(context: Context, request: Request, search: SearchBody, name: str) -> Response:
    """Return the items of all pages of a search as one file.

    Raises
    ------
    InputError
        If the items are too many or on several bodies, or if fields are selected.
    """
    check_support()
    if search.fields is not None:
        raise InputError("f=parquet: the file has the fields of items in lists; expected no fields")
    catalogue = Catalogue(context)
    products: list[OutlinedProduct] = []
    search = search.model_copy(update={"limit": MAX_PAGE})
    while True:
        page = find(catalogue, search)
        products += page.items
        if len(products) > MOST_EXPORTED:
            raise InputError(f"f=parquet: more than {MOST_EXPORTED} items; restrict them by bbox or datetime")
        if page.cursor is None:
            break
        search = search.model_copy(update={"token": page.cursor})
    bodies = {p.body.name: p.body for p in products if p.body is not None}
    if len(bodies) > 1:
        raise InputError(
            f"f=parquet: items on {', '.join(sorted(bodies))}: a file has one CRS; "
            "restrict the items by bbox or filter"
        )
    writer = ItemWriter(str(request.base_url), catalogue.places)
    collections = {
        i: writer.collection(catalogue.collection(i)) for i in {p.record.product for p in products}
    }
    data = write_items(next(iter(bodies.values()), None), writer.items(products), collections)
    headers = {"Content-Disposition": f'attachment; filename="{name}.parquet"'}
    return Response(data, media_type=GEOPARQUET, headers=headers)
