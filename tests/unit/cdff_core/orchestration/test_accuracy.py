# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Standard deviations of products, and bounds of requests on them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import CovarianceKind
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_core.orchestration.acceptance import ProductCandidate, assess
from cdff_core.orchestration.accuracy import Accuracy, AccuracyBounds, sigmas_of
from cdff_core.orchestration.request import parse_request
from tests.support.dpm_products import cloud, elevation

S = 1_000_000_000


def rotated_covariance(sigmas: list[float]) -> np.ndarray:
    """Return a pose covariance with principal axes that are not those of the frame."""
    R = se3.exp_so3([0.3, -0.5, 0.2])
    block = np.zeros((6, 6))
    for part in (slice(0, 3), slice(3, 6)):
        block[part, part] = R @ np.diag(np.square(sigmas[part])) @ R.T
    return block


def test_the_sigma_of_a_pose_is_that_in_its_worst_direction() -> None:
    covariance = rotated_covariance([0.1, 0.4, 0.2, 0.01, 0.02, 0.005])
    T = UncertainTransform(np.eye(4), covariance)
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=S)
    for product in (T, value):
        assert sigmas_of(product) == pytest.approx((0.4, math.degrees(0.02)))


def test_the_sigma_of_a_trajectory_is_that_of_its_worst_pose() -> None:
    covariances = [np.eye(6) * 0.01, np.eye(6) * 0.09, np.eye(6) * 0.04]
    trajectory = PoseTrajectory.from_arrays(
        [S, 2 * S, 3 * S], [np.eye(4)] * 3, covariances, parent="site", child="mana/base"
    )
    assert sigmas_of(trajectory) == pytest.approx((0.3, math.degrees(0.3)))


def test_the_sigma_of_a_map_is_the_root_mean_square_of_its_observed_cells() -> None:
    assert sigmas_of(elevation(0.0)) == (pytest.approx(0.1), None)


def test_the_sigma_of_an_unknown_covariance_and_of_other_products_is_unknown() -> None:
    covariance = np.eye(6)
    covariance[3:, :] = covariance[:, 3:] = math.nan
    trajectory = PoseTrajectory.from_arrays([S], [np.eye(4)], [covariance], parent="site", child="mana/base")
    assert sigmas_of(trajectory) == (1.0, None)
    for product in (UncertainTransform(np.eye(4)), cloud(3), None):
        assert sigmas_of(product) == (None, None)


@pytest.mark.parametrize(
    ("bounds", "unmet"),
    [
        (AccuracyBounds(), ()),
        (AccuracyBounds(sigma_m=0.2, sigma_deg=1.0), ()),
        (AccuracyBounds(sigma_m=0.19), ("sigma_m: 0.2, asked at most 0.19",)),
        (AccuracyBounds(sigma_deg=0.5), ("sigma_deg: 1, asked at most 0.5",)),
        (AccuracyBounds(covariance_kind=CovarianceKind.FORMAL), ()),
        (
            AccuracyBounds(covariance_kind=CovarianceKind.CALIBRATED),
            ("covariance_kind: formal, asked calibrated",),
        ),
        (AccuracyBounds(status="OK"), ("status: DEGRADED, asked OK",)),
    ],
)
def test_unmet_bounds_are_named(bounds: AccuracyBounds, unmet: tuple[str, ...]) -> None:
    assert bounds.unmet(Accuracy(0.2, 1.0, CovarianceKind.FORMAL, "DEGRADED")) == unmet
    assert bounds.is_set == (bounds != AccuracyBounds())


def test_an_unknown_sigma_meets_no_bound() -> None:
    assert AccuracyBounds(sigma_m=1e9).unmet(Accuracy()) == ("sigma_m: unknown, asked at most 1e+09",)
    assert Accuracy().text == "sigma unknown, covariance none, OK"


def test_unmet_bounds_are_differences_that_do_not_prevent_delivery() -> None:
    request = parse_request({"type": "dem", "max_sigma_m": "0.1", "max_oldest_age_s": "5"}, "mana")
    candidate = ProductCandidate("id", "mana", 100 * S, 80 * S, accuracy=Accuracy(sigma_m=0.2))
    assessment = assess(candidate, request, 100 * S)
    assert assessment.acceptable
    assert not assessment.satisfies
    assert assessment.differences == [
        "sigma_m: 0.2, asked at most 0.1",
        "oldest_age: 20.000 s, asked at most 5 s",
    ]
    assert assessment.unmet == "; ".join(assessment.differences)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"type": "image", "max_sigma_m": "1"}, "max_sigma_m does not apply to type=image"),
        ({"type": "dem", "max_sigma_deg": "1"}, "max_sigma_deg does not apply to type=dem"),
        ({"type": "pose", "max_sigma_m": "0"}, "max_sigma_m"),
        ({"type": "pose", "max_sigma_m": "nan"}, "max_sigma_m"),
        ({"type": "pose", "covariance_kind": "none"}, "covariance_kind"),
        ({"type": "pose", "status": "DEGRADED"}, "status"),
        ({"type": "pose", "max_oldest_age_s": "-1"}, "max_oldest_age_s"),
    ],
)
def test_bounds_that_do_not_apply_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_request(parameters, "mana")
