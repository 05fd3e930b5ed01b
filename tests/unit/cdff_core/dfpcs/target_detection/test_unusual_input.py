# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Meshes with holes, of a million triangles and reversed, and images that show no usable body."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import Frame
from tests.support import satellite
from tests.unit.cdff_core.dfpcs.target_detection.test_compound import (
    NEAR,
    detect,
    errors,
    make_dfpc,
    model,
)

T = se3.transform(se3.exp_so3([0.4, -0.8, 0.3]), [0.2, -0.1, 8.0])
CAMERA = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])


def with_holes(mesh: satellite.Mesh) -> satellite.Mesh:
    """Return the mesh without a tenth of the triangles of its finely divided surface."""
    vertices, triangles = divided(mesh, 4)
    return vertices, triangles[np.random.default_rng(2).random(len(triangles)) > 0.1]


def divided(mesh: satellite.Mesh, times: int) -> satellite.Mesh:
    """Return the mesh with each triangle divided into four, a number of times."""
    corners = mesh[0][mesh[1]]
    for _ in range(times):
        a, b, c = (corners[:, i] for i in range(3))
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["holes", "million"])
def test_a_mesh_with_holes_or_a_million_triangles_serves_as_the_model(kind: str) -> None:
    mesh = satellite.satellite()
    times = int(np.ceil(np.log(1e6 / len(mesh[1])) / np.log(4.0)))
    unusual = with_holes(mesh) if kind == "holes" else divided(mesh, times)
    assert kind == "holes" or len(unusual[1]) >= 1_000_000
    dfpc = make_dfpc()
    assert list(dfpc.step(model(unusual))) == []
    output = detect(dfpc, satellite.scan(mesh, T, rng=np.random.default_rng(1), **NEAR))
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    (detection,) = output.value.detections
    angle_deg, distance_m = errors(detection, T)
    assert angle_deg < 1.0
    assert distance_m < 0.02


@pytest.mark.parametrize(
    ("grey", "reason"), [(255, "bright_background"), (120, "bright_background"), (0, "no_light:0px")]
)
def test_a_uniform_image_is_refused_with_the_reason(grey: int, reason: str) -> None:
    dfpc = make_dfpc()
    dfpc.step(model(satellite.satellite()))
    image = Frame.from_image(
        np.full((240, 320), grey, np.uint8), stamp_ns=1000, camera_matrix=CAMERA, sensor="servicer/camera"
    )
    (output,) = dfpc.step(Sample("image", 1000, 0, image, id="i"))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == (reason,)
