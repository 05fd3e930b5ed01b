# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.stars import load_catalogue, visible_stars
from cdff_core.bearing_tracking.lens import distort_directions, undistort_directions
from cdff_core.dfns.star_identification.interface import StarIdentificationInputs, StarIdentificationOutputs
from cdff_core.dfns.star_identification.pair_verification import PairVerification
from tests.support.star_scene import CAMERA, T0_NS, pointing

CATALOGUE = load_catalogue().at(T0_NS)


@pytest.fixture(scope="module")
def identify() -> Callable[..., StarIdentificationOutputs]:
    dfn = PairVerification()
    dfn.configure()

    def run(
        directions: np.ndarray, attitude: np.ndarray | None = None, sigma: float = 0.0
    ) -> StarIdentificationOutputs:
        return dfn.process(
            StarIdentificationInputs(
                directions=directions,
                sigmas=np.full(len(directions), 3e-5),
                stamp=T0_NS,
                attitude=attitude,
                attitude_sigma=sigma,
            )
        )

    return run


def seen_stars(
    R: np.ndarray, rng: np.random.Generator, false: int = 0, missing: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    indices, pixels = visible_stars(CATALOGUE.brighter_than(6.8), CAMERA, R)
    is_visible = rng.random(len(indices)) >= missing
    indices, pixels = (
        indices[is_visible],
        pixels[is_visible] + rng.normal(0.0, 0.1, (int(is_visible.sum()), 2)),
    )
    others = rng.uniform([0, 0], [CAMERA.cols, CAMERA.rows], (false, 2))
    order = rng.permutation(np.r_[np.arange(len(indices)), np.full(false, -1)])
    order = np.sort(order[order >= 0])
    places = np.concatenate([pixels[order], others])
    truth = np.concatenate([indices[order], np.full(false, -1)])
    mixed = np.argsort(np.r_[np.arange(len(order)), rng.uniform(0, len(order), false)], kind="stable")
    return CAMERA.rays(places[mixed]), truth[mixed]


@pytest.mark.parametrize("seed", range(8))
def test_stars_in_random_directions_are_identified_among_false_sources(
    identify: Callable[..., StarIdentificationOutputs], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    R = pointing(rng.uniform(0, 360), np.degrees(np.arcsin(rng.uniform(-1, 1))), rng.uniform(0, 360))
    directions, truth = seen_stars(R, rng, false=5, missing=0.15)
    result = identify(directions)
    identified = result.stars >= 0
    assert (result.stars[identified] == truth[identified]).mean() > 0.95
    assert identified[truth >= 0].mean() > 0.9
    assert se3.rotation_angle(result.rotation @ R.T) < 5e-4
    assert not result.is_ambiguous


def test_a_guess_is_used_and_a_wrong_one_does_no_harm(
    identify: Callable[..., StarIdentificationOutputs],
) -> None:
    R = pointing(120.0, -40.0, 77.0)
    directions, truth = seen_stars(R, np.random.default_rng(1))
    for error in (0.003, 0.5):
        result = identify(directions, se3.exp_so3([error, 0.0, -error]) @ R, 0.003)
        assert (result.stars == truth).mean() > 0.9
        assert se3.rotation_angle(result.rotation @ R.T) < 5e-4


def test_sources_without_a_star_have_no_index_and_no_direction(
    identify: Callable[..., StarIdentificationOutputs],
) -> None:
    directions, truth = seen_stars(pointing(120.0, -40.0, 77.0), np.random.default_rng(4), false=5)
    result = identify(directions)
    is_matched = result.stars >= 0
    assert (result.stars[truth < 0] == -1).all()
    assert (result.stars[~is_matched] == -1).all()
    np.testing.assert_array_equal(np.isnan(result.star_directions).all(axis=1), ~is_matched)
    expected = CATALOGUE.directions[result.stars[is_matched]]
    np.testing.assert_allclose(result.star_directions[is_matched], expected, atol=1e-12)


def test_the_directions_of_stars_are_those_at_the_time_of_each_image() -> None:
    dfn = PairVerification()
    dfn.configure()
    R = pointing(120.0, -40.0, 77.0)
    directions, _ = seen_stars(R, np.random.default_rng(4))
    for stamp_ns in (T0_NS, T0_NS + 20 * 31_557_600 * 10**9):
        inputs = StarIdentificationInputs(
            directions=directions,
            sigmas=np.full(len(directions), 3e-5),
            stamp=stamp_ns,
            attitude=R,
            attitude_sigma=1e-3,
        )
        result = dfn.process(inputs)
        is_matched = result.stars >= 0
        expected = load_catalogue().at(stamp_ns).directions[result.stars[is_matched]]
        np.testing.assert_allclose(result.star_directions[is_matched], expected, atol=1e-9)


def test_errors_of_focal_length_and_distortion_are_measured(
    identify: Callable[..., StarIdentificationOutputs],
) -> None:
    directions, _ = seen_stars(pointing(290.0, 20.0, 10.0), np.random.default_rng(2))
    result = identify(distort_directions(directions, 1.004, -0.1))
    assert result.scale == pytest.approx(1.004, abs=3e-4)
    assert result.radial == pytest.approx(-0.1, abs=0.03)
    assert undistort_directions(distort_directions(directions, 1.004, -0.1), 1.004, -0.1) == pytest.approx(
        directions, abs=1e-9
    )


@pytest.mark.slow
def test_random_points_few_points_and_a_wrong_focal_length_are_refused(
    identify: Callable[..., StarIdentificationOutputs],
) -> None:
    rng = np.random.default_rng(3)
    points = CAMERA.rays(rng.uniform([0, 0], [CAMERA.cols, CAMERA.rows], (25, 2)))
    with pytest.raises(RefusedError, match="no attitude explains them"):
        identify(points)
    with pytest.raises(RefusedError, match="3 sources, expected at least 4"):
        identify(points[:3])
    directions, _ = seen_stars(pointing(290.0, 20.0, 10.0), rng)
    with pytest.raises(RefusedError, match="focal length"):
        identify(distort_directions(directions, 1.2, 0.0))


def test_photographs_of_stars_are_solved_to_ten_arc_seconds(
    real_data: Callable[[str], Path], identify: Callable[..., StarIdentificationOutputs]
) -> None:
    from evaluation.far_range_object_tracking import solve_photograph

    for path in sorted(real_data("star_images").glob("*.png")):
        result = solve_photograph(path)
        assert result["rms_arcsec"] < 10.0
        assert result["stars"] >= 17
