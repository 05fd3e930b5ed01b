# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.perspective_n_point_solving.interface import PerspectiveNPointSolvingInputs
from cdff_core.dfns.perspective_n_point_solving.p3p_ransac import P3pRansac
from tests.support.corridor import CAMERA

T_CAMERA_REFERENCE = se3.transform(se3.exp_so3([0.1, -0.2, 0.05]), [0.3, -0.1, 0.5])


def random_observations(rng: np.random.Generator, n: int, outliers: int) -> PerspectiveNPointSolvingInputs:
    z = rng.uniform(2.0, 10.0, n)
    points = np.column_stack([rng.uniform(-0.4, 0.4, n) * z, rng.uniform(-0.3, 0.3, n) * z, z])
    homogeneous_px = se3.transform_points(T_CAMERA_REFERENCE, points) @ CAMERA.T
    pixels = homogeneous_px[:, :2] / homogeneous_px[:, 2:] + rng.normal(0.0, 0.2, (n, 2))
    pixels[:outliers] = rng.uniform(0, 300, (outliers, 2))
    return PerspectiveNPointSolvingInputs(points=points, projections=pixels, camera_matrix=CAMERA)


def make_node(**config: float) -> P3pRansac:
    dfn = P3pRansac()
    dfn.configure(dict(config))
    return dfn


def test_the_pose_is_estimated_if_half_of_the_pairs_are_wrong(rng: np.random.Generator) -> None:
    outputs = make_node().process(random_observations(rng, 200, 100))
    assert np.linalg.norm(outputs.camera[:3, 3] - T_CAMERA_REFERENCE[:3, 3]) < 0.05
    assert outputs.inliers[100:].mean() > 0.9
    assert outputs.inliers[:100].mean() < 0.1


def test_equal_seeds_give_equal_bytes_independent_of_earlier_calls(rng: np.random.Generator) -> None:
    inputs, dfn = random_observations(rng, 100, 40), make_node(seed=7)
    first, second, of_new_node = dfn.process(inputs), dfn.process(inputs), make_node(seed=7).process(inputs)
    assert first.camera.tobytes() == second.camera.tobytes() == of_new_node.camera.tobytes()


def test_random_correspondences_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RefusedError) as refusal:
        make_node(max_iterations=50).process(random_observations(rng, 40, 40))
    assert refusal.value.reasons[0].startswith("few_inliers:")
    with pytest.raises(RefusedError, match="at least 12"):
        make_node().process(random_observations(rng, 5, 0))
