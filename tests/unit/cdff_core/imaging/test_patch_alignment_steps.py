# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each Gauss-Newton step of the compiled alignments equals that of dense least squares with homogeneous
matrices (Baker and Matthews 2004); the limits of images, structure and slope are exact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_core.imaging.patch_alignment import align_patches, align_slanted

Array = np.ndarray
HALF = 2
#: Offsets x, y of the pixels of a patch from its centre.
OFFSETS = np.array([(u, v) for v in range(-HALF, HALF + 1) for u in range(-HALF, HALF + 1)], dtype=np.float64)


def texture(seed: int, rows: int = 26, cols: int = 31) -> Array:
    noise = np.random.default_rng(seed).normal(size=(rows, cols))
    return np.ascontiguousarray(100.0 + 400.0 * gaussian_filter(noise, 1.5, mode="wrap"), dtype=np.float32)


def sampled(image: Array, pixels: Array) -> Array:
    """Return bilinear values at pixels (m, 2) x, y."""
    return map_coordinates(image.astype(np.float64), pixels.T[::-1], order=1)


def template(image: Array, centre: Array) -> tuple[Array, Array]:
    """Return the values (m,) of a patch and their central differences (m, 2), less their means."""
    pixels = centre + OFFSETS
    values = sampled(image, pixels)
    steps = [(sampled(image, pixels + e) - sampled(image, pixels - e)) / 2.0 for e in np.eye(2)]
    gradients = np.column_stack(steps)
    return values - values.mean(), gradients - gradients.mean(axis=0)


def warped(W: Array) -> Array:
    """Return the pixels of a patch, moved by a homography (3, 3)."""
    warped_offsets = np.column_stack([OFFSETS, np.ones(len(OFFSETS))]) @ W.T
    return warped_offsets[:, :2] / warped_offsets[:, 2:]


def correlation_and_errors(image: Array, W: Array, values: Array) -> tuple[float, Array]:
    """Return the normalised correlation, and the differences of the patch with the gain of the template."""
    patch = sampled(image, warped(W))
    patch -= patch.mean()
    correlation = patch @ values / np.linalg.norm(patch) / np.linalg.norm(values)
    return correlation, patch * (values @ values) / (patch @ values) - values


def translated(reference: Array, image: Array, point: Array, start: Array, A: Array, steps: int) -> Array:
    """Return positions and correlations (steps + 1, 3) of an alignment by translations."""
    values, G = template(reference, point)
    centre, rows = start.copy(), []
    for _ in range(steps + 1):
        W = np.array([[1.0, 0.0, centre[0]], [0.0, 1.0, centre[1]], [0.0, 0.0, 1.0]]) @ A
        correlation, errors = correlation_and_errors(image, W, values)
        rows.append([*centre, correlation])
        step = np.linalg.lstsq(G, errors, rcond=None)[0]
        step *= min(1.0, 2.0 / np.linalg.norm(step))
        centre = centre - A[:2, :2] @ step
    return np.array(rows)


