# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/ogc``: OGC API Features 1.0 part 1 (core, GeoJSON) and part 2 (CRS), read only: footprints and
trajectories.

OGC 17-069r4 and 18-058r1. Coordinates refer to the body on which the site is anchored. Features in a frame
that is not anchored have no ``geometry``; ``outline_m`` of every feature is in metres of its frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

import shapely
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.clock import format_stamp, wall_ns
from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geodesy import Body
from cdff_common.geometry import checked_frame
from dpm_store import Query as StoreQuery
from dpm_store.search.filters import Call
from dpm_store.search.filters import Field as Column
from services.dpm.http.context import Context, Ctx
from services.dpm.http.cql2.expressions import LANGUAGES
from services.dpm.http.cql2.queryables import FEATURES, schema
from services.dpm.http.geoparquet import MEDIA_TYPE as GEOPARQUET
from services.dpm.http.geoparquet import MOST_EXPORTED, check_support, write_features
from services.dpm.http.html_pages import NegotiatedRoute
from services.dpm.http.models import (
    DIALECT,
    FILTER_CLASSES,
    GEOJSON,
    GEOJSON_BODY,
    JSON,
    OPENAPI,
    PAGE,
    QUERYABLES,
    SCHEMA,
    SCHEMA_BODY,
    SCHEMA_RELATION,
    Conformance,
    Feature,
    FeatureCollection,
    Json,
    Link,
    OpenModel,
    as_json,
    schema_response,
)
from services.dpm.http.ogc.crs import CrsList, lonlat
from services.dpm.http.ogc.features import JSONFG, PROPERTIES, TRACK_PROPERTIES, FeatureWriter
from services.dpm.http.ogc.geopackage import MEDIA_TYPE as GEOPACKAGE
from services.dpm.http.ogc.geopackage import write_geopackage
from services.dpm.http.ogc.tracks import TRACKS, track_collection, track_of, tracks_in
from services.dpm.http.search_places import both
from services.dpm.http.stac.catalogue import (
    Catalogue,
    Collection,
    bounds_deg,
    numbers_of,
    page_size,
    span_of,
)
from services.dpm.http.stac.searches import FilterText, Language, filter_of, order_of, sorted_fields

router = APIRouter(
    prefix="/ogc", tags=["ogc"], dependencies=[Depends(as_json)], route_class=NegotiatedRoute, responses=PAGE
)

_CONFORMS = [
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/html",
    "http://www.opengis.net/spec/ogcapi-features-2/1.0/conf/crs",
    *FILTER_CLASSES,
    "http://www.opengis.net/spec/ogcapi-features-5/1.0/conf/schemas",
    "http://www.opengis.net/spec/json-fg-1/1.0/conf/core",
]
#: Classes of OGC API Tiles and of the tile matrix sets that ``ogc_maps`` meets, and collections with maps.
MAP_CLASSES = (
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/tileset",
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/tilesets-list",
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/geodata-tilesets",
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/png",
    "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/tiff",
    "http://www.opengis.net/spec/tms/2.0/conf/json-tilematrixset",
)
MAPS = ("dem", "navigation_map")
_REL = "http://www.opengis.net/def/rel/ogc/1.0"
_SQL_TYPES = {"string": "TEXT", "number": "REAL", "integer": "INTEGER"}
#: Forms of all pages as one file, with their media type.
_EXPORTS = {"gpkg": GEOPACKAGE, "parquet": GEOPARQUET}
ITEMS_BODY: dict[int | str, Json] = {
    200: {
        "content": {GEOJSON: {}, "text/html": {}, JSONFG: {}, GEOPACKAGE: {}, GEOPARQUET: {}},
        "description": "GeoJSON, or the form of f",
    }
}
Name = Annotated[str, Path(max_length=64)]
Text = Annotated[str, Field(max_length=400)] | None


class Landing(BaseModel):
    """The landing page."""

    title: str
    description: str
    links: list[Link]


class OgcCollection(OpenModel):
    """A collection of OGC API Features."""

    id: str
    title: str
    description: str
    itemType: str = "feature"
    extent: Json
    crs: list[str] = []
    storageCrs: str | None = None
    links: list[Link]


