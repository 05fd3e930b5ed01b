# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_core.dfns.multi_target_association.interface import (
    MultiTargetAssociationInputs,
    MultiTargetAssociationOutputs,
)
from cdff_core.dfns.multi_target_association.multiple_hypotheses import (
    COASTING,
    CONFIRMED,
    LOST,
    MultipleHypotheses,
)
from cdff_core.dfns.multi_target_association.resting_sources import RestingSources

PIXEL, SIGMA_PX, WIDTH = 2e-4, 0.13, 300.0
T0_NS = 1_700_000_000_000_000_000


class Sky:
    """Sources on a plane of pixels: stars at rest, false sources, and objects."""

    def __init__(self, seed: int = 1, stars: int = 60, false: float = 15.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.stars = self.rng.uniform(-WIDTH, WIDTH, (stars, 2))
        self.false = false
        self.dfn = MultipleHypotheses()
        self.dfn.configure()

    def step(
        self,
        time_s: float,
        objects: np.ndarray,
        evidence: float = -9.0,
        shown: float = 0.9,
        dark: bool = False,
    ) -> MultiTargetAssociationOutputs:
        objects = np.asarray(objects, float).reshape(-1, 2)
        stars = self.stars[self.rng.random(len(self.stars)) < shown]
        false = self.rng.uniform(-WIDTH, WIDTH, (self.rng.poisson(self.false), 2))
        exact = np.concatenate([objects, stars])
        pixels = np.concatenate([exact + self.rng.normal(0.0, SIGMA_PX, exact.shape), false])
        v = np.column_stack([pixels * PIXEL, np.ones(len(pixels))])
        n = len(pixels)
        return self.dfn.process(
            MultiTargetAssociationInputs(
                stamp=T0_NS + round(time_s * 1e6) * 1000,
                directions=v / np.linalg.norm(v, axis=1, keepdims=True),
                covariances=np.repeat(np.eye(3)[None] * (SIGMA_PX * PIXEL) ** 2, n, axis=0),
                snr=np.full(n, 6.0),
                pixels=pixels,
                can_start=np.ones(n, bool),
                defect_evidence=np.full(n, evidence),
                stars=np.zeros((0, 3)),
                blend_angle=2.5 * PIXEL,
                solid_angle=(2.0 * WIDTH * PIXEL) ** 2,
                is_dark=dark,
            )
        )


def place(out: MultiTargetAssociationOutputs, number: int) -> np.ndarray:
    v = out.object_directions[int(np.flatnonzero(out.ids == number)[0])]
    return v[:2] / v[2] / PIXEL


def line(k: float) -> np.ndarray:
    return np.array([-150.0 + 4.0 * k, 60.0 - 1.5 * k])


def test_a_moving_object_is_confirmed_within_six_images_and_followed() -> None:
    sky = Sky()
    for k in range(30):
        out = sky.step(k, line(k))
        if k >= 6:
            assert out.ids[out.ids > 0].tolist() == [1]
            assert np.linalg.norm(place(out, 1) - line(k)) < 1.0
    assert out.classes[out.ids == 1] == 1


@pytest.mark.slow
def test_stars_and_false_sources_alone_give_no_object_in_400_images() -> None:
    sky = Sky(seed=2)
    assert all((sky.step(k, np.zeros((0, 2))).ids < 0).all() for k in range(400))


def test_a_dark_object_coasts_with_growing_covariance_and_keeps_its_number() -> None:
    sky = Sky(seed=3)
    sigmas = []
    for k in range(60):
        out = sky.step(k, line(k) if k < 20 or k >= 45 else np.zeros((0, 2)))
        if 20 <= k < 45:
            i = np.flatnonzero(out.ids == 1)[0]
            assert out.states[i] == 2
            assert out.sources[i] == -1
            sigmas.append(np.trace(out.object_covariances[i, :3, :3]))
    assert (np.diff(sigmas) > 0.0).all()
    assert out.ids[out.states == 1].tolist() == [1]
    assert np.linalg.norm(place(out, 1) - line(59)) < 1.0


@pytest.mark.slow
def test_after_35_minutes_in_the_dark_the_object_continues_and_no_star_does() -> None:
    sky = Sky(seed=4)

    def slow(k: float) -> np.ndarray:
        return np.array([-100.0 + 0.05 * k, 10.0 - 0.02 * k])

    for k in range(60):
        sky.step(10.0 * k, slow(10.0 * k))
    for k in range(60, 270):
        out = sky.step(10.0 * k, np.zeros((0, 2)))
        assert out.states[out.ids == 1].tolist() == [2]
    for k in range(270, 300):
        out = sky.step(10.0 * k, slow(10.0 * k))
    assert out.ids[out.states == 1].tolist() == [1]
    assert np.linalg.norm(place(out, 1) - slow(2990.0)) < 1.0


def test_an_object_that_crosses_a_star_is_not_swapped_to_it() -> None:
    sky = Sky(seed=5)
    sky.stars = np.concatenate([sky.stars, [line(20), line(20.4)]])
    for k in range(40):
        out = sky.step(k, line(k))
    assert out.ids[out.ids > 0].tolist() == [1]
    assert np.linalg.norm(place(out, 1) - line(39)) < 1.0


def test_two_objects_that_cross_keep_their_numbers() -> None:
    sky = Sky(seed=6, false=5.0)

    def second(k: float) -> np.ndarray:
        return np.array([-150.0 + 4.0 * k, -60.0 + 2.5 * k])

    numbers = {}
    for k in range(60):
        out = sky.step(k, np.stack([line(k), second(k)]))
        if k == 12:
            for name, path in (("line", line), ("second", second)):
                numbers[name] = min(
                    out.ids[out.ids > 0], key=lambda i: np.linalg.norm(place(out, i) - path(k))
                )
    assert np.linalg.norm(place(out, numbers["line"]) - line(59)) < 1.0
    assert np.linalg.norm(place(out, numbers["second"]) - second(59)) < 1.0


def test_a_slow_object_leaves_the_map_of_sources_at_rest() -> None:
    sky = Sky(seed=7)
    first_step = None
    for k in range(200):
        out = sky.step(k, [20.0 + 0.08 * k, 30.0])
        if first_step is None and (out.ids > 0).any():
            first_step = k
    assert first_step is not None
    assert first_step < 150
    assert np.linalg.norm(place(out, 1) - [20.0 + 0.08 * 199, 30.0]) < 1.0


def test_the_line_of_a_source_that_is_not_seen_does_not_reach_a_star_later() -> None:
    def ray(u: float, v: float) -> np.ndarray:
        w = np.array([[u * PIXEL, v * PIXEL, 1.0]])
        return w / np.linalg.norm(w)

    resting, variance = RestingSources(), np.array([(SIGMA_PX * PIXEL) ** 2])
    for k in range(9):
        at = resting.matched(ray(0.15 * k, 0.0), variance, k)
        resting.update(at, ray(0.15 * k, 0.0), variance, np.array([-9.0]), k)
    assert len(resting) == 1
    assert resting.matched(ray(1.35, 0.0), variance, 9.0).tolist() == [0]
    for k in range(9, 20):
        resting.update(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0), k)
    assert resting.matched(ray(3.0, 0.0), variance, 20.0).tolist() == [-1]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("path_px", "is_confirmed"), [(3.0, False), (5.0, True)])
