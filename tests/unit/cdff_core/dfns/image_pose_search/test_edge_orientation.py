# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EdgeOrientation: a lit satellite in one image, and images whose background cannot be separated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.image_pose_search.interface import Inputs, Outputs
from cdff_core.object_models.rendering import NO_FACE, Window, camera_normals, render
from tests.support import satellite

CAMERA = Window(700.0, 700.0, 159.5, 119.5, 240, 320)
SUN = np.array([-0.4, -0.5, -0.77])
#: Pose of the satellite: 9 m away, off the axis.
R = se3.exp_so3([0.5, -0.8, 0.4])
T = se3.transform(R, [0.3, -0.2, 12.0])


def photograph(T_camera_body: np.ndarray = T) -> np.ndarray:
    """Return an image of the satellite in the light of the Sun, with noise."""
    vertices, triangles = satellite.satellite()
    face = render(vertices, triangles, T_camera_body, CAMERA).face
    normals = camera_normals(vertices, triangles, T_camera_body, face)
    lit = np.where(face != NO_FACE, 30.0 + 170.0 * np.maximum(np.nan_to_num(normals) @ SUN, 0.0), 0.0)
    noise = np.random.default_rng(4).normal(0.0, 2.0, lit.shape)
    return np.clip(8.0 + lit + noise, 0, 255).astype(np.uint8)


def search(image: np.ndarray, **config: Any) -> Outputs:
    dfn = Registry.default().make_dfn("image_pose_search")
    dfn.configure({"views": 60, "rolls": 18, "candidates": 12, **config})
    vertices, triangles = satellite.satellite()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    outputs: Outputs = dfn.process(
        Inputs(
            image=image,
            camera_matrix=np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]]),
            vertices=vertices,
            triangles=triangles,
            centre_m=0.5 * (low + high),
            diameter_m=float(np.ptp(vertices, axis=0).max()),
        )
    )
    return outputs


@pytest.mark.slow
def test_a_lit_satellite_is_found_in_one_image() -> None:
    outputs = search(photograph())
    errors_deg = [np.degrees(se3.rotation_angle(pose[:3, :3].T @ R)) for pose in outputs.poses]
    assert min(errors_deg) < 8.0
    best = outputs.poses[int(np.argmin(errors_deg))]
    np.testing.assert_allclose(best[:2, 3] / best[2, 3], T[:2, 3] / T[2, 3], atol=0.01)
    assert best[2, 3] == pytest.approx(T[2, 3], rel=0.1)
    assert list(outputs.scores) == sorted(outputs.scores, reverse=True)
    assert outputs.agreements[0, 1] > 0.9


def test_an_image_without_light_is_refused() -> None:
    with pytest.raises(RefusedError) as refused:
        search(np.full((240, 320), 8, np.uint8), views=20, rolls=4)
    assert refused.value.reasons[0].startswith("no_light:")


@pytest.mark.parametrize("bright", ["border", "everywhere"])
def test_a_bright_background_is_refused(bright: str) -> None:
    image = photograph()
    if bright == "border":
        image[:, 200:] = 160
        image[100:] = 160
    else:
        image = np.random.default_rng(0).integers(0, 255, image.shape).astype(np.uint8)
    with pytest.raises(RefusedError) as refused:
        search(image, views=20, rolls=4)
    assert refused.value.reasons[0].startswith("bright_background")


def test_a_tiny_image_is_refused() -> None:
    with pytest.raises(InputError, match="at least 32 x 32"):
        search(np.zeros((16, 16), np.uint8), views=20, rolls=4)