class Collections(BaseModel):
    """All collections."""

    collections: list[OgcCollection]
    crs: list[str] = []
    links: list[Link]


class ItemParameters(BaseModel):
    """Parameters of a page of features."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    bbox: Text = Field(None, description="4 or 6 numbers, in bbox-crs")
    bbox_crs: Text = Field(
        None, alias="bbox-crs", description="URI of the CRS of bbox; longitude, latitude without it"
    )
    crs: Text = Field(None, description="URI of the requested CRS, one of the collection")
    datetime: Text = Field(None, description="RFC 3339 time, or an interval t0/t1, open with ..")
    limit: Annotated[int, Field(ge=1, le=2**31)] | None = Field(
        None, description="Features per page, at most 1000"
    )
    robot: Text = Field(None, description="Only products of this robot")
    status: Text = Field(None, description="Only products of this status: OK, DEGRADED or FAILED")
    cursor: Annotated[str, Field(max_length=4000)] | None = Field(
        None, description="Cursor of the previous page"
    )
    filter: FilterText = Field(None, description="Condition in CQL2; see queryables")
    filter_lang: Language = Field(None, alias="filter-lang", description=" or ".join(LANGUAGES))
    filter_crs: Text = Field(None, alias="filter-crs", description="Longitude first, the only one")
    sortby: Text = Field(None, description="Properties with commas, - before one descends")
    properties: Text = Field(None, description="Properties to return, with commas; default: all")
    skipGeometry: bool = Field(False, description="Whether geometries are omitted")
    f: Annotated[Literal["json", "html", "jsonfg", "gpkg", "parquet"], Field()] | None = Field(
        None, description="GeoJSON, HTML, JSON-FG, or GeoPackage or GeoParquet with the features of all pages"
    )

    @property
    def selected(self) -> frozenset[str] | None:
        """Names of the properties to return, None for all; raises InputError for an unknown one."""
        if self.properties is None:
            return None
        names = frozenset(name.strip() for name in self.properties.split(",") if name.strip())
        for name in names - {"outline_m"}:
            if name not in PROPERTIES:
                raise InputError(
                    f"properties: unknown {name[:80]!r}, expected some of {', '.join(PROPERTIES)}"
                )
        return names


@router.get("", response_model_exclude_none=True)
def landing(request: Request) -> Landing:
    """Return the landing page."""
    base = base_url(request)
    root = str(request.base_url)
    links = [
        Link(href=base, rel="self", type=JSON, title="This document"),
        Link(href=f"{root}openapi.json", rel="service-desc", type=OPENAPI, title="The interface"),
        Link(href=f"{root}docs", rel="service-doc", type="text/html", title="The interface, to read"),
        Link(href=f"{base}/conformance", rel="conformance", type=JSON, title="Conformance classes"),
        Link(href=f"{base}/collections", rel="data", type=JSON, title="The collections"),
        Link(href=f"{base}/tileMatrixSets", rel=f"{_REL}/tiling-schemes", type=JSON, title="Grids of tiles"),
    ]
    return Landing(
        title="CDFF data products", description="Footprints of data products, and trajectories", links=links
    )


@router.get("/conformance")
def conformance() -> Conformance:
    """Return the conformance classes."""
    return Conformance(conformsTo=[*_CONFORMS, *MAP_CLASSES])


@router.get("/collections", response_model_exclude_none=True)
def collections(context: Ctx, request: Request) -> Collections:
    """Return a collection of footprints for each product type, and one of trajectories."""
    base = base_url(request)
    lists = {body.name: CrsList(body, base) for body in _bodies(context)}
    first = next(iter(lists.values()), None)
    all_collections = [_described(c, base, lists.get(c.body, first)) for c in _all(context)]
    links = [Link(href=f"{base}/collections", rel="self", type=JSON)]
    return Collections(collections=all_collections, crs=[] if first is None else first.uris, links=links)


@router.get("/collections/{collection}", response_model_exclude_none=True)
def collection(context: Ctx, request: Request, collection: Name) -> OgcCollection:
    """Return one collection."""
    of = _Named.of(context, collection)
    return _described(_one(context, collection), base_url(request), of.crs_list(request))


@router.get("/collections/{collection}/items", response_model=FeatureCollection, responses=ITEMS_BODY)
def items(
    context: Ctx, request: Request, collection: Name, parameters: Annotated[ItemParameters, Query()]
) -> Response:
    """Return features of a collection; ``links`` and ``Link`` lead to the next page, ``Content-Crs`` names
    the CRS.
    """
    of = _Named.of(context, collection)
    writer = FeatureWriter(
        base_url(request),
        of.crs_list(request),
        parameters.crs,
        properties=parameters.selected,
        has_geometry=not parameters.skipGeometry,
        is_jsonfg=parameters.f == "jsonfg",
    )
    bbox = writer.degrees(numbers_of(parameters.bbox), parameters.bbox_crs)
    t0_ns, t1_ns = span_of(parameters.datetime)
    count: int | None = None
    if collection == TRACKS:
        _check_tracks(parameters)
        limit = page_size(parameters.limit)
        tracks, cursor = tracks_in(context, bbox, t0_ns, t1_ns, parameters.robot, limit, parameters.cursor)
        features = [writer.track(track) for track in tracks]
    else:
        expression = filter_of(parameters.filter, parameters.filter_lang, parameters.filter_crs, FEATURES)
        if of.frames is not None:
            expression = both(expression, Call("in", (Column("frame"), of.frames)))
        query = StoreQuery(
            types=(of.product,),
            robot=parameters.robot,
            status=parameters.status,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            limit=MAX_PAGE if parameters.f in _EXPORTS else page_size(parameters.limit),
            cursor=parameters.cursor,
            where=expression,
            **order_of(
                [
                    (item["field"], item["direction"] == "desc")
                    for item in sorted_fields(parameters.sortby or "")
                ],
                FEATURES,
            ),
        )
        catalogue = Catalogue(context, None if writer.crs_list is None else writer.crs_list.body)
        if parameters.f is not None and parameters.f in _EXPORTS:
            return _exported(catalogue, query, bbox, writer, collection, parameters.f)
        page = catalogue.find(query, bbox=bbox)
        cursor, count = page.cursor, page.count
        features = [writer.footprint(placed, collection) for placed in page.items]
    url = f"{base_url(request)}/collections/{collection}/items"
    link_parameters = parameters.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)
    links = [{"href": _with(url, link_parameters), "rel": "self", "type": GEOJSON}]
    if cursor is not None:
        links.append(
            {"href": _with(url, link_parameters | {"cursor": cursor}), "rel": "next", "type": GEOJSON}
        )
    links.append({"href": url.removesuffix("/items"), "rel": "collection", "type": JSON})
    body = {
        "type": "FeatureCollection",
        "features": features,
        "links": links,
        **({} if count is None else {"numberMatched": count}),
        "numberReturned": len(features),
        "timeStamp": format_stamp(wall_ns()),
    }
    return writer.response(body, links)


@router.get("/collections/{collection}/queryables", response_model=Json, responses=SCHEMA_BODY)
def queryables(context: Ctx, request: Request, collection: Name) -> Response:
    """Return the properties that filters and orders may use, as JSON Schema."""
    named = _one(context, collection)
    url = f"{base_url(request)}/collections/{collection}/queryables"
    return schema_response(schema(FEATURES, url, named.title))


@router.get("/collections/{collection}/schema", response_model=Json, responses=SCHEMA_BODY)
def feature_schema(context: Ctx, request: Request, collection: Name) -> Response:
    """Return the properties of features as JSON Schema (OGC API Features part 5)."""
    named = _one(context, collection)
    names = TRACK_PROPERTIES if collection == TRACKS else PROPERTIES
    properties: Json = {name: {"type": kind} for name, kind in names.items()}
    properties["geometry"] = {"format": "geometry-any", "x-ogc-role": "primary-geometry"}
    url = f"{base_url(request)}/collections/{collection}/schema"
    document = {"$schema": DIALECT, "$id": url, "type": "object", "title": named.title}
    return schema_response(document | {"properties": properties, "additionalProperties": False})


@router.get("/collections/{collection}/items/{item}", response_model=Feature, responses=GEOJSON_BODY)
def item(
    context: Ctx,
    request: Request,
    collection: Name,
    item: Annotated[str, Path(max_length=256)],
    crs: Annotated[str | None, Query(max_length=400, description="URI of the requested CRS")] = None,
) -> Response:
    """Return one feature."""
    of = _Named.of(context, collection)
    writer = FeatureWriter(base_url(request), of.crs_list(request), crs)
    if collection == TRACKS:
        feature = writer.track(track_of(context, item))
    else:
        feature = writer.footprint(Catalogue(context).get(of.product, item), collection)
    return writer.response(feature, feature["links"])


@router.get("/crs/{name:path}", response_class=PlainTextResponse)
def crs(context: Ctx, name: Annotated[str, Path(max_length=200)]) -> str:
    """Return, as WKT2, a CRS that no authority defines: longitude before latitude on a body, or that of a
    frame, as ``frame/site``.
    """
    kind, _, frame = name.partition("/")
    if kind == "frame" and frame in context.dpm.store.frame_names():
        return context.places.of(checked_frame(frame)).georeference.wkt
    for body in _bodies(context):
        if name == f"{body.name}_lonlat":
            return str(lonlat(body).to_wkt("WKT2_2019"))
    raise ProductNotFoundError(f"no CRS {name[:64]!r} is defined here")


def base_url(request: Request) -> str:
    """Return the URL of this interface as requested by the caller."""
    return f"{request.base_url}ogc"


@dataclass(frozen=True, slots=True)
class _Named:
    """Products of a collection: all of a type, or those on one further body, as ``pointcloud-moon``.

    ``frames`` are those on the body, None for all.
    """

    product: str
    body: Body | None
    frames: tuple[str, ...] | None = None

    @classmethod
    def of(cls, context: Context, collection: str) -> _Named:
        """Return the products of a collection; raises ProductNotFoundError."""
        places = context.places
        product, _, body_name = collection.partition("-")
        if collection == TRACKS or not body_name:
            if collection != TRACKS:
                Catalogue(context).extents(collection)
            return cls(collection, places.body)
        frames = {e.frame: places.body_of(e.frame) for e in Catalogue(context).extents(product)}
        body_by_frame = {frame: b for frame, b in frames.items() if b is not None and b.name == body_name}
        if not body_by_frame or body_name == (places.body.name if places.body else ""):
            raise ProductNotFoundError(f"no collection {collection[:64]!r}")
        return cls(product, next(iter(body_by_frame.values())), tuple(sorted(body_by_frame)))

    def crs_list(self, request: Request) -> CrsList | None:
        """Return the CRSs of its features; None if the site is not anchored."""
        return None if self.body is None else CrsList(self.body, base_url(request))


def _bodies(context: Context) -> list[Body]:
    """Return the bodies with anchored frames, that of the site first."""
    places = context.places
    body_by_name = {} if places.body is None else {places.body.name: places.body}
    for extent in context.extents.get(context.dpm.store):
        body = places.body_of(extent.frame)
        if body is not None:
            body_by_name.setdefault(body.name, body)
    return list(body_by_name.values())


def _check_tracks(parameters: ItemParameters) -> None:
    """Refuse parameters that trajectories do not have."""
    for name in ("filter", "sortby", "status"):
        if getattr(parameters, name) is not None:
            raise InputError(f"{name}: trajectories have no such selection; expected bbox, datetime or robot")
    if parameters.f in _EXPORTS:
        raise InputError(f"f={parameters.f}: trajectories have no such form, expected json, jsonfg or html")


def _exported(
    catalogue: Catalogue,
    query: StoreQuery,
    bbox: list[float] | None,
    writer: FeatureWriter,
    name: str,
    form: str,
) -> Response:
    """Return the features of all pages as one file; raises InputError if they are too many."""
    if form == "parquet":
        check_support()
    rows: list[tuple[str, Any, Json]] = []
    while True:
        page = catalogue.find(query, bbox=bbox)
        rows += [writer.row(product) for product in page.items]
        if len(rows) > MOST_EXPORTED:
            raise InputError(
                f"f={form}: more than {MOST_EXPORTED} features; restrict them by bbox or datetime"
            )
        if page.cursor is None:
            break
        query = replace(query, cursor=page.cursor)
    body = None if writer.crs_list is None else writer.crs_list.body
    if form == "parquet":
        data = write_features(body, rows, PROPERTIES)
    else:
        columns = {n: _SQL_TYPES[kind] for n, kind in PROPERTIES.items()}
        data = write_geopackage(name.replace("-", "_"), body, rows, columns)
    headers = {"Content-Disposition": f'attachment; filename="{name}.{form}"'}
    return Response(data, media_type=_EXPORTS[form], headers=headers)


def _all(context: Context) -> list[Collection]:
    tracks = track_collection(context)
    collections = Catalogue(context).collections()
    others = [
        _on_body(context, c, body)
        for c in collections
        for body in _bodies(context)[1:]
        if _has(context, c, body)
    ]
    return [*collections, *others, *([] if tracks is None else [tracks])]


def _has(context: Context, c: Collection, body: Body) -> bool:
    return any(context.places.body_of(frame) == body for frame in c.frames)


def _on_body(context: Context, collection: Collection, body: Body) -> Collection:
    """Return the collection of the products of another one that are on a further body."""
    places = context.places
    extents = [e for e in Catalogue(context).extents(collection.id) if places.body_of(e.frame) == body]
    outlines = [
        places.outline_in_degrees(e.frame, shapely.box(*e.box_m[:2], *e.box_m[3:5]))
        for e in extents
        if e.box_m is not None
    ]
    return replace(
        collection, id=f"{collection.id}-{body.name}", bounds_deg=bounds_deg(outlines), body=body.name
    )


def _one(context: Context, name: str) -> Collection:
    if name == TRACKS:
        tracks = track_collection(context)
        if tracks is None:
            raise ProductNotFoundError(f"no collection {TRACKS!r}")
        return tracks
    of = _Named.of(context, name)
    collection = Catalogue(context).collection(of.product)
    return collection if of.frames is None or of.body is None else _on_body(context, collection, of.body)


def _described(collection: Collection, base: str, crs: CrsList | None) -> OgcCollection:
    url = f"{base}/collections/{collection.id}"
    links = [
        Link(href=url, rel="self", type=JSON),
        Link(href=f"{url}/items", rel="items", type=GEOJSON, title=collection.title),
        Link(href=f"{url}/items?f=html", rel="items", type="text/html", title=f"{collection.title}, to read"),
        Link(href=f"{url}/schema", rel=SCHEMA_RELATION, type=SCHEMA, title="Schema"),
        *(
            []
            if collection.id not in MAPS
            else [
                Link(href=f"{url}/map/tiles", rel=f"{_REL}/tilesets-map", type=JSON, title="Tiles"),
                Link(href=f"{url}/coverage", rel=f"{_REL}/coverage", type="image/tiff", title="Values"),
                *(_coverage_links(url) if collection.id == "dem" else []),
            ]
        ),
        *([] if collection.id == TRACKS else [Link(href=f"{url}/queryables", rel=QUERYABLES, type=SCHEMA)]),
        *(
            []
            if collection.id == TRACKS
            else [
                Link(href=f"{url}/items?f={form}", rel="enclosure", type=media_type)
                for form, media_type in _EXPORTS.items()
            ]
        ),
    ]
    extent: Json = {"temporal": {"interval": [collection.interval]}}
    if crs is not None:
        extent["spatial"] = {"bbox": [collection.spatial_deg], "crs": crs.default.uri}
    uris, storage = ([], None) if crs is None else (crs.uris, crs.storage.uri)
    return OgcCollection(
        id=collection.id,
        title=collection.title,
        description=collection.description,
        extent=extent,
        crs=uris,
        storageCrs=storage,
        links=links,
    )


def _coverage_links(url: str) -> list[Link]:
    """Return the links of coverages in degrees, with the media type that GDAL expects."""
    return [
        Link(href=f"{url}/coverage", rel=f"{_REL}/coverage", type="image/tiff; application=geotiff"),
        Link(href=f"{url}/coverage/domainset", rel=f"{_REL}/coverage-domainset", type=JSON),
        Link(href=f"{url}/coverage/rangetype", rel=f"{_REL}/coverage-rangetype", type=JSON),
    ]


def _with(url: str, parameters: dict[str, Any]) -> str:
    return f"{url}?{urlencode(parameters)}" if parameters else url
