# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle adjustment reports deficient problems in the quality."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import BundleProblem
from evaluation.scenes.bundles import ring

TWO_CAMERAS = np.stack([np.eye(4), se3.transform(np.eye(3), [1.0, 0.0, 0.0])])
LENS = [700.0, 700.0, 320.0, 240.0]


def run_dfpc(problem: BundleProblem, **config: object) -> Output:
    dfpc = Registry.default().make_dfpc("bundle_adjustment")
    dfpc.configure(config)
    return next(iter(dfpc.step(Sample("problem", 0, 0, problem))))


def test_a_solution_that_has_not_converged_is_degraded() -> None:
    adjusted = run_dfpc(ring(8, 60, 6)[0], adjust={"max_iterations": 1})
    assert adjusted.quality.status is Status.DEGRADED
    assert adjusted.quality.reasons[0] == "not_converged"


def test_a_point_behind_its_cameras_is_degraded_and_counted() -> None:
    pixels = [[320.0, 240.0], [460.0, 240.0]]  # rays that meet 5 m behind both
    behind = BundleProblem.from_arrays(
        TWO_CAMERAS, LENS, [[0.0, 0.0, -4.0]], ([0, 1], [0, 0]), pixels, frame="site", fixed=[1.0, 1.0]
    )
    adjusted = run_dfpc(behind)
    assert adjusted.quality.status is Status.DEGRADED
    assert adjusted.quality.reasons == ("behind_camera:2",)
    assert adjusted.value.points.positions[0] == pytest.approx([0.0, 0.0, -5.0], abs=1e-6)


def test_fewer_residuals_than_unknowns_are_degraded_and_nan_fails() -> None:
    indices = ([0, 1, 0, 1], [0, 0, 1, 1])
    points = [[0.0, 0.0, 5.0], [1.0, 0.0, 5.0]]
    underdetermined = run_dfpc(
        BundleProblem.from_arrays(TWO_CAMERAS, LENS, points, indices, np.zeros((4, 2)), frame="site")
    )
    assert underdetermined.quality.status is Status.DEGRADED
    assert "underdetermined" in underdetermined.quality.reasons
    assert underdetermined.quality.covariance_kind is CovarianceKind.NONE
    pixels = np.full((4, 2), np.nan)
    with_nan = run_dfpc(BundleProblem.from_arrays(TWO_CAMERAS, LENS, points, indices, pixels, frame="site"))
    assert with_nan.quality.status is Status.FAILED
    assert with_nan.quality.reasons[0].startswith("bad_problem")
