# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a depth image: objects without the table, their sizes, and the area of a silhouette."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.imaging.depth_images import depth_of
from cdff_core.object_models.rendering import Window, render, silhouette_pixels
from cdff_core.object_models.scene_parts import scene_parts
from tests.support import satellite
from tests.support.depth_scenes import T_CAMERA_TABLE, depth_image
from tests.support.satellite_images import CAMERA_MATRIX

BLOCK = satellite.box((0.16, 0.10, 0.08), (0.0, 0.0, 0.04))
DIAMETER_M = 0.2


def on_table(x_m: float) -> np.ndarray:
    return T_CAMERA_TABLE @ se3.transform(np.eye(3), np.array([x_m, 0.0, 0.0]))


def points(bodies: list[tuple[satellite.Mesh, np.ndarray]], rng: np.random.Generator) -> np.ndarray:
    """Return the points (240, 320, 3) of a depth image."""
    z, K = depth_of(depth_image(bodies, rng), 0.0, np.inf)
    v, u = np.mgrid[:240, :320]
    return np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=-1)


def test_two_blocks_on_a_table_are_two_parts(rng: np.random.Generator) -> None:
    grid_m = points([(BLOCK, on_table(-0.15)), (BLOCK, on_table(0.15))], rng)
    parts, on_planes = scene_parts(grid_m, DIAMETER_M, 80)
    assert len(parts) == 2
    columns = sorted(float(np.mean(rows % 320)) for rows in parts)
    assert columns[0] < 160.0 < columns[1]
    assert np.mean(on_planes) > 0.5
    assert not on_planes.ravel()[np.concatenate(parts)].any()


def test_parts_of_another_size_are_left_out(rng: np.random.Generator) -> None:
    grid_m = points([(BLOCK, on_table(0.0))], rng)
    assert scene_parts(grid_m, 0.02, 80).parts == []
    assert scene_parts(grid_m, DIAMETER_M, 100_000).parts == []


def test_an_image_without_measurements_has_no_part() -> None:
    assert scene_parts(np.full((48, 64, 3), np.nan), DIAMETER_M, 10).parts == []


def test_the_area_of_a_small_rendering_is_that_of_the_image() -> None:
    K, T = CAMERA_MATRIX, on_table(0.0)
    camera = Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], 240, 320)
    exact = np.count_nonzero(np.isfinite(render(*BLOCK, T, camera).depth_m))
    assert abs(silhouette_pixels(*BLOCK, T, camera, 32) - exact) < 0.1 * exact
    behind = se3.transform(np.eye(3), np.array([0.0, 0.0, -3.0]))
    assert silhouette_pixels(*BLOCK, behind, camera) == 0.0
