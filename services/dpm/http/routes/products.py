# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/products``: search, metadata, payloads in any format, insertion, deletion."""

from __future__ import annotations

import json
from typing import Annotated, Any
from urllib.parse import urlencode

import msgpack
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from cdff_common.contract.names import KEY_NAME, ROBOT_ID
from cdff_common.contract.queries import ProvenanceParameters, SearchParameters
from cdff_common.errors import InputError
from dpm_store import Annotation, Insertion, ProductRecord, StaleRevisionError
from services.dpm.http.bodies import body_response, stored_response
from services.dpm.http.context import Context, Ctx, jsonable, root_path
from services.dpm.http.converted_files import converted_name, converted_response
from services.dpm.http.middleware.conditional import matches, required_revision
from services.dpm.http.middleware.ranges import parse_range
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import (
    AnnotatedProduct,
    Deleted,
    Inserted,
    Items,
    ProductPage,
    Provenance,
)
from services.dpm.operations.retrieval import CONVERSION_COPIES
from services.dpm.queries.bodies import parse_batch
from services.dpm.rendering.convert import Converted, convert, formats_of

router = APIRouter(prefix="/api/v1/products", tags=["products"])

Robot = Annotated[str, Query(pattern=rf"^{ROBOT_ID}$")]
Name = Annotated[str, Query(pattern=rf"^{KEY_NAME}$")]


@router.get("", response_model=ProductPage)
def search(
    context: Ctx, request: Request, search_parameters: Annotated[SearchParameters, Query()]
) -> Response:
    """Search metadata; ``links.next`` is the next page."""
    parameters = search_parameters.to_parameters()
    page = context.dpm.retrieval.search(search_parameters)
    root = root_path(request)
    links = {"self": f"{root}/api/v1/products?{urlencode(parameters)}"}
    if page.cursor is not None:
        links["next"] = f"{root}/api/v1/products?{urlencode(parameters | {'cursor': page.cursor})}"
    items = [described(record, root) for record in page.items]
    # Without the response model: its validation of 1000 products takes longer than the search.
    return JSONResponse({"items": items, "links": links, **jsonable(page.to_dict())})


@router.post("", response_model=Inserted, status_code=201, openapi_extra=allowed("robot", "operator"))
async def insert(
    context: Ctx,
    request: Request,
    response: Response,
    robot: Robot,
    dfpc: Name,
    port: Name,
    product: Name,
    cdff_header: Annotated[str, Header(description="The product's header, as JSON")],
) -> dict[str, Any]:
    """Insert a payload: its encoding string as ``Content-Type``, its header as JSON in ``CDFF-Header``."""
    from starlette.concurrency import run_in_threadpool

    payload = await request.body()
    attachment = header_attachment(cdff_header)
    names = {"robot": robot, "dfpc": dfpc, "port": port, "product": product}
    encoding = request.headers.get("content-type", "")
    insertion, header = await run_in_threadpool(context.dpm.writer.put, names, payload, encoding, attachment)
    response.status_code = 201 if insertion is Insertion.INSERTED else 200
    response.headers["Location"] = f"{root_path(request)}/api/v1/products/{header.id}"
    return {"id": header.id, "result": str(insertion)}


@router.post(
    "/batch", response_model=Items[Inserted], openapi_extra=allowed("robot", "operator"), status_code=201
)
async def insert_all(context: Ctx, request: Request) -> dict[str, Any]:
    """Insert several products, all or none: a MessagePack list of ``{robot, dfpc, port, product, encoding,
    attachment, payload}``.
    """
    from starlette.concurrency import run_in_threadpool

    try:
        body = msgpack.unpackb(await request.body())
    except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        raise InputError(f"batch: expected MessagePack: {error!r}") from error
    stored = await run_in_threadpool(context.dpm.writer.put_all, parse_batch(body))
    return {"items": [{"id": header.id, "result": str(insertion)} for insertion, header in stored]}


@router.get("/{product_id}", response_model=AnnotatedProduct, response_model_exclude_unset=True)
def metadata(context: Ctx, request: Request, product_id: str, response: Response) -> dict[str, Any]:
    """Return the metadata of one product, its formats and its annotation; ``ETag`` is its revision."""
    record = context.dpm.store.get(product_id)
    annotation = context.dpm.store.annotations.get(product_id)
    response.headers["ETag"] = etag(annotation)
    response.headers["Cache-Control"] = "private, no-cache"
    formats = list(formats_of(record.type_name))
    return described(record, root_path(request)) | {
        "formats": formats,
        "annotation": jsonable(annotation.to_dict()),
    }


@router.get("/{product_id}/provenance", response_model=Provenance)
def provenance(context: Ctx, product_id: str, parameters: Annotated[ProvenanceParameters, Query()]) -> Any:
    """Return the inputs of a product (up), or its results (down), through all generations."""
    return jsonable(context.dpm.reports.provenance(product_id, parameters.direction, parameters.depth))


