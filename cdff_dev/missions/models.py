# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Upload of the meshes of objects to the DPM before a demonstration."""

from __future__ import annotations

import hashlib
import json
import urllib.request
from typing import Any

from cdff_common.formats.payload import to_file
from cdff_common.types import Mesh
from cdff_dev.simulate.orbit.meshes import BUILT_IN, load_body

#: Timeout of an upload, seconds, and plausible sizes of the objects, metres.
_UPLOAD_S, _SIZE_M = 30.0, (0.01, 1e5)


def upload_model(http: str, name: str, mesh: str) -> dict[str, Any]:
    """Upload the mesh of an object by HTTP and return the answer of the DPM.

    Parameters
    ----------
    http : str
        ``host:port`` of the DPM.
    name : str
        Name of the object.
    mesh : str
        Built-in model of the simulator, or a mesh file in metres.

    Raises
    ------
    OSError
        If the DPM does not accept it.
    """
    body = load_body(
        mesh,
        unit="m",
        material="paint_white" if mesh not in BUILT_IN else "metal",
        size_m=_SIZE_M,
        field=name,
    )
    data = to_file(Mesh.from_arrays(body.vertices_m, body.triangles, frame=f"{name}/body", stamp_ns=0), "ply")
    digest = hashlib.sha256(data).hexdigest()
    request = urllib.request.Request(
        f"http://{http}/api/v1/meshes/{name}?unit=m&sha256={digest}&t=0", data=data, method="POST"
    )
    with urllib.request.urlopen(request, timeout=_UPLOAD_S) as response:
        answer: dict[str, Any] = json.load(response)
        return answer