def slanted(left: Array, right: Array, point: Array, start: Array, steps: int) -> Array:
    """Return positions, slopes and correlations (steps + 1, 5) of an alignment with slopes."""
    values, gradients = template(left, point)
    raw = (sampled(left, point + OFFSETS + [1, 0]) - sampled(left, point + OFFSETS - [1, 0])) / 2.0
    G = np.column_stack([gradients, raw[:, None] * OFFSETS / HALF])
    G -= G.mean(axis=0)
    H = G.T @ G + np.diag([0.0, 0.0, 0.05, 0.05]) * (G[:, 0] @ G[:, 0])
    W = np.array([[1.0, 0.0, start[0]], [0.0, 1.0, start[1]], [0.0, 0.0, 1.0]])
    rows = []
    for _ in range(steps + 1):
        correlation, errors = correlation_and_errors(right, W, values)
        rows.append([W[0, 2], W[1, 2], 1.0 - W[0, 0], -W[0, 1], correlation])
        dx, dy, da, db = np.linalg.solve(H, G.T @ errors) / [1.0, 1.0, HALF, HALF]
        limit = max(np.hypot(dx, dy) / 2.0, abs(da) / 0.5, abs(db) / 0.5, 1.0)
        dx, dy, da, db = np.array([dx, dy, da, db]) / limit
        W = W @ np.linalg.inv([[1.0 + da, db, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])
    return np.array(rows)


POINTS = np.array([[10.3, 9.8], [15.0, 12.0], [20.6, 13.4], [12.5, 16.1], [17.2, 10.7]])


def warps(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    A = np.tile(np.eye(3), (len(POINTS), 1, 1))
    A[:, :2, :2] += rng.uniform(-0.3, 0.3, (len(POINTS), 2, 2))
    A[:, 2, :2] = rng.uniform(-0.05, 0.05, (len(POINTS), 2))
    return A


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("seed", [1, 2])
def test_steps_of_translations_are_those_of_least_squares(seed: int, steps: int) -> None:
    """The second image has another gain, so that the correlations are positive and the steps up to 2 px."""
    reference, A = texture(seed), warps(seed)
    image = 0.5 * reference + 0.2 * texture(seed + 10)
    start = POINTS + np.random.default_rng(seed).uniform(-0.6, 0.6, POINTS.shape)
    positions, score = align_patches(reference, image, POINTS, start, A, HALF, steps - 1, 1e-12)
    for i, (point, begin) in enumerate(zip(POINTS, start, strict=True)):
        expected = translated(reference, image, point, begin, A[i], steps)
        assert np.all(expected[:-1, 2] > 0.0)
        np.testing.assert_allclose(positions[i], expected[-1, :2], atol=1e-6)
    np.testing.assert_array_equal(score, np.full(len(POINTS), -1.0))  # no step is below the tolerance
    # At a wide tolerance the search ends after the first step, with the correlation there.
    positions, score = align_patches(reference, image, POINTS, start, A, HALF, 1, 10.0)
    for i, (point, begin) in enumerate(zip(POINTS, start, strict=True)):
        expected = translated(reference, image, point, begin, A[i], 1)
        np.testing.assert_allclose([*positions[i], score[i]], expected[1], atol=1e-6)


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("seed", [1, 3])
def test_steps_with_slopes_are_those_of_damped_least_squares(seed: int, steps: int) -> None:
    left = texture(seed)
    right = np.ascontiguousarray(0.5 * left + 0.15 * texture(seed + 10))
    start = POINTS + np.random.default_rng(seed).uniform(-0.5, 0.5, POINTS.shape)
    positions, slopes, score = align_slanted(left, right, POINTS, start, HALF, steps - 1, 1e-12, 10.0)
    for i, (point, begin) in enumerate(zip(POINTS, start, strict=True)):
        expected = slanted(left, right, point, begin, steps)
        assert np.all(expected[:-1, 4] > 0.0)
        np.testing.assert_allclose([*positions[i], *slopes[i]], expected[-1, :4], atol=1e-6)
    np.testing.assert_array_equal(score, np.full(len(POINTS), -1.0))
    positions, slopes, score = align_slanted(left, right, POINTS, start, HALF, 1, 10.0, 10.0)
    for i, (point, begin) in enumerate(zip(POINTS, start, strict=True)):
        expected = slanted(left, right, point, begin, 1)
        np.testing.assert_allclose([*positions[i], *slopes[i], score[i]], expected[1], atol=1e-6)


@pytest.mark.parametrize("seed", [1, 8])
def test_a_long_step_is_limited_by_its_length_or_by_a_slope(seed: int) -> None:
    """The images differ so much that steps reach 2 px, or a change of 0.5 of either slope."""
    left = texture(seed)
    right = np.ascontiguousarray(0.5 * left + 0.5 * texture(seed + 10))
    start = POINTS + np.random.default_rng(seed).uniform(-1.0, 1.0, POINTS.shape)
    positions, slopes, _ = align_slanted(left, right, POINTS, start, HALF, 0, 1e-12, 10.0)
    at_limit = set()
    for i, (point, begin) in enumerate(zip(POINTS, start, strict=True)):
        before, after = slanted(left, right, point, begin, 1)
        np.testing.assert_allclose([*positions[i], *slopes[i]], after[:4], atol=1e-6)
        S = step_between(before, after)
        at_limit |= {
            name
            for name, value in (
                ("length", np.hypot(S[0, 2], S[1, 2]) / 2.0),
                ("column", abs(S[0, 0] - 1.0) / 0.5),
                ("row", abs(S[0, 1]) / 0.5),
            )
            if value > 1.0 - 1e-9
        }
    assert at_limit == ({"length", "column", "row"} if seed == 1 else {"length", "row"})


def step_between(before: Array, after: Array) -> Array:
    """Return the step S of ``W_after = W_before S^-1`` between two rows of ``slanted``."""
    W = [np.array([[1.0 - a, -b, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]]) for x, y, a, b, _ in (before, after)]
    return np.linalg.inv(W[1]) @ W[0]


def scores_of(
    align: str, reference: Array, image: Array, points: Array, start: Array, warp: Array | None = None
) -> Array:
    if align == "slanted":
        positions, _, score = align_slanted(reference, image, points, start, HALF, 5, 1e-6, 0.8)
    else:
        warp = np.eye(3) if warp is None else warp
        A = np.tile(warp, (len(points), 1, 1))
        positions, score = align_patches(reference, image, points, start, A, HALF, 5, 1e-6)
    np.testing.assert_array_equal(positions[score == -1.0], start[score == -1.0])
    return score


BOTH = pytest.mark.parametrize("align", ["translated", "slanted"])


@BOTH
def test_a_patch_with_its_gradients_lies_within_the_reference_image(align: str) -> None:
    """The margins of 4 pixels are inclusive on the left and above, exclusive on the right and below."""
    image = texture(4)
    inside = np.array([[4.0, 13.0], [25.999, 13.0], [15.0, 4.0], [15.0, 20.999]])
    outside = np.array(
        [[3.999, 13.0], [26.0, 13.0], [15.0, 3.999], [15.0, 21.0], [np.nan, 13.0], [15.0, np.nan]]
    )
    larger = np.ascontiguousarray(np.pad(image, 10, mode="wrap"))
    np.testing.assert_allclose(scores_of(align, image, larger, inside, inside + 10.0), 1.0, atol=1e-9)
    np.testing.assert_array_equal(scores_of(align, image, larger, outside, outside + 10.0), -1.0)


@BOTH
def test_a_patch_lies_within_the_second_image(align: str) -> None:
    image = texture(5)
    larger = np.ascontiguousarray(np.pad(image, 10, mode="wrap"))
    inside = np.array([[4.0, 13.0], [25.999, 13.0], [15.0, 4.0], [15.0, 20.999]])
    outside = np.array([[3.999, 13.0], [26.0, 13.0], [15.0, 3.999], [15.0, 21.0], [np.nan, 13.0]])
    np.testing.assert_allclose(scores_of(align, larger, image, inside + 10.0, inside), 1.0, atol=1e-9)
    beyond = scores_of(align, larger, image, np.nan_to_num(outside, nan=12.0) + 10.0, outside)
    np.testing.assert_array_equal(beyond, -1.0)


@pytest.mark.parametrize(
    ("warp", "extent"),
    [
        ([[1.5, 0.25, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 2 * 1.75 + 2.0),
        ([[1.0, 0.0, 0.0], [-0.5, -1.5, 0.0], [0.0, 0.0, 1.0]], 2 * 2.0 + 2.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.125, -0.125, 1.0]], 2 / 0.5 + 2.0),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0625, 0.0, 1.0]], 2 / 0.875 + 2.0),
    ],
)
def test_the_margin_of_the_second_image_is_that_of_the_warped_patch(warp: list[Array], extent: float) -> None:
    """A single step of any length is accepted: the score is that of the start, if it is inside."""
    image, A = texture(6), np.array([warp])
    middle = np.array([15.3, 12.6])
    for axis, size in ((0, 31), (1, 26)):
        for position, is_inside in (
            (extent, True), (extent - 1e-9, False), (size - extent - 1.0 - 1e-9, True),
            (size - extent - 1.0, False),
        ):  # fmt: skip
            start = middle.copy()
            start[axis] = position
            reference = matching_template(image, start, A[0])
            _, score = align_patches(
                reference, image, np.array([[15.0, 12.0]]), start[None], A, HALF, 0, 100.0
            )
            assert (score[0] > 0.5) == is_inside


