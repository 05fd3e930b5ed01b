# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a sensor relative to keyframes, so that later loop closures correct them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.covariance import compose_covariance, rotate_covariance
from cdff_core.keyframe_graph.graph import KeyframeGraph

Float = NDArray[np.float64]

#: Maximum number of poses; beyond it every second pose of the older half is removed.
_CAPACITY = 20_000


class Trajectory:
    """Trajectory of a sensor: for each stamp the keyframe and ``T_keyframe_sensor``."""

    def __init__(self, capacity: int = _CAPACITY) -> None:
        self._capacity = capacity
        self._stamps_ns: list[int] = []
        self._keys: list[int] = []
        self._poses: list[Float] = []
        self._covariances: list[Float] = []

    def __len__(self) -> int:
        return len(self._stamps_ns)

    @property
    def last_ns(self) -> int:
        """Stamp of the newest pose; -1 without one."""
        return self._stamps_ns[-1] if self._stamps_ns else -1

    def is_localised(self, keyframes: KeyframeGraph[Any]) -> bool:
        """Return whether any pose belongs to a keyframe connected with the root."""
        return not keyframes.component(keyframes.root).isdisjoint(self._keys)

    def append(self, stamp_ns: int, key: int, T_keyframe_sensor: UncertainTransform) -> None:
        """Append the newest pose; above the capacity, first remove every second pose of the older half."""
        assert T_keyframe_sensor.covariance is not None  # every increment has one
        if len(self) >= self._capacity:
            half = len(self) // 2
            for column in (self._stamps_ns, self._keys, self._poses, self._covariances):
                del column[1:half:2]
        self._stamps_ns.append(stamp_ns)
        self._keys.append(key)
        self._poses.append(np.array(T_keyframe_sensor.matrix))
        self._covariances.append(np.array(T_keyframe_sensor.covariance))

    def move(self, key: int, new_key: int, T_new_key: Float) -> None:
        """Express the poses relative to one keyframe relative to another, by ``T_new_key`` (4, 4)."""
        for i, keyframe in enumerate(self._keys):
            if keyframe == key:
                self._keys[i], self._poses[i] = new_key, T_new_key @ self._poses[i]
                self._covariances[i] = rotate_covariance(self._covariances[i], T_new_key[:3, :3])

    def in_map(
        self, keyframes: KeyframeGraph[Any], t0_ns: int, t1_ns: int
    ) -> tuple[NDArray[np.int64], Float, Float]:
        """Return stamps (n,), poses (n, 4, 4) and covariances (n, 6, 6) in the map frame.

        Only poses from ``t0_ns`` to ``t1_ns`` (negative: unbounded), relative to keyframes connected with the
        root, are returned.
        """
        connected_keys = keyframes.component(keyframes.root)
        rows = [
            i
            for i, (t, key) in enumerate(zip(self._stamps_ns, self._keys, strict=True))
            if (t0_ns < 0 or t >= t0_ns) and (t1_ns < 0 or t <= t1_ns) and key in connected_keys
        ]
        stamps = np.array([self._stamps_ns[i] for i in rows], dtype=np.int64)
        if not rows:
            return stamps, np.zeros((0, 4, 4)), np.zeros((0, 6, 6))
        keys = [self._keys[i] for i in rows]
        T_keyframe = np.array([keyframes.poses[k] for k in keys])
        T_relative = np.array([self._poses[i] for i in rows])
        covariance = compose_covariance(
            T_keyframe,
            np.array([keyframes.covariances[k] for k in keys]),
            T_relative,
            np.array([self._covariances[i] for i in rows]),
        )
        return stamps, T_keyframe @ T_relative, covariance
