# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rays hit the parts of the rover and moving objects at the right place and time."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_dev.simulate.faults.solids import BodyPart, MovingObject, body_solids, cast, object_solids
from cdff_dev.simulate.fields import Mount


class Flat:
    """Ground at a height of 2 m."""

    def height(self, xy_m: np.ndarray) -> np.ndarray:
        return np.full(len(xy_m), 2.0)


def test_a_ray_hits_the_nearest_face_of_a_rotated_box() -> None:
    part = BodyPart(size_m=(2.0, 1.0, 1.0), mount=Mount(xyz_m=(5.0, 0.0, 0.0), rpy_deg=(0.0, 0.0, 90.0)))
    solids = body_solids([part], np.eye(4)[None], np.zeros(1))
    origins = np.zeros((1, 1, 3))
    directions = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]])
    hits = cast(solids, origins, directions)
    assert hits.t[0, 0] == pytest.approx(4.5)
    assert np.all(np.isinf(hits.t[0, 1:]))
    np.testing.assert_allclose(hits.normals[0, 0], [-1, 0, 0], atol=1e-12)
    assert hits.on_rover[0, 0]


def test_the_nearer_of_two_boxes_is_seen_whatever_their_order() -> None:
    parts = [
        BodyPart(size_m=(1.0, 1.0, 1.0), mount=Mount(xyz_m=(x, 0.0, 0.0)), albedo=albedo, contrast=0.0)
        for x, albedo in ((6.0, 0.5), (3.0, 1.0))
    ]
    for order in (parts, parts[::-1]):
        solids = body_solids(order, np.eye(4)[None], np.zeros(1))
        hits = cast(solids, np.zeros((1, 1, 3)), np.array([[[2.0, 0.0, 0.0]]]))
        assert (hits.t[0, 0], hits.albedo[0, 0]) == (pytest.approx(1.25), 1.0)


def test_an_arm_swings_about_its_pivot() -> None:
    part = BodyPart(
        size_m=(1.0, 0.1, 0.1),
        mount=Mount(xyz_m=(1.5, 0.0, 0.0)),
        swing_deg=90.0,
        swing_period_s=4.0,
        pivot_m=(1.0, 0.0, 0.0),
    )
    (arm,) = body_solids([part], np.tile(np.eye(4), (3, 1, 1)), np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(arm.poses[:, :3, 3], [[1.5, 0, 0], [1, 0.5, 0], [1.5, 0, 0]], atol=1e-9)


def test_an_object_waits_then_moves_over_the_ground_with_its_velocity() -> None:
    moving_object = MovingObject(
        size_m=(1.0, 1.0, 2.0), start_xy_m=(1.0, 0.0), velocity_m_s=(0.0, 0.5), start_s=2.0
    )
    (solid,) = object_solids([moving_object], Flat(), np.array([0.0, 2.0, 6.0]))
    np.testing.assert_allclose(solid.poses[:, :3, 3], [[1, 0, 3], [1, 0, 3], [1, 2, 3]])
    np.testing.assert_allclose(solid.velocity_m_s, [[0, 0, 0], [0, 0.5, 0], [0, 0.5, 0]])
    assert se3.is_transform(solid.poses[2])
