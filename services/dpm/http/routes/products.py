# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/products``: search, metadata, payloads in any format, insertion, deletion."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

import msgpack
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from cdff_common.errors import InputError
from dpm_store import Annotation, Insertion, ProductRecord, StaleRevisionError
from dpm_store.provenance import MAX_GENERATIONS
from services.dpm.convert import Converted, convert, formats_of
from services.dpm.http.conditional import matches, required_revision
from services.dpm.http.context import Context, Ctx, jsonable
from services.dpm.http.native_models import Deleted, Described, Inserted, InsertedAll, ProductPage, Provenance
from services.dpm.http.ranges import parse_range
from services.dpm.http.roles import allowed
from services.dpm.parameters import GROUND, batch_of, search_query

router = APIRouter(prefix="/api/v1/products", tags=["products"])

Robot = Annotated[str, Query(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Text = Annotated[str, Field(max_length=40_000)] | None
Name = Annotated[str, Query(pattern=r"^[a-z0-9_]{1,64}$")]


class SearchParameters(BaseModel):
    """Any mix of these; each narrows the search."""

    model_config = ConfigDict(extra="forbid")

    type: Text = Field(None, description="Products: pose, dem, …; several with commas")
    robot: Text = Field(None, description="Robot id")
    dfpc: Text = Field(None, description="DFPC that made it")
    port: Text = Field(None, description="Output port")
    status: Text = Field(None, description="OK, DEGRADED or FAILED")
    region: Text = Field(None, description="bbox: | box: | circle: | polygon: | path: | near: (contract §6), metres")
    frame: Text = Field(None, description="Frame of the region, default site")
    region_frame: Text = Field(None, description="The same, where both are given this one holds")
    child: Text = Field(None, description="Of a pose: the child frame")
    t0: Text = Field(None, description="Captures that end at or after this: nanoseconds or RFC 3339")
    t1: Text = Field(None, description="Captures that begin at or before this")
    resolution_max_m: Text = Field(None, description="Cells or voxels no larger than this, metres")
    after: Text = Field(None, description="Inserted after this ordinal")
    tag: Text = Field(None, description="Carries this tag; all of several with commas")
    as_of: Text = Field(None, description="What the store knew then: nanoseconds or RFC 3339")
    superseded: Text = Field(None, description="include (default), exclude or only products with a successor")
    order: Text = Field(None, description="newest (default) or oldest end of capture first, or nearest")
    point: Text = Field(None, description="For order=nearest: x,y in the region's frame; default the region's centre")
    quality: Text = Field(None, description="Numbers of the quality within bounds, as inliers>=30,rmse_px<0.5")
    covariance_kind: Text = Field(None, description="calibrated, formal or none")
    frames_revision: Text = Field(None, description="State of the frame tree to place by, of an earlier answer")
    limit: Text = Field(None, description="Of the page, 1 to 1000, default 100")
    cursor: Text = Field(None, description="Of the page before")


@router.get("", response_model=ProductPage)
def search(context: Ctx, request: Request, asked: Annotated[SearchParameters, Query()]) -> Response:
    """Search metadata; newest end of capture first, ``links.next`` leads to the next page."""
    parameters = asked.model_dump(exclude_none=True)
    page = context.dpm.search(search_query(GROUND, parameters))
    links = {"self": f"{request.url.path}?{urlencode(parameters)}"}
    if page.cursor is not None:
        links["next"] = f"{request.url.path}?{urlencode(parameters | {'cursor': page.cursor})}"
    items = [described(record) for record in page.items]
    # Written at once: the model describes it, and holding a page of 1000 against it takes longer than the search.
    return JSONResponse({"items": items, "links": links, **jsonable(page.told())})


@router.post("", response_model=Inserted, status_code=201, openapi_extra=allowed("robot", "operator"))
async def insert(
    context: Ctx, request: Request, response: Response, robot: Robot, dfpc: Name, port: Name, product: Name,
    cdff_header: Annotated[str, Header(description="The product's header, as JSON")],
) -> dict[str, Any]:  # fmt: skip
    """Insert a payload: its encoding string as ``Content-Type``, its header as JSON in ``CDFF-Header``."""
    from starlette.concurrency import run_in_threadpool

    payload = await request.body()
    attachment = header_attachment(cdff_header)
    names = {"robot": robot, "dfpc": dfpc, "port": port, "product": product}
    encoding = request.headers.get("content-type", "")
    insertion, header = await run_in_threadpool(context.dpm.put, names, payload, encoding, attachment)
    response.status_code = 201 if insertion is Insertion.INSERTED else 200
    response.headers["Location"] = f"/api/v1/products/{header.id}"
    return {"id": header.id, "result": str(insertion)}


@router.post("/batch", response_model=InsertedAll, openapi_extra=allowed("robot", "operator"), status_code=201)
async def insert_all(context: Ctx, request: Request) -> dict[str, Any]:
    """Insert several products, all or none: a MessagePack list of ``{robot, dfpc, port, product, encoding,
    attachment, payload}``.
    """
    from starlette.concurrency import run_in_threadpool

    try:
        body = msgpack.unpackb(await request.body())
    except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        raise InputError(f"batch: expected MessagePack: {error!r}") from error
    stored = await run_in_threadpool(context.dpm.put_all, batch_of(body))
    return {"items": [{"id": header.id, "result": str(insertion)} for insertion, header in stored]}


@router.get("/{product_id}", response_model=Described, response_model_exclude_unset=True)
def metadata(context: Ctx, product_id: str, response: Response) -> dict[str, Any]:
    """Metadata of one product, the formats its payload can be had in, and what is said of it; ``ETag`` its revision."""
    record = context.dpm.store.get(product_id)
    annotation = context.dpm.store.annotations.get(product_id)
    response.headers["ETag"] = etag(annotation)
    response.headers["Cache-Control"] = "private, no-cache"
    said: dict[str, Any] = jsonable({"annotation": annotation.to_dict()})
    return described(record) | {"formats": list(formats_of(record.type_name))} | said


@router.get("/{product_id}/provenance", response_model=Provenance)
def provenance(
    context: Ctx, product_id: str, direction: Literal["up", "down"] = "up",
    depth: Annotated[int, Query(ge=1, le=MAX_GENERATIONS)] = MAX_GENERATIONS,
) -> dict[str, Any]:  # fmt: skip
    """What a product was made from (up), or what was made from it (down), through all generations."""
    data: dict[str, Any] = jsonable(context.dpm.provenance(product_id, direction, depth))
    return data


@router.delete("/{product_id}", response_model=Deleted, openapi_extra=allowed("operator"))
def delete(
    context: Ctx, product_id: str,
    if_match: Annotated[str | None, Header(max_length=40, description='ETag as "r3", or *')] = None,
) -> dict[str, Any]:  # fmt: skip
    """Delete a product; its id is not free again. With ``If-Match`` 412 where somebody changed it since."""
    revision = None if if_match is None else required_revision(if_match)
    try:
        return {"id": product_id, "deleted": context.dpm.delete(product_id, revision)}
    except StaleRevisionError as error:
        raise HTTPException(412, str(error)) from error


_BYTES: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {}, "*/*": {}}, "description": "The payload"},
    206: {"content": {"application/octet-stream": {}}, "description": "The part of it that Range asked for"},
    304: {"description": "The caller has it already"},
}
_PNG: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/png": {}}, "description": "A picture"},
    304: {"description": "The caller has it already"},
}
_FOR_EVER = "private, max-age=86400, immutable"


