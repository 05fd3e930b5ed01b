# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.rectification_refinement.epipolar_field import EpipolarField
from cdff_core.dfns.rectification_refinement.interface import RectificationRefinementInputs
from tests.support.corridor import CAMERA


def matches(rng: np.random.Generator, n: int, k_px: float) -> RectificationRefinementInputs:
    """Return matches with the row offsets of a yaw error, with noise and 10 % outliers."""
    features = np.column_stack([rng.uniform(0, 320, n), rng.uniform(0, 240, n)])
    disparities = rng.uniform(2, 40, n)
    x = (features[:, 0] - disparities - CAMERA[0, 2]) / CAMERA[0, 0]
    y = (features[:, 1] - CAMERA[1, 2]) / CAMERA[1, 1]
    offsets = 0.1 - 0.2 * x + k_px * x * y + rng.normal(0, 0.15, n)
    offsets[::10] += rng.uniform(-1, 1, len(offsets[::10]))
    return RectificationRefinementInputs(
        features=features, disparities=disparities, camera_matrix=CAMERA, row_offsets=offsets
    )


def make_node() -> EpipolarField:
    dfn = EpipolarField()
    dfn.configure()
    return dfn


def test_a_yaw_error_is_estimated_from_row_offsets_and_corrected(rng: np.random.Generator) -> None:
    dfn, inputs = make_node(), matches(rng, 400, 5.0)
    outputs = dfn.process(inputs)
    np.testing.assert_allclose(outputs.coefficients, [0.1, -0.2, 0.0, 5.0], atol=0.25)
    x = (inputs.features[:, 0] - inputs.disparities - CAMERA[0, 2]) / CAMERA[0, 0]
    np.testing.assert_allclose(outputs.corrections, 5.0 * x**2, atol=0.1)
    assert np.median(np.abs(outputs.row_residuals)) < 0.2
    assert np.sqrt(outputs.open_covariance[1, 1]) > 4.0


def test_an_exact_rectification_gets_almost_no_corrections(rng: np.random.Generator) -> None:
    outputs = make_node().process(matches(rng, 400, 0.0))
    assert np.abs(outputs.corrections).max() < 0.1
    assert np.sqrt(outputs.open_covariance[1, 1]) < 0.6


def test_without_row_offsets_the_previous_estimate_is_used(rng: np.random.Generator) -> None:
    dfn, inputs = make_node(), matches(rng, 200, 5.0)
    with_row_offsets = dfn.process(inputs)
    outputs = dfn.process(
        RectificationRefinementInputs(
            features=inputs.features, disparities=inputs.disparities, camera_matrix=CAMERA
        )
    )
    assert np.array_equal(with_row_offsets.corrections, outputs.corrections)
    assert np.isnan(outputs.row_residuals).all()


def test_row_offsets_of_another_length_are_refused() -> None:
    with pytest.raises(InputError, match=r"row_offsets.*n=4 of features"):
        make_node().process(
            RectificationRefinementInputs(
                features=np.ones((4, 2)), disparities=np.ones(4), camera_matrix=CAMERA, row_offsets=np.ones(3)
            )
        )