def matching_template(image: Array, start: Array, A: Array) -> Array:
    """Return an image whose patch around (15, 12) has the values of the warped patch at ``start``."""
    reference = texture(7)
    W = np.array([[1.0, 0.0, start[0]], [0.0, 1.0, start[1]], [0.0, 0.0, 1.0]]) @ A
    pixels = np.clip(warped(W), 0.0, [30.0, 25.0])
    reference[10:15, 13:18] = sampled(image, pixels).reshape(5, 5)
    return reference


def test_a_warp_that_halves_the_depth_within_the_patch_is_the_limit() -> None:
    image, start = texture(6), np.array([[15.3, 12.6]])
    for wx, wy, is_aligned in ((0.125, -0.125, True), (0.125, 0.1251, False), (-0.3, 0.0, False)):
        A = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [wx, wy, 1.0]]])
        reference = matching_template(image, start[0], A[0])
        _, score = align_patches(reference, image, np.array([[15.0, 12.0]]), start, A, HALF, 0, 100.0)
        assert (score[0] > 0.5) == is_aligned


def energy(image: Array, point: Array) -> float:
    values, _ = template(image, point)
    return float(values @ values)


@BOTH
@pytest.mark.parametrize(("factor", "has_structure"), [(0.98, False), (1.02, True)])
def test_a_patch_with_less_than_a_thousandth_squared_grey_level_is_flat(
    align: str, factor: float, has_structure: bool
) -> None:
    point = np.array([[15.0, 12.0]])
    image = texture(8) - np.float32(100.0)
    weak = np.ascontiguousarray(image * np.float32(np.sqrt(factor * 1e-3 / energy(image, point[0]))))
    for reference, other in ((weak, image), (image, weak)):
        score = scores_of(align, reference, other, point, point)
        assert score[0] == pytest.approx(1.0 if has_structure else -1.0, abs=1e-6)


