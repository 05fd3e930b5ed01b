# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Upload of meshes by HTTP: unit, checksum, stated symmetries, repeated and damaged files."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from fastapi.testclient import TestClient

from cdff_common.codecs import decode
from services.dpm.operations.dpm import Dpm

OBJ = b"v 0 0 0\nv 100 0 0\nv 0 200 0\nv 0 0 300\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_a_mesh_file_becomes_a_product_in_the_frame_of_its_object(http: TestClient, dpm: Dpm) -> None:
    digest = hashlib.sha256(OBJ).hexdigest()
    answer = http.post(f"/api/v1/meshes/client?unit=mm&symmetries=2&sha256={digest.upper()}", content=OBJ)
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert answer.headers["Location"] == f"/api/v1/products/{body['id']}"
    assert (body["frame"], body["unit"], body["sha256"]) == ("client/body", "mm", digest)
    assert (body["vertices"], body["triangles"], body["extent_m"]) == (4, 4, [0.1, 0.2, 0.3])
    record = dpm.store.get(body["id"])
    assert (record.robot, record.product, record.header.frame) == ("client", "mesh", "client/body")
    assert record.header.quality.metrics == {"unit_m": 0.001, "symmetries": 2.0}
    mesh = decode("Mesh", dpm.store.payload(record.id), "uper")
    np.testing.assert_allclose(np.ptp(np.asarray(mesh.data.vertices), axis=0), [0.1, 0.2, 0.3], rtol=1e-6)


def test_the_newest_mesh_is_not_stored_twice(http: TestClient) -> None:
    first = http.post("/api/v1/meshes/client?unit=m&t=1000000", content=OBJ)
    same = http.post("/api/v1/meshes/client?unit=m", content=OBJ)
    other = http.post("/api/v1/meshes/client?unit=mm", content=OBJ)
    assert [answer.status_code for answer in (first, same, other)] == [201, 200, 201]
    assert first.json()["id"] == same.json()["id"] != other.json()["id"]


@pytest.mark.parametrize(
    ("query", "content", "text"),
    [
        ("unit=m&sha256=" + "0" * 64, OBJ, "upload the file again"),
        ("unit=m", b"not a mesh", "not recognised as a mesh"),
        ("unit=m", b"", "not recognised as a mesh"),
        ("unit=m", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"),
        ("unit=furlong", OBJ, "unit"),
        ("", OBJ, "unit"),
        ("unit=m&symmetries=0", OBJ, "symmetries"),
    ],
)
def test_wrong_uploads_are_refused(http: TestClient, query: str, content: bytes, text: str) -> None:
    answer = http.post(f"/api/v1/meshes/client?{query}", content=content)
    assert answer.status_code in (400, 422), answer.text
    assert text in answer.text
    assert http.get("/api/v1/products?type=mesh").json()["items"] == []
