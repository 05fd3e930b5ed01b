# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.stereo_triangulation.interface import StereoTriangulationInputs
from cdff_core.dfns.stereo_triangulation.rectified_triangulation import RectifiedTriangulation
from tests.support.corridor import BASELINE_M, CAMERA


def test_the_depth_is_inversely_proportional_to_the_disparity_and_its_sigma_grows_with_depth_squared() -> (
    None
):
    dfn = RectifiedTriangulation()
    dfn.configure({"sigma_disparity_px": 0.1})
    outputs = dfn.process(
        StereoTriangulationInputs(
            features=np.full((2, 2), [159.5, 119.5]),
            disparities=np.array([10.0, 20.0]),
            camera_matrix=CAMERA,
            baseline=BASELINE_M,
        )
    )
    np.testing.assert_allclose(outputs.points, [[0, 0, 5.2], [0, 0, 2.6]], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(outputs.covariances[:, 2, 2]), [0.052, 0.013], rtol=1e-9)


def test_the_covariance_is_that_of_many_points_with_noise(rng: np.random.Generator) -> None:
    dfn = RectifiedTriangulation()
    dfn.configure({"sigma_feature_px": 0.5, "sigma_disparity_px": 0.1})
    noise = rng.normal(0.0, 1.0, (20_000, 3))
    noise[0] = 0.0
    outputs = dfn.process(
        StereoTriangulationInputs(
            features=np.array([250.0, 60.0]) + 0.5 * noise[:, :2],
            disparities=20.0 + 0.1 * noise[:, 2],
            camera_matrix=CAMERA,
            baseline=BASELINE_M,
        )
    )
    assert np.cov(outputs.points.T) == pytest.approx(outputs.covariances[0], rel=0.08, abs=2e-6)


def test_a_disparity_of_zero_is_refused() -> None:
    dfn = RectifiedTriangulation()
    dfn.configure()
    with pytest.raises(InputError, match="above 0"):
        dfn.process(
            StereoTriangulationInputs(
                features=np.ones((1, 2)),
                disparities=np.zeros(1),
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
            )
        )
