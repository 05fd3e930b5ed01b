# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled, deterministic search of the maximum clique in a graph of point pairs, on bit sets.

A set of vertices is an array of 64-bit words: vertex i is bit ``i & 63`` of word ``i >> 6``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray, IntArray

Bits = NDArray[np.uint64]

_ONE = np.uint64(1)
#: Greedy cliques that may fail to improve the best one before the greedy search ends.
_MAX_GREEDY_FAILURES = 10


@njit(cache=True)
def consistency_graph(
    source: FloatArray, target: FloatArray, tolerance: float, min_distance: float
) -> tuple[Bits, IntArray]:  # pragma: no cover
    """Return the graph of consistent pairs: adjacency as bit sets (n, words), and degrees (n,).

    Two pairs are consistent if the distance between their points differs by at most ``tolerance`` between
    both clouds and is above ``min_distance`` in both.
    """
    n = len(source)
    bits = np.zeros((n, (n + 63) // 64), np.uint64)
    degree = np.zeros(n, np.int64)
    for i in range(n):
        for j in range(i):
            s = t = 0.0
            for c in range(3):
                s += (source[i, c] - source[j, c]) ** 2
                t += (target[i, c] - target[j, c]) ** 2
            s, t = np.sqrt(s), np.sqrt(t)
            if abs(s - t) <= tolerance and min(s, t) > min_distance:
                bits[i, j >> 6] |= _ONE << np.uint64(j & 63)
                bits[j, i >> 6] |= _ONE << np.uint64(i & 63)
                degree[i] += 1
                degree[j] += 1
    return bits, degree


@njit(cache=True)
def has_bit(words: Bits, i: int) -> bool:  # pragma: no cover - compiled
    """Return whether a bit set contains vertex ``i``."""
    return bool((words[i >> 6] >> np.uint64(i & 63)) & _ONE != np.uint64(0))


@njit(cache=True)
def core_numbers(bits: Bits, degree: IntArray) -> tuple[IntArray, IntArray]:  # pragma: no cover - compiled
    """Return the core number of each vertex, and the order in which the vertex of least degree is removed.

    Batagelj, Zaversnik (2003), arXiv:cs/0310049.
    """
    n = len(degree)
    remaining_degree, core, order = degree.copy(), np.zeros(n, np.int64), np.zeros(n, np.int64)
    is_removed = np.zeros(n, np.bool_)
    k = 0
    for step in range(n):
        v = -1
        for i in range(n):
            if not is_removed[i] and (v < 0 or remaining_degree[i] < remaining_degree[v]):
                v = i
        k = max(k, remaining_degree[v])
        core[v], order[step], is_removed[v] = k, v, True
        for j in range(n):
            if not is_removed[j] and has_bit(bits[v], j):
                remaining_degree[j] -= 1
    return core, order


@njit(cache=True)
def maximum_clique(
    bits: Bits, degree: IntArray, max_work: int
) -> tuple[IntArray, bool]:  # pragma: no cover - compiled
    """Return the vertices of the largest clique found, ascending, and whether it is proven to be maximum.

    Greedy cliques are built from the vertices with the highest core numbers first. Branch and bound follows,
    for each vertex over its later neighbours in the degeneracy order, with core numbers and greedy colouring
    as bounds (Rossi et al. 2015, doi:10.1137/14100018X; San Segundo et al. 2011,
    doi:10.1016/j.cor.2010.07.007). It ends when more than ``max_work`` vertices have been coloured.
    """
    n, words = bits.shape
    core, order = core_numbers(bits, degree)
    best = np.zeros(0, np.int64)
    greedy_failures = 0
    for step in range(n - 1, -1, -1):
        v = order[step]
        if core[v] < len(best):
            continue
        clique = _greedy_clique(bits, core, v)
        greedy_failures += 1
        if len(clique) > len(best):
            best, greedy_failures = clique, 0
        if greedy_failures > _MAX_GREEDY_FAILURES:
            break
    work = 0
    later = np.zeros(words, np.uint64)
    for step in range(n - 1, -1, -1):
        v = order[step]
        if core[v] >= len(best):
            candidates = later & bits[v]
            clique, work = _search(bits, candidates, len(best) - 1, work, max_work)
            if len(clique):
                best = np.empty(len(clique) + 1, np.int64)
                best[0], best[1:] = v, clique
            if work > max_work:
                return np.sort(best), False
        later[v >> 6] |= _ONE << np.uint64(v & 63)
    return np.sort(best), True


@njit(cache=True)
def _greedy_clique(bits: Bits, core: IntArray, v: int) -> IntArray:  # pragma: no cover - compiled
    """Return a clique that contains ``v``.

    Each step adds the candidate that is adjacent to most other candidates.
    """
    n, words = bits.shape
    candidates = bits[v].copy()
    clique = np.empty(n, np.int64)
    clique[0], size = v, 1
    while True:
        next_vertex, most_common = -1, -1
        for w in range(words):
            unvisited = candidates[w]
            while unvisited:
                u = 64 * w + _lowest_bit(unvisited)
                unvisited &= unvisited - _ONE
                common = 0
                for x in range(words):
                    common += _bit_count(candidates[x] & bits[u, x])
                if common > most_common:
                    next_vertex, most_common = u, common
        if next_vertex < 0:
            return clique[:size].copy()
        clique[size] = next_vertex
        size += 1
        candidates &= bits[next_vertex]


@njit(cache=True)
def _search(
    bits: Bits, candidates: Bits, lower_bound: int, work: int, max_work: int
) -> tuple[IntArray, int]:  # pragma: no cover - compiled
    """Return the largest clique of candidates if it has more than ``lower_bound`` vertices, else an empty
    one.

    Also returns ``work`` plus the number of coloured vertices.
    """
    words = bits.shape[1]
    candidate_count = 0
    for w in range(words):
        candidate_count += _bit_count(candidates[w])
    best = np.zeros(0, np.int64)
    if candidate_count <= lower_bound:
        return best, work
    # For each depth, the number of vertices in the clique: the candidates, their order by colour, and the
    # index of the next one to try.
    sets = np.zeros((candidate_count + 1, words), np.uint64)
    vertex, colour = (
        np.zeros((candidate_count + 1, candidate_count), np.int64),
        np.zeros((candidate_count + 1, candidate_count), np.int64),
    )
    next_index = np.zeros(candidate_count + 1, np.int64)
    clique = np.zeros(candidate_count + 1, np.int64)
    size = max(lower_bound, 0)
    sets[0] = candidates
    next_index[0] = _colour(bits, candidates, vertex[0], colour[0]) - 1
    work += candidate_count
    depth = 0
    while depth >= 0:
        i = next_index[depth]
        if i < 0 or depth + colour[depth, i] <= size:
            depth -= 1
            continue
        next_index[depth] -= 1
        if work > max_work:
            break
        v = vertex[depth, i]
        clique[depth] = v
        sets[depth, v >> 6] &= ~(_ONE << np.uint64(v & 63))
        next_candidates = sets[depth] & bits[v]
        count = _colour(bits, next_candidates, vertex[depth + 1], colour[depth + 1])
        work += 1 + count
        if count == 0:
            if depth + 1 > size:
                size = depth + 1
                best = clique[:size].copy()
            continue
        sets[depth + 1] = next_candidates
        next_index[depth + 1] = count - 1
        depth += 1
    return best, work


@njit(cache=True)
def _colour(
    bits: Bits, candidates: Bits, vertex: IntArray, colour: IntArray
) -> int:  # pragma: no cover - compiled
    """Order candidates by greedy colours and return their number.

    Writes ``vertex`` and ``colour``, so that no clique of ``vertex[:i + 1]`` has more than ``colour[i]``
    vertices.
    """
    words = len(candidates)
    uncoloured = candidates.copy()
    count, current = 0, 0
    while True:
        colourable = uncoloured.copy()
        is_colour_used = False
        current += 1
        for w in range(words):
            while colourable[w]:
                is_colour_used = True
                u = 64 * w + _lowest_bit(colourable[w])
                uncoloured[w] &= ~(_ONE << np.uint64(u & 63))
                colourable[w] &= colourable[w] - _ONE
                for x in range(w, words):
                    colourable[x] &= ~bits[u, x]
                vertex[count], colour[count] = u, current
                count += 1
        if not is_colour_used:
            return count


@njit(cache=True, inline="always")
def _bit_count(x: np.uint64) -> int:  # pragma: no cover - compiled
    """Return the number of bits set in a word."""
    x -= (x >> np.uint64(1)) & np.uint64(0x5555555555555555)
    x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
    x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))  # type: ignore[return-value]


@njit(cache=True, inline="always")
def _lowest_bit(x: np.uint64) -> int:  # pragma: no cover - compiled
    """Return the position of the lowest bit set."""
    return _bit_count((x & (~x + _ONE)) - _ONE)
