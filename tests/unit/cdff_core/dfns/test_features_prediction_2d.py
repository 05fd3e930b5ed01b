# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_core.dfns.features_prediction_2d._interface import FeaturesPrediction2DInputs
from cdff_core.dfns.features_prediction_2d.rectified_projection import RectifiedProjection
from tests.corridor import BASELINE_M, CAMERA, SHAPE


def test_a_point_approached_grows_and_one_behind_or_beside_is_not_visible() -> None:
    dfn = RectifiedProjection()
    dfn.configure()
    points = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 0.5], [9.0, 0.0, 4.0], [0.2, 0.1, 1.8]])
    T_current_reference = se3.transform(np.eye(3), [0.0, 0.0, -1.0])
    out = dfn.process(
        FeaturesPrediction2DInputs(
            points, T_current_reference, CAMERA, np.array([BASELINE_M]), np.zeros(SHAPE, np.uint8)
        )
    )
    assert out.visible.tolist() == [True, False, False, False]  # the last grows 2.25 times
    np.testing.assert_allclose(out.magnification[0], 4.0 / 3.0)
    np.testing.assert_allclose(out.features[0], [159.5, 119.5])
    np.testing.assert_allclose(out.disparities[0], 260.0 * BASELINE_M / 3.0)
