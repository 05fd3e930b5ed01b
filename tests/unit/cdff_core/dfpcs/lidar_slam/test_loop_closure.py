# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LoopCloser: which keyframes are compared with a completed one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.lidar_slam.configuration import LoopGates
from cdff_core.dfpcs.lidar_slam.loop_closure import LoopCloser
from tests.unit.cdff_core.dfpcs.lidar_slam.test_keyframe_map import KeyframeMap, square


def compared(
    keyframes: KeyframeMap, key: int, excluded: set[int], monkeypatch: pytest.MonkeyPatch, **gates: float
) -> list[int]:
    """Return the keyframes that are compared with ``key`` because they are near; none is a loop."""
    dfpc = Registry.default().make_dfpc("lidar_slam")
    dfpc.configure()
    closer: Any = LoopCloser(dfpc, LoopGates(**gates))
    olds: list[int] = []

    def record(keyframes: KeyframeMap, old: int, key: int, guess: np.ndarray, lengths_m: Any) -> None:
        np.testing.assert_allclose(keyframes.poses[old] @ guess, keyframes.poses[key], atol=1e-9)
        olds.append(old)

    monkeypatch.setattr(closer, "verify", record)
    monkeypatch.setattr(closer, "_similar", lambda *_: [])
    assert list(closer.close(keyframes, key, excluded)) == []
    return olds


@pytest.fixture
def keyframes(rng: np.random.Generator) -> KeyframeMap:
    """Sixteen completed keyframes, 5 m from each other, around a square: the last one is near the first."""
    keyframes, _ = square(rng)
    for key, keyframe in keyframes.keyframes.items():
        keyframes.keyframes[key] = replace(keyframe, descriptor=np.ones(4, np.float32))
    return keyframes


def test_the_nearest_keyframes_within_the_radius_are_compared(
    keyframes: KeyframeMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    gates = {"search_radius_m": 8.0, "max_loop_candidates": 4}
    assert sorted(compared(keyframes, 15, {14, 13}, monkeypatch, **gates)) == [0, 1]
    assert compared(keyframes, 15, {14, 13}, monkeypatch, **gates | {"max_loop_candidates": 1}) == [0]
    assert compared(keyframes, 15, {14, 13}, monkeypatch, **gates | {"search_radius_m": 1.0}) == []


def test_keyframes_that_are_not_completed_are_not_compared(
    keyframes: KeyframeMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    keyframes.keyframes[0] = replace(keyframes.keyframes[0], descriptor=None)
    assert compared(keyframes, 15, {14, 13}, monkeypatch, search_radius_m=8.0) == [1]
