# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Silhouettes of boxes, cylinders and spheres of a URDF."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.geometry.urdf_shapes import read_shapes
from cdff_core.imaging.shape_projection import silhouettes

CAMERA = np.array([[200.0, 0.0, 100.0], [0.0, 200.0, 80.0], [0.0, 0.0, 1.0]])
SHAPE = (160, 200)
FORWARD = np.array([0.0, 0.0, 2.0])


def urdf(geometry: str, origin: str = "") -> str:
    collision = f"<collision>{origin}<geometry>{geometry}</geometry></collision>"
    return f'<robot name="r"><link name="base">{collision}</link></robot>'


def test_a_box_covers_the_pixels_of_its_front_face() -> None:
    (box,) = read_shapes(urdf('<box size="1 0.5 0.2"/>'))
    covered = silhouettes([box.points_m + FORWARD], CAMERA, SHAPE)
    rows, columns = np.nonzero(covered)
    front_m = 1.9
    assert columns.min() == pytest.approx(100 - 200 * 0.5 / front_m, abs=1.0)
    assert rows.max() == pytest.approx(80 + 200 * 0.25 / front_m, abs=1.0)
    assert covered.sum() == pytest.approx((200 / front_m) * (100 / front_m), rel=0.05)


@pytest.mark.parametrize("geometry", ['<sphere radius="0.3"/>', '<cylinder radius="0.3" length="0.001"/>'])
def test_a_round_shape_covers_at_least_its_circle_and_little_more(geometry: str) -> None:
    (shape,) = read_shapes(urdf(geometry))
    covered = silhouettes([shape.points_m + FORWARD], CAMERA, SHAPE)
    distance_m = np.sqrt(2.0**2 - 0.3**2) if "sphere" in geometry else 2.0
    radius_px = 200 * 0.3 / distance_m
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    assert covered[np.hypot(u - 100, v - 80) < radius_px - 0.5].all()
    assert not covered[np.hypot(u - 100, v - 80) > 1.06 * radius_px + 1.0].any()


def test_a_shape_that_reaches_behind_the_camera_is_cut() -> None:
    (deck,) = read_shapes(urdf('<box size="2 0.1 4"/>', '<origin xyz="0 0.5 0"/>'))
    covered = silhouettes([deck.points_m], CAMERA, SHAPE)
    assert not covered[:120].any()
    assert covered[-1].all()
    assert not silhouettes([deck.points_m - [0.0, 0.0, 9.0]], CAMERA, SHAPE).any()


def test_meshes_and_documents_without_shapes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="mesh"):
        read_shapes(urdf('<mesh filename="arm.stl"/>'))
    with pytest.raises(ConfigurationError, match="no link"):
        read_shapes('<robot name="r"><link name="base"/></robot>')
    with pytest.raises(ConfigurationError, match="3 finite numbers"):
        read_shapes(urdf('<box size="1 2"/>'))
