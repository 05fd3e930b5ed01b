# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the lidar was, relative to the key frames, so that loops that close later correct it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyFrameMap

Float = NDArray[np.float64]


class Trajectory:
    """Stamps with key frame and ``T_key_lidar``; beyond ``history`` every other of the older half goes.

    Parameters
    ----------
    history : int
        Poses kept at most.
    """

    def __init__(self, history: int) -> None:
        self._history = history
        self._stamps_ns: list[int] = []
        self._keys: list[int] = []
        self._poses: list[Float] = []

    def __len__(self) -> int:
        return len(self._stamps_ns)

    @property
    def last_ns(self) -> int:
        """Stamp of the newest pose; -1 where there is none."""
        return self._stamps_ns[-1] if self._stamps_ns else -1

    def append(self, stamp_ns: int, key: int, T_key_lidar: Float) -> None:
        """Add the newest pose."""
        if len(self) >= self._history:
            half = len(self) // 2
            for column in (self._stamps_ns, self._keys, self._poses):
                del column[1:half:2]
        self._stamps_ns.append(stamp_ns)
        self._keys.append(key)
        self._poses.append(np.array(T_key_lidar))

    def move(self, key: int, into: int, T_into_key: Float) -> None:
        """Express the poses at one key frame at another."""
        for i, at in enumerate(self._keys):
            if at == key:
                self._keys[i], self._poses[i] = into, T_into_key @ self._poses[i]

    def placed(self, places: KeyFrameMap, t0_ns: int, t1_ns: int) -> tuple[NDArray[np.int64], Float, Float]:
        """Stamps (n,), poses in the frame of the map (n, 4, 4) and covariances of their key frames (n, 6, 6).

        Between two times, where these are not below 0, and only at key frames linked with the first.
        """
        linked = places.part(places.root)
        rows = [
            i
            for i, (t, key) in enumerate(zip(self._stamps_ns, self._keys, strict=True))
            if (t0_ns < 0 or t >= t0_ns) and (t1_ns < 0 or t <= t1_ns) and key in linked
        ]
        stamps = np.array([self._stamps_ns[i] for i in rows], dtype=np.int64)
        if not rows:
            return stamps, np.zeros((0, 4, 4)), np.zeros((0, 6, 6))
        keys = [self._keys[i] for i in rows]
        poses = np.array([places.poses[k] for k in keys]) @ np.array([self._poses[i] for i in rows])
        return stamps, poses, np.array([places.covariances[k] for k in keys])
