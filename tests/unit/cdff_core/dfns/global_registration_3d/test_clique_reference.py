# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency graphs, core numbers and cliques agree with exhaustive computations on small graphs."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from cdff_common.arrays import BoolArray
from cdff_core.dfns.global_registration_3d._clique import (
    Bits,
    _bit_count,
    _colour,
    _greedy_clique,
    _lowest_bit,
    _search,
    consistency_graph,
    core_numbers,
    has_bit,
    maximum_clique,
)


def random_adjacency(rng: np.random.Generator, n: int, density: float) -> BoolArray:
    upper = np.triu(rng.random((n, n)) < density, 1)
    return np.asarray(upper | upper.T)


def as_bits(adjacency: BoolArray) -> Bits:
    """Return the rows of a mask as sets of vertices, by integers of Python."""
    words = (adjacency.shape[1] + 63) // 64
    out = np.zeros((len(adjacency), words), np.uint64)
    for i, row in enumerate(adjacency):
        number = sum(1 << int(j) for j in np.flatnonzero(row))
        out[i] = [(number >> (64 * w)) & (2**64 - 1) for w in range(words)]
    return out


def largest_subsets(adjacency: BoolArray) -> list[tuple[int, ...]]:
    """Return all cliques with the largest number of vertices, by trial of all subsets."""
    n = len(adjacency)
    for size in range(n, 0, -1):
        cliques = [
            s for s in combinations(range(n), size) if all(adjacency[i, j] for i, j in combinations(s, 2))
        ]
        if cliques:
            return cliques
    return [()]


def test_the_clique_is_one_of_the_largest_among_all_subsets() -> None:
    rng = np.random.default_rng(1)
    for n in (0, 1, 2, 3, 5, 8, 10):
        for density in (0.0, 0.3, 0.6, 0.85, 1.0):
            adjacency = random_adjacency(rng, n, density)
            result, is_proven = maximum_clique(as_bits(adjacency), adjacency.sum(axis=1), 10**6)
            assert is_proven
            assert tuple(result.tolist()) in largest_subsets(adjacency)


def test_the_search_alone_finds_a_largest_clique_if_it_exceeds_the_bound() -> None:
    rng = np.random.default_rng(2)
    for density in (0.3, 0.5, 0.7, 0.9):
        for _ in range(5):
            adjacency = random_adjacency(rng, 9, density)
            bits, everything = as_bits(adjacency), as_bits(np.ones((1, 9), np.bool_))[0]
            largest = largest_subsets(adjacency)
            size = len(largest[0])
            for bound in (-1, 0, size - 1):
                result, work = _search(bits, everything, bound, 7, 10**6)
                assert tuple(sorted(result.tolist())) in largest
                assert work >= 7 + 9
            assert len(_search(bits, everything, size, 0, 10**6)[0]) == 0


@pytest.mark.parametrize(("n", "density"), [(1, 0.0), (9, 0.3), (9, 0.9), (70, 0.5), (130, 0.8)])
def test_the_greedy_clique_adds_the_candidate_that_is_adjacent_to_most_others(n: int, density: float) -> None:
    adjacency = random_adjacency(np.random.default_rng(6), n, density)
    bits = as_bits(adjacency)
    for v in range(min(n, 9)):
        expected, candidates = [v], adjacency[v].copy()
        while candidates.any():
            common = np.where(candidates, adjacency[:, candidates].sum(axis=1), -1)
            expected.append(int(np.argmax(common)))  # the lowest one of equals
            candidates &= adjacency[expected[-1]]
        assert _greedy_clique(bits, np.zeros(n, np.int64), v).tolist() == expected


def test_few_candidates_are_not_coloured() -> None:
    bits, two = as_bits(~np.eye(4, dtype=np.bool_)), as_bits(np.array([[True, True, False, False]]))[0]
    result, work = _search(bits, two, 2, 5, 100)
    assert (len(result), work) == (0, 5)
    result, work = _search(bits, two, 1, 5, 100)
    # Two candidates, then the first vertex with one candidate left, then that one with none.
    assert (sorted(result.tolist()), work) == ([0, 1], 5 + 2 + 2 + 1)
    # The work is checked before each vertex, and a limit that is reached exactly does not end the search.
    assert len(_search(bits, two, 1, 5, 9)[0]) == 2
    assert len(_search(bits, two, 1, 5, 8)[0]) == 0


