# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/ogc``: OGC API Features 1.0 part 1 (core, GeoJSON) and part 2 (CRS), read only: footprints and
trajectories.

OGC 17-069r4 and 18-058r1. Coordinates refer to the body on which the site is anchored. Features in a frame
that is not anchored have no ``geometry``; ``outline_m`` of every feature is in metres of its frame.
"""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field

from cdff_common.clock import format_stamp, wall_ns
from cdff_common.errors import ProductNotFoundError
from dpm_store import Query as StoreQuery
from services.dpm.http.context import Context, Ctx
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
from services.dpm.http.ogc.crs import CrsList, lonlat
from services.dpm.http.ogc.features import FeatureWriter
from services.dpm.http.ogc.tracks import TRACKS, track_collection, track_of, tracks_in
from services.dpm.http.stac.catalogue import Catalogue, Collection, numbers_of, page_size, span_of

router = APIRouter(prefix="/ogc", tags=["ogc"], dependencies=[Depends(as_json)])

_CONFORMS = [
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
    "http://www.opengis.net/spec/ogcapi-features-2/1.0/conf/crs",
]
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
    cursor: Text = Field(None, description="Cursor of the previous page")
    f: Form = None


@router.get("")
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
    ]
    return Landing(
        title="CDFF data products", description="Footprints of data products, and trajectories", links=links
    )


@router.get("/conformance")
def conformance() -> Conformance:
    """Return the conformance classes."""
    return Conformance(conformsTo=_CONFORMS)


@router.get("/collections", response_model_exclude_none=True)
def collections(context: Ctx, request: Request) -> Collections:
    """Return a collection of footprints for each product type, and one of trajectories."""
    base, crs = base_url(request), crs_list(context, request)
    all_collections = [_described(c, base, crs) for c in _all(context)]
    links = [Link(href=f"{base}/collections", rel="self", type=JSON)]
    return Collections(collections=all_collections, crs=[] if crs is None else crs.uris, links=links)


@router.get("/collections/{collection}", response_model_exclude_none=True)
def collection(context: Ctx, request: Request, collection: Name) -> OgcCollection:
    """Return one collection."""
    return _described(_one(context, collection), base_url(request), crs_list(context, request))


@router.get("/collections/{collection}/items", response_model=FeatureCollection, responses=GEOJSON_BODY)
def items(
    context: Ctx, request: Request, collection: Name, parameters: Annotated[ItemParameters, Query()]
) -> Response:
    """Return features of a collection; ``links`` and ``Link`` lead to the next page, ``Content-Crs`` names
    the CRS.
    """
    if collection != TRACKS:
        Catalogue(context).extents(collection)
    writer = FeatureWriter(base_url(request), crs_list(context, request), parameters.crs)
    bbox = writer.degrees(numbers_of(parameters.bbox), parameters.bbox_crs)
    t0_ns, t1_ns = span_of(parameters.datetime)
    count: int | None = None
    if collection == TRACKS:
        limit = page_size(parameters.limit)
        tracks, cursor = tracks_in(context, bbox, t0_ns, t1_ns, parameters.robot, limit, parameters.cursor)
        features = [writer.track(track) for track in tracks]
    else:
        query = StoreQuery(
            types=(collection,),
            robot=parameters.robot,
            status=parameters.status,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            limit=page_size(parameters.limit),
            cursor=parameters.cursor,
        )
        catalogue = Catalogue(context, None if writer.crs_list is None else writer.crs_list.body)
        page = catalogue.find(query, bbox=bbox)
        cursor, count = page.cursor, page.count
        features = [writer.footprint(placed) for placed in page.items]
    url = f"{base_url(request)}/collections/{collection}/items"
    link_parameters = parameters.model_dump(by_alias=True, exclude_none=True)
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


@router.get("/collections/{collection}/items/{item}", response_model=Feature, responses=GEOJSON_BODY)
def item(
    context: Ctx,
    request: Request,
    collection: Name,
    item: Annotated[str, Path(max_length=256)],
    crs: Annotated[str | None, Query(max_length=400, description="URI of the requested CRS")] = None,
) -> Response:
    """Return one feature."""
    writer = FeatureWriter(base_url(request), crs_list(context, request), crs)
    if collection == TRACKS:
        feature = writer.track(track_of(context, item))
    else:
        feature = writer.footprint(Catalogue(context).get(collection, item))
    return writer.response(feature, feature["links"])


@router.get("/crs/{name}", response_class=PlainTextResponse)
def crs(context: Ctx, name: Annotated[str, Path(max_length=64)]) -> str:
    """Return, as WKT2, a CRS that no authority defines: longitude before latitude on the site's body."""
    body = context.places.body
    if body is None or name != f"{body.name}_lonlat":
        raise ProductNotFoundError(f"no CRS {name[:64]!r} is defined here")
    return str(lonlat(body).to_wkt("WKT2_2019"))


def base_url(request: Request) -> str:
    """Return the URL of this interface as requested by the caller."""
    return f"{request.base_url}ogc"


def crs_list(context: Context, request: Request) -> CrsList | None:
    """Return the CRSs of features; None if the site is not anchored."""
    body = context.places.body
    return None if body is None else CrsList(body, base_url(request))


def _all(context: Context) -> list[Collection]:
    tracks = track_collection(context)
    return [*Catalogue(context).collections(), *([] if tracks is None else [tracks])]


def _one(context: Context, name: str) -> Collection:
    tracks = track_collection(context) if name == TRACKS else None
    return tracks or Catalogue(context).collection(name)


def _described(c: Collection, base: str, crs: CrsList | None) -> OgcCollection:
    url = f"{base}/collections/{c.id}"
    links = [
        Link(href=url, rel="self", type=JSON),
        Link(href=f"{url}/items", rel="items", type=GEOJSON, title=c.title),
    ]
    extent: Json = {"temporal": {"interval": [c.interval]}}
    if crs is not None:
        extent["spatial"] = {"bbox": [c.spatial_deg], "crs": crs.default.uri}
    uris, storage = ([], None) if crs is None else (crs.uris, crs.storage.uri)
    return OgcCollection(
        id=c.id,
        title=c.title,
        description=c.description,
        extent=extent,
        crs=uris,
        storageCrs=storage,
        links=links,
    )


def _with(url: str, parameters: dict[str, Any]) -> str:
    return f"{url}?{urlencode(parameters)}" if parameters else url