@BOTH
@pytest.mark.parametrize(("factor", "is_constrained"), [(0.9, False), (1.1, True)])
def test_a_patch_needs_a_millionth_of_its_gradients_across(
    align: str, factor: float, is_constrained: bool
) -> None:
    """The determinant of the normal equations is compared with 1e-6 of the square of their trace."""
    point = np.array([[15.0, 12.0]])
    along = np.tile(texture(9)[12], (26, 1)).astype(np.float64) - 100.0
    across = texture(10).astype(np.float64) - 100.0

    def ratio(scale: float) -> float:
        _, G = template(along + scale * across, point[0])
        H = G.T @ G
        return float(np.linalg.det(H) / np.trace(H) ** 2)

    low, high = 0.0, 0.1
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if ratio(middle) > factor * 1e-6 else (middle, high)
    image = np.ascontiguousarray(along + high * across, dtype=np.float32)
    score = scores_of(align, image, image, point, point)
    assert score[0] == pytest.approx(1.0 if is_constrained else -1.0, abs=1e-6)


@BOTH
def test_a_patch_of_the_opposite_contrast_is_not_aligned(align: str) -> None:
    image, point = texture(11), np.array([[15.0, 12.0]])
    assert scores_of(align, image, np.ascontiguousarray(200.0 - image), point, point)[0] == -1.0


