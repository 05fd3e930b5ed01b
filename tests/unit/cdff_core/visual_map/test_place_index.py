# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.visual_map.place_index import GrowingPlaceIndex, PlaceIndex


def places(count: int = 12) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 255, (80, 16)).astype(np.uint8) for _ in range(count)]


def test_the_keyframe_with_the_same_descriptors_and_noise_is_first() -> None:
    keyframes = places()
    index = PlaceIndex(keyframes, clusters=8, seed=0)
    for i, rows in enumerate(keyframes):
        noisy = np.clip(rows[:60] + np.random.default_rng(i).normal(0, 8, (60, 16)), 0, 255)
        assert index.nearest(noisy.astype(np.uint8), 3)[0] == i


def test_an_image_without_descriptors_is_similar_to_nothing() -> None:
    assert not len(PlaceIndex(places(), clusters=8, seed=0).nearest(np.zeros((0, 16), np.uint8), 3))


def test_an_empty_map_has_no_similar_keyframes() -> None:
    index = PlaceIndex([np.zeros((0, 0), np.uint8)], clusters=8, seed=0)
    assert not len(index.nearest(places()[0], 3))


def test_a_growing_index_finds_the_keyframe_before_and_after_its_clusters_are_made_again() -> None:
    index, keyframes = GrowingPlaceIndex(clusters=8, seed=0), places(20)
    assert not index.nearest(keyframes[0], 3)
    for key, rows in enumerate(keyframes):
        index.insert(key, rows)
        assert index.nearest(rows[:60], 1) == [key]
    assert index.nearest(keyframes[0], 1, {0}) != [0]
    index.remove(0)
    assert 0 not in index
    assert 0 not in index.nearest(keyframes[0], 30)