@router.delete("/{product_id}", response_model=Deleted, openapi_extra=allowed("operator"))
def delete(
    context: Ctx,
    product_id: str,
    if_match: Annotated[str | None, Header(max_length=40, description='ETag as "r3", or *')] = None,
) -> dict[str, Any]:
    """Delete a product; its id is not reused. With ``If-Match``, the answer is 412 if it has another revision."""
    revision = None if if_match is None else required_revision(if_match)
    try:
        return {"id": product_id, "deleted": context.dpm.writer.delete(product_id, revision)}
    except StaleRevisionError as error:
        raise HTTPException(412, str(error)) from error


_BYTES: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {}, "*/*": {}}, "description": "The payload"},
    206: {"content": {"application/octet-stream": {}}, "description": "The requested range"},
    304: {"description": "Not modified"},
}
_PNG: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/png": {}}, "description": "A picture"},
    304: {"description": "Not modified"},
}
_FOR_EVER = "private, max-age=86400, immutable"


@router.get("/{product_id}/payload", response_class=Response, responses=_BYTES)
def payload(
    context: Ctx,
    product_id: str,
    request: Request,
    format: Annotated[str, Query(max_length=16)] = "native",
    as_: Annotated[str | None, Query(alias="as", max_length=64)] = None,
) -> Response:
    """Return the payload, as it is stored (``Range`` and ``If-Range`` allowed) or converted."""
    record = context.dpm.store.get(product_id)
    is_native = format == "native" and as_ is None
    place = context.dpm.retrieval.georeference(record.header.frame, format)
    etag = f'"{record.sha256}"' if is_native else f'"{converted_name(record, format, as_, place)}"'
    # A new anchor of the frame changes the CRS in such a file: clients must ask again.
    headers = {"ETag": etag, "Cache-Control": _FOR_EVER if place is None else "private, no-cache"}
    if matches(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    part = request.headers.get("range") if request.headers.get("if-range", etag) == etag else None
    if is_native:
        return native(context, record, part, headers)

    def converted() -> Converted:
        context.dpm.budget.charge(CONVERSION_COPIES * record.decoded_bytes)
        stored = context.dpm.store.payload
        return convert(
            record.type_name, record.codec, stored(product_id), format, as_, record.header, place=place
        )

    return converted_response(context, etag, converted, product_id, part, headers)


@router.get("/{product_id}/thumbnail.png", response_class=Response, responses=_PNG)
def thumbnail(context: Ctx, product_id: str, request: Request) -> Response:
    """Return a small picture of a map, cloud, path or image; it may be cached for ever."""
    record = context.dpm.store.get(product_id)
    etag = f'"{record.sha256[:32]}-thumbnail"'
    headers = {"ETag": etag, "Cache-Control": _FOR_EVER}
    if matches(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    from cdff_common.codecs import decode
    from services.dpm.rendering.pictures import picture

    if not record.size:
        raise InputError(f"product {record.id} was FAILED and has no picture")
    context.dpm.budget.charge(CONVERSION_COPIES * record.decoded_bytes)
    value = decode(record.type_name, context.dpm.store.payload(product_id), record.codec)
    data = picture(value, record.header, max_side_px=256)
    return body_response(context, data, "image/png", headers)


def native(
    context: Context, record: ProductRecord, range_header: str | None, headers: dict[str, str]
) -> Response:
    """Return the stored bytes, or the part in ``Range``."""
    body = convert(record.type_name, record.codec, b"", None, None, record.header)
    headers = headers | {"Accept-Ranges": "bytes", "CDFF-Encoding": body.encoding}
    part = parse_range(range_header, record.size)
    if part is None:
        return stored_response(context, record, 0, record.size, 200, headers)
    first, last = part
    headers["Content-Range"] = f"bytes {first}-{last}/{record.size}"
    return stored_response(context, record, first, last - first + 1, 206, headers)


def described(record: ProductRecord, root: str) -> dict[str, Any]:
    """Return metadata as JSON data with links below the path of the server."""
    base = f"{root}/api/v1/products/{record.id}"
    links = {"self": base, "payload": f"{base}/payload", "thumbnail": f"{base}/thumbnail.png"}
    return {**jsonable(record.to_dict()), "links": links}


def etag(annotation: Annotation) -> str:
    """Return the ETag of a product's metadata: its annotation revision, since the header never changes."""
    return f'"r{annotation.revision}"'


def header_attachment(text: str) -> bytes:
    """Return the attachment of a header in JSON, with times also as decimal strings; raises InputError."""
    try:
        data = json.loads(text)
        if not isinstance(data, dict):
            raise InputError(f"CDFF-Header holds a {type(data).__name__}, expected an object")
        for name in ("t0_ns", "t1_ns"):
            data[name] = int(data[name])
        return bytes(msgpack.packb(data))
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise InputError(f"CDFF-Header: expected the product's header as JSON: {error!r}") from error
