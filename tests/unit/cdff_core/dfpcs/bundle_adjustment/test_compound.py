# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import BundleProblem
from cdff_common.types.columns import pack_poses
from evaluation.scenes.bundles import cost, ring


def make_configured_dfpc(implementation: str | None = None, **config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("bundle_adjustment")
    dfpc.configure(config, implementation=implementation)
    return dfpc


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("implementation", ["LeastSquares", "Robust"])
def test_a_problem_gives_poses_and_landmarks_with_covariances_and_reports_its_gauge(
    implementation: str,
) -> None:
    problem, *_ = ring(8, 60, 6)
    stamped = replace(problem, cameras=replace(problem.cameras, stamps=np.arange(8) * 1000))
    dfpc = make_configured_dfpc(implementation)
    adjusted, trajectory, landmarks = dfpc.step(Sample("problem", 8_000_000, 0, stamped, id="p"))
    assert adjusted.quality.status is Status.OK
    assert adjusted.quality.covariance_kind is CovarianceKind.FORMAL
    assert any(reason.startswith("scale_kept") for reason in adjusted.quality.reasons)
    assert cost(adjusted.value) < 0.01 * cost(problem)
    assert adjusted.quality.metrics["cost_final"] == pytest.approx(cost(adjusted.value))
    assert trajectory.value.covariances.shape == (8, 6, 6)
    assert landmarks.value.covariances.shape == (60, 3, 3)
    assert np.linalg.eigvalsh(landmarks.value.covariances).min() > 0.0
    assert dfpc.store.get("last_problem") is adjusted.value


def test_marginalise_returns_the_remaining_problem_with_a_prior() -> None:
    dfpc = make_configured_dfpc()
    with pytest.raises(ProductNotFoundError):
        dfpc.call("marginalise", {"cameras": "1"})
    list(dfpc.step(Sample("problem", 0, 0, ring(8, 60, 6)[0])))
    remaining = dfpc.call("marginalise", {"cameras": "6,7"})
    assert remaining.cameras.ids.tolist() == list(range(6))
    assert len(remaining.prior.cameras) == 6
    with pytest.raises(InputError, match="commas"):
        dfpc.call("marginalise", {"cameras": "six"})
    dfpc.call("forget", {})
    with pytest.raises(ProductNotFoundError):
        dfpc.store.get("last_problem")


def test_a_problem_with_a_prior_has_a_gauge_and_covariances() -> None:
    dfpc = make_configured_dfpc()
    (first, *_) = dfpc.step(Sample("problem", 0, 0, ring(8, 60, 6)[0]))
    remaining = dfpc.call("marginalise", {"cameras": "7"})
    adjusted, *_, landmarks = dfpc.step(Sample("problem", 1, 1, remaining))
    assert adjusted.quality.status is Status.OK
    assert adjusted.quality.covariance_kind is CovarianceKind.FORMAL
    assert adjusted.quality.reasons == first.quality.reasons == ("scale_kept:camera 0 to camera 4",)
    assert adjusted.quality.metrics["gauge_directions"] == 7.0
    assert adjusted.quality.metrics["gauge_distance_camera"] == 4.0
    assert np.isfinite(landmarks.value.covariances).all()


def test_more_noise_than_stated_is_degraded_and_an_empty_problem_fails() -> None:
    (adjusted, *_) = make_configured_dfpc(sigma_px=0.1).step(Sample("problem", 0, 0, ring(8, 60, 6)[0]))
    assert adjusted.quality.status is Status.DEGRADED
    assert adjusted.quality.reasons[0].startswith("residuals_exceed_noise")
    (failed,) = make_configured_dfpc().step(Sample("problem", 0, 0, BundleProblem()))
    assert failed.quality.status is Status.FAILED
    assert failed.quality.reasons[0].startswith("bad_problem")


def test_the_covariances_contain_the_error_of_fixed_focal_lengths() -> None:
    problem, true_poses, truth = ring(8, 60, 6)
    cameras = replace(problem.cameras, fixed=np.array([1, 1] + [0] * 6, np.uint8))
    poses = np.concatenate([true_poses[:2], problem.cameras.matrices[2:]])
    cameras = replace(cameras, poses=pack_poses(poses, "cameras"))
    values = np.array(problem.lenses.values)
    values[:, :2] *= 1.01
    longer = replace(problem, cameras=cameras, lenses=replace(problem.lenses, values=values))
    ratios = {}
    for ratio in (0.0, 0.005):
        *_, landmarks = make_configured_dfpc(focal_length_ratio=ratio).step(Sample("problem", 0, 0, longer))
        sigmas = np.sqrt(np.einsum("nii->ni", landmarks.value.covariances))
        ratios[ratio] = np.quantile(np.abs(landmarks.value.data.positions - truth) / sigmas, 0.9)
    assert ratios[0.0] > 4.0
    assert ratios[0.005] < 3.0
