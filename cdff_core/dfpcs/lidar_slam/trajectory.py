# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the lidar was, relative to the key frames, so that loops that close later correct it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform, se3
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
        self._covariances: list[Float] = []

    def __len__(self) -> int:
        return len(self._stamps_ns)

    @property
    def last_ns(self) -> int:
        """Stamp of the newest pose; -1 where there is none."""
        return self._stamps_ns[-1] if self._stamps_ns else -1

    def is_placed(self, places: KeyFrameMap) -> bool:
        """Whether a pose lies at a key frame that is linked with the first."""
        return not places.part(places.root).isdisjoint(self._keys)

    def append(self, stamp_ns: int, key: int, T_key_lidar: UncertainTransform) -> None:
        """Add the newest pose."""
        assert T_key_lidar.covariance is not None  # every increment has one
        if len(self) >= self._history:
            half = len(self) // 2
            for column in (self._stamps_ns, self._keys, self._poses, self._covariances):
                del column[1:half:2]
        self._stamps_ns.append(stamp_ns)
        self._keys.append(key)
        self._poses.append(np.array(T_key_lidar.matrix))
        self._covariances.append(np.array(T_key_lidar.covariance))

    def move(self, key: int, into: int, T_into_key: Float) -> None:
        """Express the poses at one key frame at another."""
        for i, at in enumerate(self._keys):
            if at == key:
                self._keys[i], self._poses[i] = into, T_into_key @ self._poses[i]
                B = np.kron(np.eye(2), T_into_key[:3, :3])
                self._covariances[i] = B @ self._covariances[i] @ B.T

    def placed(self, places: KeyFrameMap, t0_ns: int, t1_ns: int) -> tuple[NDArray[np.int64], Float, Float]:
        """Stamps (n,), poses in the frame of the map (n, 4, 4) and covariances (n, 6, 6).

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
        T_key, T_rel = np.array([places.poses[k] for k in keys]), np.array([self._poses[i] for i in rows])
        # As compose_covariance, for all at once: a turn of the key frame moves what lies at the end of the lever.
        J = np.tile(np.eye(6), (len(rows), 1, 1))
        lever = np.einsum("nij,nj->ni", T_key[:, :3, :3], T_rel[:, :3, 3])
        J[:, :3, 3:] = -np.array([se3.skew(v) for v in lever])
        B = np.zeros((len(rows), 6, 6))
        B[:, :3, :3] = B[:, 3:, 3:] = T_key[:, :3, :3]
        covariance = J @ np.array([places.covariances[k] for k in keys]) @ np.swapaxes(J, 1, 2)
        covariance += B @ np.array([self._covariances[i] for i in rows]) @ np.swapaxes(B, 1, 2)
        return stamps, T_key @ T_rel, 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