def test_colours_bound_the_cliques_of_each_prefix_and_classes_have_no_edges() -> None:
    rng = np.random.default_rng(3)
    for n in (6, 70):
        adjacency = random_adjacency(rng, n, 0.5)
        bits, is_candidate = as_bits(adjacency), rng.random(n) < 0.7
        vertex, colour = np.full(n, -1), np.full(n, -1)
        count = _colour(bits, as_bits(is_candidate[None])[0], vertex, colour)
        assert sorted(vertex[:count].tolist()) == np.flatnonzero(is_candidate).tolist()
        assert colour[0] == 1
        assert set(np.diff(colour[:count]).tolist()) <= {0, 1}
        for i, j in combinations(range(count), 2):
            assert colour[i] != colour[j] or not adjacency[vertex[i], vertex[j]]
        # Greedy: each vertex has an edge to every class before its own.
        for i in range(count):
            classes = {int(colour[j]) for j in range(i) if adjacency[vertex[i], vertex[j]]}
            assert set(range(1, colour[i])) <= classes


def test_core_numbers_are_those_of_the_definition() -> None:
    """The k-core is what remains when vertices with fewer than k remaining neighbours are removed."""
    rng = np.random.default_rng(4)
    for n, density in ((1, 0.0), (7, 0.5), (12, 0.3), (12, 0.8), (66, 0.1)):
        adjacency = random_adjacency(rng, n, density)
        expected = np.zeros(n, np.int64)
        for k in range(1, n):
            remaining = np.ones(n, np.bool_)
            while (weak := remaining & (adjacency[:, remaining].sum(axis=1) < k)).any():
                remaining &= ~weak
            expected[remaining] = k
        core, order = core_numbers(as_bits(adjacency), adjacency.sum(axis=1))
        np.testing.assert_array_equal(core, expected)
        assert sorted(order.tolist()) == list(range(n))
        for step, v in enumerate(order):  # always the vertex of least degree, the lowest one of equals
            rest = np.sort(order[step:])
            assert v == rest[np.argmin(adjacency[np.ix_(rest, rest)].sum(axis=1))]


def test_pairs_are_consistent_up_to_the_tolerance_and_beyond_the_minimum_distance() -> None:
    target = np.array([[0.0, 0, 0], [4.0, 0, 0], [0.0, 0, 0.5]])
    for shift, is_consistent in ((0.25, True), (-0.25, True), (0.2501, False), (-0.2501, False)):
        source = target + np.array([[0.0], [shift], [0.0]]) * [1.0, 0.0, 0.0]
        bits, degree = consistency_graph(source, target, 0.25, 0.5)
        assert has_bit(bits[0], 1) == has_bit(bits[1], 0) == is_consistent
        # Vertices 0 and 2 are at the minimum distance in both clouds.
        assert not has_bit(bits[0], 2)
        assert degree[0] == is_consistent
    near = target * np.array([[1.0], [1.0], [1.25]])
    for clouds in ((near, target), (target, near)):  # above the minimum distance in one cloud only
        assert not has_bit(consistency_graph(*clouds, 0.25, 0.5)[0][0], 2)
    assert has_bit(consistency_graph(near, near, 0.25, 0.5)[0][0], 2)


def test_the_consistency_graph_of_more_vertices_than_a_word_is_that_of_all_distances() -> None:
    rng = np.random.default_rng(5)
    source, target = rng.normal(size=(2, 130, 3))
    s, t = (np.linalg.norm(cloud[:, None] - cloud, axis=2) for cloud in (source, target))
    expected = (np.abs(s - t) <= 0.4) & (np.minimum(s, t) > 0.6)
    bits, degree = consistency_graph(source, target, 0.4, 0.6)
    np.testing.assert_array_equal(bits, as_bits(expected))
    np.testing.assert_array_equal(degree, expected.sum(axis=1))


@pytest.mark.parametrize("number", [1, 2, 3, 2**31, 2**32 + 6, 0x5555555555555555, 2**63, 2**64 - 1])
def test_bits_are_counted_and_located_in_words_of_64(number: int) -> None:
    assert _bit_count(np.uint64(number)) == number.bit_count()
    assert _lowest_bit(np.uint64(number)) == (number & -number).bit_length() - 1
    assert _bit_count(np.uint64(0)) == 0
