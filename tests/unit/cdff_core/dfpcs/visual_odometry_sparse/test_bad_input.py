# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sparse visual odometry on single, rotated, planar and opposite views, and with a wrong camera matrix."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair
from tests.support import textured_walls as walls
from tests.support.corridor import BASELINE_M, CAMERA, drive, stereo_pair

STEP_NS = 200_000_000
TRUE_POSES = drive(3)


def make_configured_dfpc() -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure({}, DfpcContext(robot="mana"))
    return dfpc


def step(dfpc: Dfpc, pair: FramePair, i: int) -> Output:
    (output,) = dfpc.step(Sample("stereo", i * STEP_NS, i, pair, id=f"pair{i}"))
    return output


def check_within_covariance(output: Output, T_true: np.ndarray, limit_m: float) -> None:
    error = cov.pose_error(T_true, output.value.transform.matrix)
    assert np.linalg.norm(error[:3]) < limit_m
    assert error @ np.linalg.solve(output.value.transform.covariance, error) < 40.0


def test_a_single_pair_is_the_origin() -> None:
    dfpc = make_configured_dfpc()
    output = step(dfpc, stereo_pair(TRUE_POSES[0], 0), 0)
    assert output.quality.status is Status.OK
    np.testing.assert_allclose(output.value.transform.matrix, np.eye(4), atol=1e-12)
    assert len(dfpc.call("get_trajectory", {}).stamps_ns) == 1


def test_a_pure_rotation_is_measured() -> None:
    dfpc = make_configured_dfpc()
    for i in range(3):
        rotation = se3.transform(se3.exp_so3([0.0, 0.02 * i, 0.0]), np.zeros(3))
        output = step(dfpc, stereo_pair(TRUE_POSES[0] @ rotation, i * STEP_NS), i)
    assert output.quality.status is not Status.FAILED
    check_within_covariance(output, se3.transform(se3.exp_so3([0.0, 0.04, 0.0]), np.zeros(3)), 0.005)


def test_a_motion_over_planar_ground_is_measured() -> None:
    dfpc, down = make_configured_dfpc(), se3.exp_so3([-0.4, 0.0, 0.0])
    path = [se3.transform(down, [0.08 * i, 0.3, 0.0]) for i in range(3)]
    for i, T in enumerate(path):
        output = step(dfpc, walls.pair(T, planes=walls.PLANE), i)
    assert output.quality.status is not Status.FAILED
    check_within_covariance(output, se3.inverse(path[0]) @ path[-1], 0.01)


def test_the_opposite_view_is_refused() -> None:
    dfpc = make_configured_dfpc()
    step(dfpc, stereo_pair(TRUE_POSES[0], 0), 0)
    opposite = se3.transform(se3.exp_so3([0.0, np.pi, 0.0]), [0.0, 0.0, 6.0])
    output = step(dfpc, stereo_pair(TRUE_POSES[0] @ opposite, STEP_NS), 1)
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons


def test_a_camera_matrix_of_another_image_size_is_refused() -> None:
    pair = stereo_pair(TRUE_POSES[0], 0)
    left, right = (np.array(image.image) for image in (pair.left, pair.right))
    wrong = FramePair.from_images(
        left, right, baseline_m=BASELINE_M, camera_matrix=np.diag([2.0, 2.0, 1.0]) @ CAMERA, stamp_ns=0
    )
    output = step(make_configured_dfpc(), wrong, 0)
    assert output.quality.status is Status.FAILED
    assert "principal point" in output.quality.reasons[0]


def test_images_of_different_sizes_or_80_ms_apart_are_refused() -> None:
    pair = stereo_pair(TRUE_POSES[0], 0)
    left, right = (np.array(image.image) for image in (pair.left, pair.right))

    def refused(right: np.ndarray, delay_ns: int) -> str:
        images = [
            Frame.from_image(image, stamp_ns=stamp_ns, camera_matrix=CAMERA, sensor="camera")
            for image, stamp_ns in ((left, STEP_NS), (right, STEP_NS + delay_ns))
        ]
        output = step(
            make_configured_dfpc(), FramePair(left=images[0], right=images[1], baseline=BASELINE_M), 1
        )
        assert output.quality.status is Status.FAILED
        return output.quality.reasons[0]

    assert "of left" in refused(right[:100].copy(), 0)
    assert "right image +0.080 s after the left one" in refused(right, 80_000_000)
