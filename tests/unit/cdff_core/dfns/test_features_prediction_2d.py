# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.dfns.features_prediction_2d.interface import FeaturesPrediction2DInputs
from cdff_core.dfns.features_prediction_2d.rectified_projection import RectifiedProjection
from cdff_core.imaging.rectified_camera import RectifiedCamera
from tests.support.corridor import BASELINE_M, CAMERA, SHAPE


def test_an_approached_point_is_magnified_and_points_behind_or_outside_the_image_are_invisible() -> None:
    dfn = RectifiedProjection()
    dfn.configure()
    points = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 0.5], [9.0, 0.0, 4.0], [0.2, 0.1, 1.8]])
    T_current_reference = se3.transform(np.eye(3), [0.0, 0.0, -1.0])
    out = dfn.process(
        FeaturesPrediction2DInputs(
            points=points,
            pose=T_current_reference,
            camera_matrix=CAMERA,
            baseline=BASELINE_M,
            image=np.zeros(SHAPE, np.uint8),
        )
    )
    assert out.visible.tolist() == [True, False, False, False]  # the last is magnified 2.25 times
    np.testing.assert_allclose(
        out.warps[0], np.diag([4.0 / 3.0, 4.0 / 3.0, 1.0])
    )  # without a slope, the patch is parallel to the image
    np.testing.assert_allclose(out.features[0], [159.5, 119.5])
    np.testing.assert_allclose(out.disparities[0], 260.0 * BASELINE_M / 3.0)


def test_a_patch_of_a_plane_is_warped_by_the_slope_of_its_neighbours(rng: np.random.Generator) -> None:
    camera = RectifiedCamera.from_matrix(CAMERA, BASELINE_M)
    T = se3.transform(se3.exp_so3([0.03, -0.05, 0.02]), [0.05, -0.02, -0.4])
    slopes = np.array([[0.1, 0.25], [-0.2, 0.0]])
    centres = np.array([[140.0, 150.0, 14.0], [200.0, 90.0, 20.0]])
    for slope, centre in zip(slopes, centres, strict=True):
        pixels = centre[:2] + np.vstack([np.zeros(2), rng.uniform(-7.0, 7.0, (6, 2))])
        uvd = np.column_stack([pixels, centre[2] + (pixels - centre[:2]) @ slope])
        points = camera.triangulate(uvd)
        dfn = RectifiedProjection()
        dfn.configure()
        out = dfn.process(
            FeaturesPrediction2DInputs(
                points=points,
                pose=T,
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                image=np.zeros(SHAPE, np.uint8),
                slopes=np.tile(slope, (7, 1)),
            )
        )
        displacements, offsets = out.features - out.features[0], pixels - pixels[0]
        warped = np.column_stack([offsets, np.ones(7)]) @ out.warps[0].T
        np.testing.assert_allclose(displacements, warped[:, :2] / warped[:, 2:], atol=1e-9)
        np.testing.assert_allclose(
            out.disparities - out.disparities[0], displacements @ out.slopes[0], atol=1e-9
        )


def test_slopes_of_wrong_size_are_refused() -> None:
    dfn = RectifiedProjection()
    dfn.configure()
    point, image = np.array([[0.0, 0.0, 4.0]]), np.zeros(SHAPE, np.uint8)
    with pytest.raises(InputError, match="slopes"):
        dfn.process(
            FeaturesPrediction2DInputs(
                points=point,
                pose=np.eye(4),
                camera_matrix=CAMERA,
                baseline=BASELINE_M,
                image=image,
                slopes=np.zeros((2, 2)),
            )
        )
