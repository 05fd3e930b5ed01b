# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LitBodyRendering: light, cast shadows, grey levels, bodies out of view, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.lit_body_rendering.interface import LitBodyRenderingInputs, LitBodyRenderingOutputs
from cdff_core.dfns.lit_body_rendering.lommel_seeliger import LommelSeeliger
from tests.support import satellite
from tests.support.satellite_images import CAMERA_MATRIX, image_of

BOX = satellite.box((1.0, 0.8, 0.6))
T_BOX = se3.transform(se3.exp_so3([0.4, 0.5, 0.1]), [0.0, 0.0, 4.0])
SUN = np.array([0.4, -0.5, -0.77])


def rendered(image: np.ndarray, **changes: Any) -> LitBodyRenderingOutputs:
    node = LommelSeeliger()
    node.configure()
    ports = {
        "camera_matrix": CAMERA_MATRIX,
        "pose": T_BOX,
        "sun": SUN,
        "vertices": BOX[0],
        "triangles": BOX[1],
    }
    return node.process(LitBodyRenderingInputs(image=image, **ports | changes))


def test_the_rendering_has_the_light_and_the_levels_of_the_image(rng: np.random.Generator) -> None:
    image = image_of(BOX, T_BOX, rng)
    outputs = rendered(image)
    is_body = np.isfinite(outputs.depth)
    assert outputs.correlation > 0.8
    assert abs(float(outputs.rendering[is_body].max()) - float(image[is_body].max())) < 40.0
    assert (outputs.rendering[~is_body] < 40).mean() > 0.97
    assert outputs.depth[is_body].min() > 3.0


def test_a_body_with_the_sun_behind_it_is_dark(rng: np.random.Generator) -> None:
    outputs = rendered(image_of(BOX, T_BOX, rng), sun=np.array([0.0, 0.0, 1.0]))
    assert outputs.lit_pixels == 0
    assert not outputs.rendering.any()


def test_a_part_casts_its_shadow_on_another(rng: np.random.Generator) -> None:
    facing = se3.transform(np.eye(3), [0.0, 0.0, 6.0])
    plate = satellite.box((2.0, 2.0, 0.1))
    screen = satellite.box((0.05, 2.0, 1.0), (0.0, 0.0, -0.55))
    both = satellite.merged(plate, screen)
    sun = np.array([1.0, 0.0, -1.0])
    ports = {"pose": facing, "sun": sun, "vertices": both[0], "triangles": both[1]}
    outputs = rendered(image_of(both, facing, rng), **ports)
    row, middle = 120, 160
    assert outputs.rendering[row, middle + 40] > 2 * outputs.rendering[row, middle - 25]


def test_a_body_out_of_view_has_no_pixels(rng: np.random.Generator) -> None:
    behind = se3.transform(np.eye(3), [0.0, 0.0, -4.0])
    outputs = rendered(image_of(BOX, T_BOX, rng), pose=behind)
    assert outputs.lit_pixels == 0
    assert np.isnan(outputs.correlation)


def test_no_direction_and_no_mesh_are_refused(rng: np.random.Generator) -> None:
    image = image_of(BOX, T_BOX, rng)
    with pytest.raises(InputError, match="direction is zero"):
        rendered(image, sun=np.zeros(3))
    with pytest.raises(InputError, match="no triangle"):
        rendered(image, triangles=np.zeros((0, 3), np.int64))