@BOTH
def test_a_search_that_leaves_the_image_or_the_iterations_has_no_score(align: str) -> None:
    image = texture(12)
    point = np.array([[15.0, 12.0]])
    start = point + 0.3
    assert scores_of_exact(align, image, point, start, 30) == pytest.approx(1.0, abs=1e-6)
    assert scores_of_exact(align, image, point, start, 0) == -1.0
    # A template that is found beyond the left border: the search moves there until the patch is outside.
    shifted = np.ascontiguousarray(image[:, 12:])
    assert scores_of_exact(align, image, point, np.array([[4.5, 12.0]]), 20, shifted) == -1.0


def scores_of_exact(
    align: str, image: Array, point: Array, start: Array, iterations: int, other: Array | None = None
) -> float:
    other = image if other is None else other
    if align == "slanted":
        return float(align_slanted(image, other, point, start, HALF, iterations, 1e-4, 0.8)[2][0])
    A = np.eye(3)[None].copy()
    return float(align_patches(image, other, point, start, A, HALF, iterations, 1e-4)[1][0])


def one_step(max_slope: float, tolerance_px: float) -> tuple[Array, float]:
    """Return position, slopes and the score of a search that may end after its first step."""
    left = texture(1)
    right = np.ascontiguousarray(0.5 * left + 0.15 * texture(11))
    positions, slopes, score = align_slanted(
        left, right, POINTS[:1], POINTS[:1] + 0.3, HALF, 0, tolerance_px, max_slope
    )
    return np.concatenate([positions[0], slopes[0]]), float(score[0])


def test_a_slope_beyond_the_largest_ends_the_search_without_a_score() -> None:
    state, score = one_step(10.0, 10.0)
    assert score > 0.0
    steepest = float(np.abs(state[2:]).max())
    for max_slope, is_found in ((steepest * (1.0 + 1e-9), True), (steepest * (1.0 - 1e-9), False)):
        stopped, score = one_step(max_slope, 10.0)
        assert (score > 0.0) == is_found
        np.testing.assert_allclose(stopped, state, atol=1e-12)


def test_convergence_needs_a_short_step_and_a_small_change_of_the_slope() -> None:
    """The change of the slope, at the border of the patch, may be four times the tolerance."""
    left = texture(1)
    right = np.ascontiguousarray(0.5 * left + 0.15 * texture(11))
    length_px, slope_px = step_and_slope(left, right)
    tolerance = max(length_px, slope_px / 4.0)
    assert one_step(10.0, tolerance * (1.0 + 1e-6))[1] > 0.0
    assert one_step(10.0, tolerance * (1.0 - 1e-6))[1] == -1.0


def step_and_slope(left: Array, right: Array) -> tuple[float, float]:
    """Return the length of the first step, pixels, and the change of the slope times half the patch."""
    S = step_between(*slanted(left, right, POINTS[0], POINTS[0] + 0.3, 1))
    return float(np.hypot(S[0, 2], S[1, 2])), HALF * float(abs(S[0, 0] - 1.0) + abs(S[0, 1]))


EMPTY: list[Callable[[Array], Array]] = [
    lambda image: align_patches(
        image, image, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 3, 3)), 2, 5, 0.1
    )[1],
    lambda image: align_slanted(image, image, np.zeros((0, 2)), np.zeros((0, 2)), 2, 5, 0.1, 0.8)[2],
]


@pytest.mark.parametrize("align", EMPTY)
def test_without_points_there_are_no_scores(align: Callable[[Array], Array]) -> None:
    assert align(texture(1)).shape == (0,)