@router.get("/{product_id}/payload", response_class=Response, responses=_BYTES)
def payload(
    context: Ctx, product_id: str, request: Request,
    format: Annotated[str, Query(max_length=16)] = "native",
    as_: Annotated[str | None, Query(alias="as", max_length=64)] = None,
) -> Response:  # fmt: skip
    """The payload, as it is stored (``Range`` and ``If-Range`` allowed) or converted."""
    record = context.dpm.store.get(product_id)
    is_native = format == "native" and as_ is None
    etag = f'"{record.sha256}"' if is_native else f'"{record.sha256[:32]}-{converted_name(format, as_)}"'
    headers = {"ETag": etag, "Cache-Control": _FOR_EVER}
    if matches(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    if is_native:
        part = request.headers.get("range") if request.headers.get("if-range", etag) == etag else None
        return native(context, record, part, headers)
    wkt = context.dpm.crs_wkt(record.header.frame, format)
    data = context.dpm.store.payload(product_id)
    body = convert(record.type_name, record.codec, data, format, as_, record.header, wkt=wkt)
    return file_response(body, product_id, headers)


@router.get("/{product_id}/thumbnail.png", response_class=Response, responses=_PNG)
def thumbnail(context: Ctx, product_id: str, request: Request) -> Response:
    """A small picture of a map, cloud, path or image; products never change, so it may be cached."""
    record = context.dpm.store.get(product_id)
    etag = f'"{record.sha256[:32]}-thumbnail"'
    headers = {"ETag": etag, "Cache-Control": _FOR_EVER}
    if matches(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    from cdff_common.codecs import decode
    from services.dpm.pictures import picture

    if not record.size:
        raise InputError(f"product {record.id} was FAILED and has no picture")
    value = decode(record.type_name, context.dpm.store.payload(product_id), record.codec)
    return Response(picture(value, record.header, max_side_px=256), media_type="image/png", headers=headers)


def native(context: Context, record: ProductRecord, range_header: str | None, headers: dict[str, str]) -> Response:
    """The stored bytes, or the part that ``Range`` names."""
    body = convert(record.type_name, record.codec, b"", None, None, record.header)
    headers = headers | {"Accept-Ranges": "bytes", "CDFF-Encoding": body.encoding}
    part = parse_range(range_header, record.size)
    if part is None:
        return Response(context.dpm.store.payload(record.id), media_type="application/octet-stream", headers=headers)
    first, last = part
    headers["Content-Range"] = f"bytes {first}-{last}/{record.size}"
    data = context.dpm.store.payload(record.id, first, last - first + 1)
    return Response(data, 206, headers, "application/octet-stream")


def converted_name(format_name: str, as_type: str | None) -> str:
    """What a conversion is called in an ETag: callers' text, but only what a header may hold."""
    return re.sub(r"[^A-Za-z0-9_]", "-", f"{format_name}-{as_type or ''}")


def file_response(body: Converted, name: str, headers: Mapping[str, str] | None = None) -> Response:
    """Bytes as a file named after the product."""
    media_type = body.encoding if "vnd.cdff" not in body.encoding else "application/octet-stream"
    named = {"Content-Disposition": f'inline; filename="{name}.{body.suffix}"', "CDFF-Encoding": body.encoding}
    return Response(body.data, media_type=media_type, headers={**named, **(headers or {})})


def described(record: ProductRecord) -> dict[str, Any]:
    """Metadata as JSON, with links."""
    base = f"/api/v1/products/{record.id}"
    links = {"self": base, "payload": f"{base}/payload", "thumbnail": f"{base}/thumbnail.png"}
    data: dict[str, Any] = jsonable(record.to_dict())
    return data | {"links": links}


def etag(annotation: Annotation) -> str:
    """ETag of a product's metadata: the header never changes, the annotation by revisions."""
    return f'"r{annotation.revision}"'


def header_attachment(text: str) -> bytes:
    """The header's bytes from its JSON; times may be decimal strings. Raises InputError."""
    try:
        data = json.loads(text)
        if not isinstance(data, dict):
            raise InputError(f"CDFF-Header holds a {type(data).__name__}, expected an object")
        for name in ("t0_ns", "t1_ns"):
            data[name] = int(data[name])
        return bytes(msgpack.packb(data))
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise InputError(f"CDFF-Header: expected the product's header as JSON: {error!r}") from error
