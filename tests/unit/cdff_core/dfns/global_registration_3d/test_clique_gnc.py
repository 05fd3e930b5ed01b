# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CliqueGnc: the transform on which the few correct pairs agree."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.robust import graduated_fit
from cdff_core.dfns.global_registration_3d._clique import consistency_graph, core_numbers, maximum_clique
from cdff_core.dfns.global_registration_3d.clique_gnc import CliqueGnc, _refit
from cdff_core.dfns.global_registration_3d.interface import (
    GlobalRegistration3DInputs,
    GlobalRegistration3DOutputs,
)

NOISE_M = 0.03


def solve(source: np.ndarray, target: np.ndarray, **config: object) -> GlobalRegistration3DOutputs:
    node = CliqueGnc()
    node.configure({"noise_m": NOISE_M, **config})
    return node.process(GlobalRegistration3DInputs(source=source, target=target))


def pairs(seed: int, wrong: float, n: int = 1000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points in a cube of 2 m, their transforms with 1 cm noise, and the transform.

    The fraction ``wrong`` of the pairs has a random partner in the same cube.
    """
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (n, 3))
    T = se3.exp_se3(rng.normal(size=6))
    target = se3.transform_points(T, source) + np.clip(rng.normal(0, 0.01, (n, 3)), -NOISE_M, NOISE_M)
    outliers = round(wrong * n)
    target[:outliers] = se3.transform_points(T, rng.uniform(-1, 1, (outliers, 3)))
    return source, target, T


def graph(n: int, edges: set[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    bits, degree = np.zeros((n, (n + 63) // 64), np.uint64), np.zeros(n, np.int64)
    for i, j in edges:
        for a, b in ((i, j), (j, i)):
            bits[a, b >> 6] |= np.uint64(1) << np.uint64(b & 63)
            degree[a] += 1
    return bits, degree


@pytest.mark.slow
def test_ninety_eight_percent_of_outliers_are_rejected() -> None:
    correct = 0
    for seed in range(100):
        source, target, T = pairs(seed, 0.98)
        error = se3.log_se3(se3.inverse(T) @ solve(source, target).transform)
        correct += bool(np.linalg.norm(error[:3]) < 0.05 and np.linalg.norm(error[3:]) < 0.05)
    assert correct >= 99


def test_inliers_are_returned_and_chance_agreement_is_excluded() -> None:
    source, target, _ = pairs(1, 0.95)
    out = solve(source, target)
    assert np.count_nonzero(out.inliers[950:]) >= 48
    assert np.count_nonzero(out.inliers[:950]) <= 1
    assert out.clique_size >= 45
    assert out.expected_by_chance < 1e-20


@pytest.mark.parametrize("wrong", [0.0, 0.01, 0.5])
def test_pairs_that_are_mostly_correct_are_not_attributed_to_chance(wrong: float) -> None:
    source, target, _ = pairs(6, wrong)
    assert solve(source, target).expected_by_chance < 1e-20


def test_neighbours_of_correct_points_are_not_attributed_to_chance(rng: np.random.Generator) -> None:
    source, target, _ = pairs(7, 0.0, 300)
    half = len(source) // 2
    # Wrong by 2 noises: no inliers, but their distances to most correct pairs are consistent.
    target[:half] += 2.0 * NOISE_M * np.sign(rng.normal(size=(half, 3))) / np.sqrt(3.0)
    out = solve(source, target)
    assert np.count_nonzero(out.inliers) < 0.6 * len(source)
    assert out.expected_by_chance < 1e-20


def test_few_agreeing_pairs_among_many_are_attributed_to_chance() -> None:
    source, target, _ = pairs(8, 0.96, 100)
    out = solve(source, target, least_inliers=3)
    assert out.clique_size == 4
    assert out.expected_by_chance > 1e-3


def test_mostly_correct_pairs_give_the_least_squares_solution() -> None:
    source, target, T = pairs(2, 0.1)
    error = se3.log_se3(se3.inverse(T) @ solve(source, target).transform)
    assert np.linalg.norm(error) < 0.003


def test_the_same_pairs_give_the_same_result_bit_for_bit() -> None:
    source, target, _ = pairs(3, 0.9)
    assert np.array_equal(solve(source, target).transform, solve(source, target).transform)


def test_random_pairs_are_refused() -> None:
    source, target, _ = pairs(4, 1.0, 100)
    with pytest.raises(RefusedError) as refused:
        solve(source, target, least_inliers=8)
    assert refused.value.reasons[0].startswith("too_few_consistent")


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_pairs_are_refused_with_their_number(count: int) -> None:
    points = np.eye(3)[:count]
    with pytest.raises(RefusedError, match=f"{count} of {count} pairs agree") as refused:
        solve(points, points, least_inliers=3)
    assert refused.value.reasons == (f"too_few_consistent:{count}<3",)


def test_collinear_pairs_are_refused_as_degenerate(rng: np.random.Generator) -> None:
    line = np.c_[rng.uniform(0, 10, 30), np.zeros((30, 2))]
    with pytest.raises(DegenerateGeometryError) as refused:
        solve(line, line + np.array([1.0, 2.0, 3.0]))
    assert refused.value.reasons == ("degenerate:collinear",)


def test_inconsistent_pairs_are_refused() -> None:
    with pytest.raises(InputError, match="n=5 of source"):
        solve(np.zeros((5, 3)), np.zeros((6, 3)))


def test_graduated_non_convexity_finds_inliers_that_least_squares_misses() -> None:
    source, target, T = pairs(5, 0.3, 200)
    error = se3.log_se3(se3.inverse(T) @ graduated_fit(source, target, NOISE_M)[0])
    assert np.linalg.norm(error) < 0.02


@pytest.mark.parametrize("seed", range(5))
def test_the_clique_is_the_maximum_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 70
    edges = {(i, j) for i, j in combinations(range(n), 2) if rng.random() < 0.35}
    result, proven = maximum_clique(*graph(n, edges), 10_000_000)
    assert proven
    assert all((int(i), int(j)) in edges for i, j in combinations(result, 2))
    neighbours = {v: {b if a == v else a for a, b in edges if v in (a, b)} for v in range(n)}
    assert len(result) == _largest(set(range(n)), neighbours, 0)


def _largest(candidates: set[int], neighbours: dict[int, set[int]], best: int) -> int:
    """Return the size of the largest clique by an exhaustive search with pruning."""
    size = 0
    while candidates and len(candidates) > max(best, size):
        v = candidates.pop()
        size = max(size, 1 + _largest(candidates & neighbours[v], neighbours, max(best, size) - 1))
    return size


def test_core_numbers_of_a_triangle_with_a_tail() -> None:
    core, order = core_numbers(*graph(5, {(0, 1), (1, 2), (0, 2), (2, 3), (3, 4)}))
    assert core.tolist() == [2, 2, 2, 1, 1]
    assert order[0] == 4


def test_pairs_of_points_too_close_together_are_not_counted_as_consistent() -> None:
    points = np.array([[0.0, 0, 0], [0.01, 0, 0], [1.0, 0, 0]])
    _, degree = consistency_graph(points, points, 0.02, 0.05)
    assert degree.tolist() == [1, 1, 2]


def test_pairs_that_agree_on_another_transform_nearby_are_attributed_to_chance() -> None:
    source, target, _ = pairs(9, 0.0, 200)
    # No neighbours of correct pairs, from which they differ by more than 3 noises.
    target[:80] += np.array([4.5 * NOISE_M, 0.0, 0.0])
    out = solve(source, target)
    assert not out.inliers[:80].any()
    assert out.expected_by_chance > 1.0


@pytest.mark.parametrize(("max_work", "is_proven"), [(100, False), (1000, True)])
def test_a_search_ends_when_more_than_its_work_has_been_coloured(max_work: int, is_proven: bool) -> None:
    edges = {(i, j) for i in range(20) for j in range(20, 40)}  # each neighbour is coloured once: 400
    result, proven = maximum_clique(*graph(40, edges), max_work)
    assert proven == is_proven
    assert len(result) == 2


def test_three_pairs_within_the_noise_are_refitted() -> None:
    source = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    near = se3.transform(np.eye(3), np.array([0.01, -0.01, 0.005]))
    T, inliers = _refit(near, source, source, NOISE_M)
    np.testing.assert_allclose(T, np.eye(4), atol=1e-12)
    assert inliers.tolist() == [True, True, True]
    two = source + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    T, inliers = _refit(near, source, two, NOISE_M)
    np.testing.assert_array_equal(T, near)
    assert not inliers.any()
