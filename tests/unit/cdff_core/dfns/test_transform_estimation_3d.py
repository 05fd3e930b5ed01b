# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.transform_estimation_3d.interface import TransformEstimation3DInputs
from cdff_core.dfns.transform_estimation_3d.least_squares import LeastSquares
from cdff_core.dfns.transform_estimation_3d.truncated_gnc import TruncatedGnc

T_TRUE = se3.transform(se3.exp_so3([0.4, -1.1, 2.0]), [3.0, -1.0, 0.5])


def make_node(implementation: Any, **config: Any) -> Any:
    dfn = implementation()
    dfn.configure(config)
    return dfn


def pairs(
    rng: np.random.Generator, n: int = 50, wrong: int = 0, sigma_m: float = 0.01
) -> tuple[np.ndarray, np.ndarray]:
    source = rng.uniform(-2.0, 2.0, (n, 3))
    sink = se3.transform_points(T_TRUE, source) + rng.normal(0.0, sigma_m, (n, 3))
    sink[:wrong] = rng.uniform(-4.0, 6.0, (wrong, 3))
    return source, sink


@pytest.mark.parametrize("implementation", [LeastSquares, TruncatedGnc])
def test_exact_pairs_give_the_exact_transform_also_if_they_are_coplanar(
    implementation: Any, rng: np.random.Generator
) -> None:
    source, sink = pairs(rng, 4, sigma_m=0.0)
    planar = source * [1.0, 1.0, 0.0]
    for a, b in ((source, sink), (planar, se3.transform_points(T_TRUE, planar))):
        outputs = make_node(implementation).process(TransformEstimation3DInputs(source=a, sink=b))
        assert outputs.transform == pytest.approx(T_TRUE, abs=1e-9)
        assert outputs.inliers.all()


@pytest.mark.parametrize("implementation", [LeastSquares, TruncatedGnc])
def test_errors_are_consistent_with_the_covariance(implementation: Any) -> None:
    nees = []
    for seed in range(200):
        source, sink = pairs(np.random.default_rng(seed), 20)
        outputs = make_node(implementation).process(TransformEstimation3DInputs(source=source, sink=sink))
        error = cov.pose_error(T_TRUE, outputs.transform)
        nees.append(error @ np.linalg.solve(outputs.covariance, error) / 6.0)
    # The F distribution with 6 and 54 degrees of freedom has mean 54 / 52; the mean of 200 draws varies by 5
    # %.
    assert np.mean(nees) == pytest.approx(54.0 / 52.0, abs=0.15)


@pytest.mark.req("CDFF-CORE-093")
def test_half_of_the_pairs_may_be_outliers(rng: np.random.Generator) -> None:
    source, sink = pairs(rng, 200, 100)
    outputs = make_node(TruncatedGnc, threshold=0.05).process(
        TransformEstimation3DInputs(source=source, sink=sink)
    )
    assert outputs.inliers[100:].all()
    assert outputs.inliers[:100].sum() <= 1
    assert np.linalg.norm(cov.pose_error(T_TRUE, outputs.transform)) < 0.01
    assert outputs.unit_variance == pytest.approx(1e-4, rel=0.3)


def test_pairs_are_weighted_by_their_sigmas(rng: np.random.Generator) -> None:
    source, sink = pairs(rng, 100)
    sink[:50] += rng.normal(0.0, 0.5, (50, 3))
    sigmas = np.repeat([0.5, 0.01], 50)
    errors = {}
    for name, pair_sigmas in (("equal", None), ("weighted", sigmas)):
        outputs = make_node(LeastSquares).process(
            TransformEstimation3DInputs(source=source, sink=sink, sigmas=pair_sigmas)
        )
        errors[name] = np.linalg.norm(cov.pose_error(T_TRUE, outputs.transform))
    assert errors["weighted"] < 0.3 * errors["equal"]
    assert outputs.unit_variance == pytest.approx(1.0, abs=0.3)


def test_degenerate_inconsistent_and_malformed_pairs_are_refused(rng: np.random.Generator) -> None:
    line = np.linspace(0.0, 1.0, 10)[:, None] * [[1.0, 2.0, 3.0]]
    with pytest.raises(DegenerateGeometryError):
        make_node(LeastSquares).process(TransformEstimation3DInputs(source=line, sink=line))
    source, sink = pairs(rng)
    with pytest.raises(RefusedError, match="expected at least 3"):
        make_node(LeastSquares).process(TransformEstimation3DInputs(source=source[:2], sink=sink[:2]))
    with pytest.raises(RefusedError) as refusal:
        make_node(LeastSquares, max_rms_m=0.01).process(
            TransformEstimation3DInputs(source=source, sink=sink[::-1])
        )
    assert refusal.value.reasons[0].startswith("rms:")
    with pytest.raises(RefusedError, match="pairs"):
        make_node(TruncatedGnc, min_pairs=10, threshold=1e-3).process(
            TransformEstimation3DInputs(source=source, sink=sink[::-1])
        )
    for a, b, s in ((source, sink[:3], None), (source, sink * np.nan, None), (source, sink, np.zeros(50))):
        with pytest.raises(InputError):
            make_node(LeastSquares).process(TransformEstimation3DInputs(source=a, sink=b, sigmas=s))


@pytest.mark.parametrize("alias", ["Transform3DEstimation", "LeastSquaresMinimization", "CeresEstimation"])
def test_the_names_of_infuse_select_the_dfn(alias: str) -> None:
    assert Registry.default().make_dfn(alias).configure() is None
