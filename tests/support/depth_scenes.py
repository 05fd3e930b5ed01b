# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images of bodies on a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cdff_common.geometry import se3
from cdff_common.types import DistanceImage, Time
from cdff_core.object_models.rendering import Window, render
from tests.support.satellite import Mesh
from tests.support.satellite_images import CAMERA_MATRIX, COLUMNS, ROWS

#: Angle by which the camera looks down at the table, rad, and its height, metres.
_TILT_RAD, _HEIGHT_M = 0.6, 0.7
#: Pose of the table in the frame of the camera: z up, the origin where the optical axis meets it.
T_CAMERA_TABLE = se3.transform(
    np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, -np.sin(_TILT_RAD), -np.cos(_TILT_RAD)],
            [0.0, np.cos(_TILT_RAD), -np.sin(_TILT_RAD)],
        ]
    ),
    np.array([0.0, 0.0, _HEIGHT_M / np.sin(_TILT_RAD)]),
)


def depth_image(
    bodies: Sequence[tuple[Mesh, np.ndarray]],
    rng: np.random.Generator,
    *,
    stamp_ns: int = 0,
    sigma_m: float = 0.001,
    with_table: bool = True,
) -> DistanceImage:
    """Return the depth image of bodies at poses T_camera_body (4, 4), on a table of 2 m by 2 m."""
    K = CAMERA_MATRIX
    window = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], ROWS, COLUMNS)
    depth_m = np.full((ROWS, COLUMNS), np.inf)
    visible_bodies = list(bodies)
    if with_table:
        corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
        visible_bodies.append(((corners, np.array([[0, 1, 2], [0, 2, 3]])), T_CAMERA_TABLE))
    for (vertices, triangles), T in visible_bodies:
        depth_m = np.minimum(depth_m, render(vertices, triangles, T, window).depth_m)
    noisy_m = depth_m + rng.normal(0.0, sigma_m, depth_m.shape)
    return DistanceImage(
        ref_time=Time.from_ns(stamp_ns),
        width=COLUMNS,
        height=ROWS,
        scale_x=1.0 / K[0, 0],
        scale_y=1.0 / K[1, 1],
        center_x=-K[0, 2] / K[0, 0],
        center_y=-K[1, 2] / K[1, 1],
        data=np.where(np.isfinite(depth_m), noisy_m, 0.0).ravel(),
    )
