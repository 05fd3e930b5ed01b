# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``POST /api/v1/meshes/{object}``: the mesh file of an object becomes a product in its frame."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response

from cdff_common.clock import parse_stamp
from cdff_common.codecs import encode, encoding_string
from cdff_common.contract.names import ROBOT_ID
from cdff_common.contract.queries import SearchParameters
from cdff_common.errors import InputError
from cdff_common.formats.file_source import Source
from cdff_common.formats.meshes import UNITS, read_mesh
from cdff_common.interfaces.product import Header, Quality, product_id
from cdff_common.types import Mesh
from dpm_store import Insertion
from services.dpm.http.context import Context, Ctx, root_path
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.native_models import StoredMesh

router = APIRouter(prefix="/api/v1/meshes", tags=["products"])

#: DFPC and port under which uploaded meshes are stored.
_DFPC, _PORT = "upload", "mesh"


@router.post(
    "/{object}", response_model=StoredMesh, status_code=201, openapi_extra=allowed("robot", "operator")
)
async def insert(
    context: Ctx,
    request: Request,
    response: Response,
    object: Annotated[str, Path(pattern=rf"^{ROBOT_ID}$", description="Name of the object")],
    unit: Annotated[Literal["m", "mm", "cm", "km"], Query(description="Unit of the vertices")],
    sha256: Annotated[
        str | None, Query(pattern="^[0-9a-fA-F]{64}$", description="Expected SHA-256 of the file")
    ] = None,
    symmetries: Annotated[
        int | None, Query(ge=1, le=1000, description="Number of poses in which the object looks the same")
    ] = None,
    t: Annotated[
        str | None, Query(description="Time of validity: nanoseconds or RFC 3339; default: now")
    ] = None,
) -> dict[str, Any]:
    """Insert a mesh file (OBJ, PLY, STL, GLB or VRML) as the mesh of an object, whose frame is
    ``{object}/body``.

    A file that is already the newest mesh of the object is not stored again. ``symmetries`` is compared with
    the symmetries that a detector determines from the mesh.
    """
    from starlette.concurrency import run_in_threadpool

    data = await request.body()
    stamp_ns = None if t is None else parse_stamp(t, "t")
    insertion, answer = await run_in_threadpool(
        _insert, context, data, object, unit, sha256, symmetries, stamp_ns
    )
    response.status_code = 201 if insertion is Insertion.INSERTED else 200
    response.headers["Location"] = f"{root_path(request)}/api/v1/products/{answer['id']}"
    return answer


def _insert(
    context: Context,
    data: bytes,
    name: str,
    unit: str,
    expected: str | None,
    symmetries: int | None,
    stamp_ns: int | None,
) -> tuple[Insertion, dict[str, Any]]:
    """Store a mesh file; raises InputError for a wrong checksum, CodecError for a damaged file."""
    digest = hashlib.sha256(data).hexdigest()
    if expected is not None and expected.lower() != digest:
        raise InputError(
            f"sha256={expected}: the body of {len(data)} bytes has {digest}; upload the file again"
        )
    arrays = read_mesh(Source(data, f"mesh of {name}")).scaled(UNITS[unit])
    metrics = {"unit_m": UNITS[unit]} | ({} if symmetries is None else {"symmetries": float(symmetries)})
    config_hash = hashlib.sha256(f"{digest} {unit} {symmetries}".encode()).hexdigest()[:16]
    answer = {
        "frame": f"{name}/body",
        "unit": unit,
        "vertices": len(arrays.vertices),
        "triangles": len(arrays.triangles),
        "extent_m": np.ptp(arrays.vertices[arrays.triangles].reshape(-1, 3), axis=0).round(6).tolist(),
        "symmetries": symmetries,
        "sha256": digest,
    }
    newest = context.dpm.retrieval.search(
        SearchParameters.parse({"type": "mesh", "robot": name, "limit": 1})
    ).items
    if newest and newest[0].header.config_hash == config_hash:
        return Insertion.ALREADY, {"id": newest[0].id, "result": str(Insertion.ALREADY), **answer}
    now_ns = context.dpm.store.clock.now_ns() // 1000 * 1000
    t_ns = now_ns if stamp_ns is None else stamp_ns
    mesh = Mesh.from_arrays(arrays.vertices, arrays.triangles, frame=f"{name}/body", stamp_ns=t_ns)
    header = Header(
        product_id(name, _DFPC, _PORT, t_ns, 0, config_hash),
        0,
        t_ns,
        t_ns,
        mesh.frame,
        f"{_DFPC}/file",
        config_hash=config_hash,
        quality=Quality(metrics=metrics),
        box_m=mesh.extent_m(),
    )
    names = {"robot": name, "dfpc": _DFPC, "port": _PORT, "product": "mesh"}
    insertion, _ = context.dpm.writer.put(
        names, encode(mesh, "uper"), encoding_string("Mesh", "uper"), header.to_attachment()
    )
    return insertion, {"id": header.id, "result": str(insertion), **answer}
