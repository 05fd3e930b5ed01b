# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled, deterministic maximum clique of a graph of pairs on bit sets."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray, IntArray

Bits = NDArray[np.uint64]

_ONE = np.uint64(1)
_GREEDY_IN_VAIN = 10


@njit(cache=True)
def consistency(
    source: FloatArray, target: FloatArray, tolerance: float, least: float
) -> tuple[Bits, IntArray]:  # pragma: no cover
    """Return the graph of pairs with consistent distances: adjacency as bits (n, words), and degrees (n,).

    Two pairs closer than ``least`` in either cloud do not support each other.
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
            if abs(s - t) <= tolerance and min(s, t) > least:
                bits[i, j >> 6] |= _ONE << np.uint64(j & 63)
                bits[j, i >> 6] |= _ONE << np.uint64(i & 63)
                degree[i] += 1
                degree[j] += 1
    return bits, degree


@njit(cache=True)
def has(words: Bits, i: int) -> bool:  # pragma: no cover - compiled
    """Return whether bit ``i`` is set."""
    return bool((words[i >> 6] >> np.uint64(i & 63)) & _ONE != np.uint64(0))


@njit(cache=True)
def core_numbers(bits: Bits, degree: IntArray) -> tuple[IntArray, IntArray]:  # pragma: no cover - compiled
    """Return the core number of each vertex and the order in which vertices of least degree are removed.

    Batagelj, Zaversnik (2003), arXiv:cs/0310049.
    """
    n = len(degree)
    left, core, order = degree.copy(), np.zeros(n, np.int64), np.zeros(n, np.int64)
    gone = np.zeros(n, np.bool_)
    k = 0
    for step in range(n):
        v = -1
        for i in range(n):
            if not gone[i] and (v < 0 or left[i] < left[v]):
                v = i
        k = max(k, left[v])
        core[v], order[step], gone[v] = k, v, True
        for j in range(n):
            if not gone[j] and has(bits[v], j):
                left[j] -= 1
    return core, order


@njit(cache=True)
def maximum_clique(
    bits: Bits, degree: IntArray, max_work: int
) -> tuple[IntArray, bool]:  # pragma: no cover - compiled
    """Return the largest clique found, ascending, and whether it is proven to be maximum.

    Greedy cliques from the vertices of the highest cores first; then branch and bound over the later
    neighbours in the degeneracy order, bounded by core numbers and by greedy colouring (Rossi et al. 2015,
    doi:10.1137/14100018X; San Segundo et al. 2011, doi:10.1016/j.cor.2010.07.007).
    """
    n, words = bits.shape
    core, order = core_numbers(bits, degree)
    best = np.zeros(0, np.int64)
    in_vain = 0
    for step in range(n - 1, -1, -1):
        v = order[step]
        if core[v] < len(best):
            continue
        found = _greedy(bits, core, v)
        in_vain += 1
        if len(found) > len(best):
            best, in_vain = found, 0
        if in_vain > _GREEDY_IN_VAIN:
            break
    work = 0
    later = np.zeros(words, np.uint64)
    for step in range(n - 1, -1, -1):
        v = order[step]
        if core[v] >= len(best):
            candidates = later & bits[v]
            found, work = _search(bits, candidates, len(best) - 1, work, max_work)
            if len(found):
                best = np.empty(len(found) + 1, np.int64)
                best[0], best[1:] = v, found
            if work > max_work:
                return np.sort(best), False
        later[v >> 6] |= _ONE << np.uint64(v & 63)
    return np.sort(best), True


@njit(cache=True)
def _greedy(bits: Bits, core: IntArray, v: int) -> IntArray:  # pragma: no cover - compiled
    """Return a clique from ``v``, adding the candidate with the most candidates as neighbours each time."""
    n, words = bits.shape
    candidates = bits[v].copy()
    clique = np.empty(n, np.int64)
    clique[0], size = v, 1
    while True:
        chosen, most = -1, -1
        for w in range(words):
            rest = candidates[w]
            while rest:
                u = 64 * w + _trailing(rest)
                rest &= rest - _ONE
                shared = 0
                for x in range(words):
                    shared += _count(candidates[x] & bits[u, x])
                if shared > most:
                    chosen, most = u, shared
        if chosen < 0:
            return clique[:size].copy()
        clique[size] = chosen
        size += 1
        candidates &= bits[chosen]


@njit(cache=True)
def _search(
    bits: Bits, candidates: Bits, least: int, work: int, max_work: int
) -> tuple[IntArray, int]:  # pragma: no cover - compiled
    """Return the largest clique above ``least`` of candidates, else empty, and coloured vertices."""
    words = bits.shape[1]
    total = 0
    for w in range(words):
        total += _count(candidates[w])
    best = np.zeros(0, np.int64)
    if total <= least:
        return best, work
    # One level per vertex of the clique: its candidates, their order by colour, and the next one to try.
    sets = np.zeros((total + 1, words), np.uint64)
    vertex, colour = np.zeros((total + 1, total), np.int64), np.zeros((total + 1, total), np.int64)
    at = np.zeros(total + 1, np.int64)
    clique = np.zeros(total + 1, np.int64)
    size = max(least, 0)
    sets[0] = candidates
    at[0] = _coloured(bits, candidates, vertex[0], colour[0]) - 1
    work += total
    depth = 0
    while depth >= 0:
        i = at[depth]
        if i < 0 or depth + colour[depth, i] <= size:
            depth -= 1
            continue
        at[depth] -= 1
        if work > max_work:
            break
        v = vertex[depth, i]
        clique[depth] = v
        sets[depth, v >> 6] &= ~(_ONE << np.uint64(v & 63))
        below = sets[depth] & bits[v]
        count = _coloured(bits, below, vertex[depth + 1], colour[depth + 1])
        work += 1 + count
        if count == 0:
            if depth + 1 > size:
                size = depth + 1
                best = clique[:size].copy()
            continue
        sets[depth + 1] = below
        at[depth + 1] = count - 1
        depth += 1
    return best, work


@njit(cache=True)
def _coloured(
    bits: Bits, candidates: Bits, vertex: IntArray, colour: IntArray
) -> int:  # pragma: no cover - compiled
    """Order candidates by greedy colours: no clique of the first i is larger than ``colour[i]``."""
    words = len(candidates)
    left = candidates.copy()
    count, current = 0, 0
    while True:
        remaining = left.copy()
        is_any = False
        current += 1
        for w in range(words):
            while remaining[w]:
                is_any = True
                u = 64 * w + _trailing(remaining[w])
                left[w] &= ~(_ONE << np.uint64(u & 63))
                remaining[w] &= remaining[w] - _ONE
                for x in range(w, words):
                    remaining[x] &= ~bits[u, x]
                vertex[count], colour[count] = u, current
                count += 1
        if not is_any:
            return count


@njit(cache=True, inline="always")
def _count(x: np.uint64) -> int:  # pragma: no cover - compiled
    """Return the number of bits set in a word."""
    x -= (x >> np.uint64(1)) & np.uint64(0x5555555555555555)
    x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
    x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((x * np.uint64(0x0101010101010101)) >> np.uint64(56))  # type: ignore[return-value]


@njit(cache=True, inline="always")
def _trailing(x: np.uint64) -> int:  # pragma: no cover - compiled
    """Return the position of the lowest bit set."""
    return _count((x & (~x + _ONE)) - _ONE)
