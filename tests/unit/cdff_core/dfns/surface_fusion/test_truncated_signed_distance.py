# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Signed distance field of a wall."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.surface_fusion.interface import Inputs, Outputs
from cdff_core.dfns.surface_fusion.truncated_signed_distance import TruncatedSignedDistance

K = np.array([[50.0, 0.0, 30.0], [0.0, 50.0, 20.0], [0.0, 0.0, 1.0]])


def _dfn(**parameters: object) -> TruncatedSignedDistance:
    dfn = Registry.default().make_dfn("surface_fusion")
    assert isinstance(dfn, TruncatedSignedDistance)
    dfn.configure({"voxel_m": 0.05, **parameters})
    return dfn


def _wall(z_m: float, *, sigma_m: float = 0.01, x_m: float = 0.0, is_extracted: bool = True) -> Inputs:
    u, v = np.meshgrid((np.arange(60) - 30) / 50.0, (np.arange(40) - 20) / 50.0)
    points = (np.stack([u, v, np.ones_like(u)], axis=2) * z_m).astype(np.float32)
    pose = np.eye(4)
    pose[0, 3] = x_m
    return Inputs(
        points=points,
        normals=np.broadcast_to(np.array([0, 0, -1], np.float32), points.shape).copy(),
        sigmas=np.full(points.shape[:2], sigma_m, np.float32),
        camera_matrix=K,
        pose=pose,
        is_extracted=is_extracted,
    )


def _fused(dfn: TruncatedSignedDistance, *walls: Inputs) -> Outputs:
    return [dfn.process(wall) for wall in walls][-1]


def test_walls_are_averaged_by_their_variances() -> None:
    surface = _fused(_dfn(), _wall(2.0, sigma_m=0.02), _wall(2.02, sigma_m=0.01))
    assert np.median(surface.vertices[:, 2]) == pytest.approx(2.016, abs=0.001)
    np.testing.assert_allclose(surface.vertex_normals[:, 2], -1.0, atol=0.05)
    assert (surface.vertex_views == 2).all()


def test_the_standard_deviation_is_that_of_the_scatter_if_it_is_larger() -> None:
    equal = _fused(_dfn(), _wall(2.0), _wall(2.0))
    scattered = _fused(_dfn(), _wall(1.98), _wall(2.02))
    assert np.median(equal.vertex_sigmas) == pytest.approx(0.01 / np.sqrt(2), rel=0.25)
    assert np.median(scattered.vertex_sigmas) == pytest.approx(0.02, rel=0.05)


def test_a_surface_needs_min_views() -> None:
    assert len(_fused(_dfn(), _wall(2.0)).vertices) == 0
    assert len(_fused(_dfn(min_views=1), _wall(2.0)).vertices) > 100


def test_an_image_that_contradicts_the_surface_is_not_added() -> None:
    dfn = _dfn()
    before = _fused(dfn, _wall(2.0), _wall(2.0))
    with pytest.raises(RefusedError, match="contradict the surface"):
        dfn.process(_wall(2.6))
    empty = np.zeros((0, 0, 3), np.float32)
    after = dfn.process(
        Inputs(
            points=empty,
            normals=empty,
            sigmas=empty[:, :, 0],
            camera_matrix=K,
            pose=np.eye(4),
            is_extracted=True,
        )
    )
    np.testing.assert_array_equal(after.vertices, before.vertices)


def test_the_memory_is_bounded() -> None:
    dfn = _dfn(max_blocks=64, min_views=1)
    first = dfn.process(_wall(2.0, is_extracted=False))
    assert first.blocks == 64 or first.rejected_blocks == 0
    second = dfn.process(_wall(2.0, x_m=3.0))
    assert second.blocks <= 64
    assert second.rejected_blocks > 0
    assert len(second.vertices) > 0


def test_points_too_far_for_the_voxels_are_named() -> None:
    with pytest.raises(InputError, match="too far for voxels"):
        _dfn().process(_wall(1e6))