def test_a_path_within_the_distance_of_blended_stars_and_its_noise_is_no_motion(
    path_px: float, is_confirmed: bool, seed: int
) -> None:
    # The limit is 2.5 pixels, plus four standard deviations of the difference of two sources: 3.24 pixels.
    sky = Sky(seed=seed, stars=0, false=0.0)
    for k in range(9):
        out = sky.step(k, [20.0 + path_px * k / 8.0, 30.0])
    assert bool((out.ids > 0).any()) is is_confirmed


def test_a_source_in_a_fixed_pixel_is_an_object_only_if_its_shape_excludes_a_defect() -> None:
    for evidence, expected in ((-9.0, True), (-0.5, False)):
        sky = Sky(seed=8, stars=0, false=3.0)
        for k in range(12):
            # The pixels are those of a camera that turns with the object: pixel fixed, direction moving.
            out = fixed_pixel_step(sky, k, evidence)
        assert bool((out.ids > 0).any()) is expected


def test_an_object_is_lost_when_its_largest_standard_deviation_exceeds_the_limit() -> None:
    lost = []
    for sigma_x_px in (SIGMA_PX, 3.0):
        sky = Sky(seed=8, stars=0)
        sky.dfn.configure({"lost_rad": PIXEL})
        steps = [fixed_pixel_step(sky, k, -9.0, sigma_x_px) for k in range(12)]
        lost.append(any((out.states == LOST).any() for out in steps))
    assert lost == [False, True]


@pytest.mark.parametrize(("hits", "is_lost"), [(7, True), (9, True), (10, False)])
def test_a_brief_object_is_lost_after_more_than_twice_as_many_images_without_a_source(
    hits: int, is_lost: bool
) -> None:
    sky = Sky(seed=9, stars=0, false=0.0)
    for k in range(hits):
        out = sky.step(k, line(k))
    assert out.states.tolist() == [CONFIRMED]
    states = [int(sky.step(hits + k, np.zeros((0, 2))).states[0]) for k in range(2 * hits + 1)]
    assert states == [COASTING] * 2 * hits + [LOST if is_lost else COASTING]


def fixed_pixel_step(
    sky: Sky, k: int, evidence: float, sigma_x_px: float = SIGMA_PX
) -> MultiTargetAssociationOutputs:
    u = line(k) + sky.rng.normal(0.0, SIGMA_PX, 2)
    v = np.array([*(u * PIXEL), 1.0])
    return sky.dfn.process(
        MultiTargetAssociationInputs(
            stamp=T0_NS + k * 10**9,
            directions=(v / np.linalg.norm(v))[None],
            covariances=np.diag([sigma_x_px, SIGMA_PX, SIGMA_PX])[None] ** 2 * PIXEL**2,
            snr=np.array([6.0]),
            pixels=np.array([[100.0, 100.0]]),
            can_start=np.ones(1, bool),
            defect_evidence=np.array([evidence]),
            stars=np.zeros((0, 3)),
            blend_angle=2.5 * PIXEL,
            solid_angle=(2.0 * WIDTH * PIXEL) ** 2,
            is_dark=False,
        )
    )


def test_an_image_that_is_not_later_is_refused() -> None:
    sky = Sky()
    sky.step(1.0, line(1))
    with pytest.raises(InputError, match="expected later than the previous one"):
        sky.step(1.0, line(1))
