# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/ogc``: OGC API Features 1.0 part 1 (core, GeoJSON) and part 2 (CRS), read only: footprints and trajectories.

OGC 17-069r4 and 18-058r1. Coordinates are of the body that the site is anchored on. What lies in a frame that is not
anchored has no ``geometry``; ``outline_m`` of every feature is in metres of its frame.
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
from services.dpm.http.catalogue import Catalogue, Collection, numbers_of, page_size, span_of
from services.dpm.http.context import Context, Ctx
from services.dpm.http.crs import CrsList, lonlat
from services.dpm.http.models import OPENAPI, Conformance, Feature, FeatureCollection, Form, Json, Link, Open, as_json
from services.dpm.http.ogc_features import FeatureWriter
from services.dpm.http.places import Places
from services.dpm.http.tracks import TRACKS, track_collection, track_of, tracks_in

router = APIRouter(prefix="/ogc", tags=["ogc"], dependencies=[Depends(as_json)])

GEOJSON = "application/geo+json"
_CONFORMS = [
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
    "http://www.opengis.net/spec/ogcapi-features-2/1.0/conf/crs",
]
_GEOJSON_BODY: dict[int | str, dict[str, Any]] = {200: {"content": {GEOJSON: {}}, "description": "GeoJSON"}}
Name = Annotated[str, Path(max_length=64)]
Text = Annotated[str, Field(max_length=400)] | None


class Landing(BaseModel):
    """Where to go on."""

    title: str
    description: str
    links: list[Link]


class OgcCollection(Open):
    """A collection as OGC API Features describes it."""

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
    """What items are asked with."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    bbox: Text = Field(None, description="4 or 6 numbers, in bbox-crs")
    bbox_crs: Text = Field(None, alias="bbox-crs", description="URI of the CRS of bbox; longitude, latitude without it")
    crs: Text = Field(None, description="URI of the CRS wanted, one of the collection's")
    datetime: Text = Field(None, description="RFC 3339 time, or an interval t0/t1, open with ..")
    limit: Annotated[int, Field(ge=1, le=2**31)] | None = Field(None, description="Of the page; 1000 at most")
    robot: Text = Field(None, description="Of this robot only")
    status: Text = Field(None, description="OK, DEGRADED or FAILED only")
    cursor: Text = Field(None, description="Of the page before")
    f: Form = None


@router.get("")
def landing(request: Request) -> Landing:
    """The landing page: what there is and where."""
    base = base_url(request)
    root, text = str(request.base_url), "application/json"
    links = [
        Link(href=base, rel="self", type=text, title="This document"),
        Link(href=f"{root}openapi.json", rel="service-desc", type=OPENAPI, title="The interface"),
        Link(href=f"{root}docs", rel="service-doc", type="text/html", title="The interface, to read"),
        Link(href=f"{base}/conformance", rel="conformance", type=text, title="What is conformed to"),
        Link(href=f"{base}/collections", rel="data", type=text, title="The collections"),
    ]
    return Landing(title="CDFF data products", description="Footprints of data products, and trajectories", links=links)


@router.get("/conformance")
def conformance() -> Conformance:
    """The requirements classes that are met."""
    return Conformance(conformsTo=_CONFORMS)


@router.get("/collections", response_model_exclude_none=True)
def collections(context: Ctx, request: Request) -> Collections:
    """A collection of footprints for each type of product, and one of trajectories."""
    base, crs = base_url(request), crs_list(context, request)
    found = [_described(c, base, crs) for c in _all(context)]
    links = [Link(href=f"{base}/collections", rel="self", type="application/json")]
    return Collections(collections=found, crs=[] if crs is None else crs.uris, links=links)


@router.get("/collections/{collection}", response_model_exclude_none=True)
def collection(context: Ctx, request: Request, collection: Name) -> OgcCollection:
    """One collection."""
    return _described(_one(context, collection), base_url(request), crs_list(context, request))


@router.get("/collections/{collection}/items", response_model=FeatureCollection, responses=_GEOJSON_BODY)
def items(context: Ctx, request: Request, collection: Name, asked: Annotated[ItemParameters, Query()]) -> Response:
    """Features of a collection; ``links`` and ``Link`` lead to the next page, ``Content-Crs`` names the CRS."""
    if collection != TRACKS:
        Catalogue(context).check(collection)
    writer = FeatureWriter(base_url(request), crs_list(context, request), asked.crs)
    bbox = writer.degrees(numbers_of(asked.bbox), asked.bbox_crs)
    t0_ns, t1_ns = span_of(asked.datetime)
    if collection == TRACKS:
        found = tracks_in(context, bbox, t0_ns, t1_ns, asked.robot, page_size(asked.limit), asked.cursor)
        features, cursor = [writer.track(track) for track in found.items], found.cursor
    else:
        query = StoreQuery(
            types=(collection,), robot=asked.robot, status=asked.status, t0_ns=t0_ns, t1_ns=t1_ns,
            limit=page_size(asked.limit), cursor=asked.cursor,
        )  # fmt: skip
        page = Catalogue(context).find(query, bbox=bbox)
        features, cursor = [writer.footprint(placed) for placed in page.items], page.cursor
    url = f"{base_url(request)}/collections/{collection}/items"
    parameters = asked.model_dump(by_alias=True, exclude_none=True)
    links = [{"href": _with(url, parameters), "rel": "self", "type": GEOJSON}]
    if cursor is not None:
        links.append({"href": _with(url, parameters | {"cursor": cursor}), "rel": "next", "type": GEOJSON})
    links.append({"href": url.removesuffix("/items"), "rel": "collection", "type": "application/json"})
    body = {
        "type": "FeatureCollection", "features": features, "links": links, "numberReturned": len(features),
        "timeStamp": format_stamp(wall_ns()),
    }  # fmt: skip
    return writer.response(body, links)


@router.get("/collections/{collection}/items/{item}", response_model=Feature, responses=_GEOJSON_BODY)
def item(
    context: Ctx, request: Request, collection: Name, item: Annotated[str, Path(max_length=256)],
    crs: Annotated[str | None, Query(max_length=400, description="URI of the CRS wanted")] = None,
) -> Response:  # fmt: skip
    """One feature."""
    writer = FeatureWriter(base_url(request), crs_list(context, request), crs)
    if collection == TRACKS:
        feature = writer.track(track_of(context, item))
    else:
        feature = writer.footprint(Catalogue(context).get(collection, item))
    return writer.response(feature, feature["links"])


@router.get("/crs/{name}", response_class=PlainTextResponse)
def crs(context: Ctx, name: Annotated[str, Path(max_length=64)]) -> str:
    """The definition, as WKT2, of a CRS that no authority lists: longitude before latitude on the site's body."""
    body = Places(context.dpm.store).body
    if body is None or name != f"{body.name}_lonlat":
        raise ProductNotFoundError(f"no CRS {name[:64]!r} is defined here")
    return str(lonlat(body).to_wkt("WKT2_2019"))


