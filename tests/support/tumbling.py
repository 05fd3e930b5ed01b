# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated poses of a body that rotates without torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.rigid_body.torque_free import TorqueFreeBody

MOMENTS = (0.6, 0.8, 1.0)
RATE_RAD_S = float(np.deg2rad(0.7))


@dataclass(frozen=True)
class MovingBody:
    """Body whose centre of mass moves at a constant velocity."""

    rotation: TorqueFreeBody
    centre_m: FloatArray
    velocity_m_s: FloatArray

    @classmethod
    def drawn(cls, seed: int, *, is_tumbling: bool = True) -> MovingBody:
        """Return a body with random axes, rotation and centre; not tumbling: it rotates about an axis."""
        rng = np.random.default_rng(seed)
        axes = se3.exp_so3(rng.normal(size=3))
        rate = RATE_RAD_S * (axes @ [0.4, 0.5, 0.77] if is_tumbling else axes[:, 2])
        rotation = TorqueFreeBody((axes * np.array(MOMENTS)) @ axes.T, rate, se3.exp_so3(rng.normal(size=3)))
        return cls(rotation, rng.normal(size=3) * 0.2, rng.normal(size=3) * 0.002)

    def poses(self, t_s: FloatArray) -> FloatArray:
        """Return ``T_reference_body`` (n, 4, 4)."""
        R = self.rotation.orientations(t_s)
        return se3.transform(R, np.outer(t_s, self.velocity_m_s) - R @ self.centre_m)

    def velocities(self, t_s: FloatArray) -> FloatArray:
        """Return velocity of the origin and rate (n, 6) in the reference frame."""
        R = self.rotation.orientations(t_s)
        rates = (R @ self.rotation.rates(t_s)[:, :, None])[:, :, 0]
        return np.concatenate([self.velocity_m_s - np.cross(rates, R @ self.centre_m), rates], axis=1)

    def measured(
        self, t_s: FloatArray, sigma_m: float, sigma_rad: float, seed: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return noisy poses (n, 4, 4) and their covariances (n, 6, 6)."""
        rng = np.random.default_rng(seed)
        T = self.poses(t_s)
        R = se3.exp_so3(rng.normal(size=(len(t_s), 3)) * sigma_rad) @ T[:, :3, :3]
        poses = se3.transform(R, T[:, :3, 3] + rng.normal(size=(len(t_s), 3)) * sigma_m)
        covariance = np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3)
        return poses, np.repeat(covariance[None], len(t_s), axis=0)