def base_url(request: Request) -> str:
    """URL of this interface, as the caller reached it."""
    return f"{request.base_url}ogc"


def crs_list(context: Context, request: Request) -> CrsList | None:
    """What coordinates can be had in; None where the site is not anchored."""
    body = Places(context.dpm.store).body
    return None if body is None else CrsList(body, base_url(request))


def _all(context: Context) -> list[Collection]:
    tracks = track_collection(context)
    return [*Catalogue(context).collections(), *([] if tracks is None else [tracks])]


def _one(context: Context, name: str) -> Collection:
    found = track_collection(context) if name == TRACKS else None
    return found or Catalogue(context).collection(name)


def _described(c: Collection, base: str, crs: CrsList | None) -> OgcCollection:
    url = f"{base}/collections/{c.id}"
    links = [
        Link(href=url, rel="self", type="application/json"),
        Link(href=f"{url}/items", rel="items", type=GEOJSON, title=c.title),
    ]
    extent: Json = {"temporal": {"interval": [c.interval]}}
    if crs is not None:
        extent["spatial"] = {"bbox": [c.spatial_deg], "crs": crs.default.uri}
    uris, storage = ([], None) if crs is None else (crs.uris, crs.storage.uri)
    return OgcCollection(
        id=c.id, title=c.title, description=c.description, extent=extent, crs=uris, storageCrs=storage, links=links
    )


def _with(url: str, parameters: dict[str, Any]) -> str:
    return f"{url}?{urlencode(parameters)}" if parameters else url
