# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Odometry of the lidar: each sweep on the map of the surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import NS_PER_S
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import LidarScan, PoseTrajectory
from cdff_core.dfns.point_cloud_deskewing._interface import PointCloudDeskewingInputs
from cdff_core.dfns.scan_to_map_registration._interface import (
    ScanToMapRegistrationInputs,
    ScanToMapRegistrationOutputs,
)
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.wheels import Wheels

Float = NDArray[np.float64]

_LEAST_POINTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One sweep on the map of the surroundings.

    Attributes
    ----------
    T_odom_lidar : ndarray, shape (4, 4)
        At the end of the sweep.
    increment : UncertainTransform
        ``T_before_now`` since the sweep before, with what adds up from sweep to sweep.
    noise : ndarray, shape (6, 6)
        Of this pose alone, in axes of the lidar; it does not add up, since the next sweep is placed on the map anew.
    points_m : ndarray, shape (n, 3)
        In the lidar's frame at the end of the sweep.
    registration : ScanToMapRegistrationOutputs or None
        None for the first sweep, and where the map did not hold the sweep.
    lost : bool
        The map did not hold the sweep: the pose is the guess.
    by_odometry : bool
        The motion was guessed by the odometry port.
    """

    T_odom_lidar: Float
    increment: UncertainTransform
    noise: Float
    points_m: Float
    registration: ScanToMapRegistrationOutputs | None
    lost: bool
    by_odometry: bool


class Tracker:
    """Guess the motion, register, deskew, extend the map.

    Parameters
    ----------
    config : LidarSlamConfig
    deskewing, registration : Dfn
    wheels : Wheels
        The odometry, kept up to now.
    """

    def __init__(
        self,
        config: LidarSlamConfig,
        deskewing: Dfn[Any, Any, Any],
        registration: Dfn[Any, Any, Any],
        wheels: Wheels,
    ) -> None:
        self._config, self._deskewing, self._registration = config, deskewing, registration
        self.wheels = wheels
        self._T = np.eye(4)
        self._stamp_ns: int | None = None
        self._velocity = np.zeros(6)  # of the lidar in its own axes, per second
        self._held = 0  # sweeps in a row that the ground did not hold in all directions
        self._way_m = 0.0  # since the map of the surroundings was begun
        self._surface: Float | None = None

    @property
    def T_odom_lidar(self) -> Float:
        """Pose at the newest sweep, (4, 4)."""
        return self._T

    def begin_at(self, T_odom_lidar: Float, surface: Float) -> None:
        """Begin at a pose within surroundings that are known, points in the odometry's frame."""
        self._T, self._surface = T_odom_lidar.copy(), surface
        self._way_m = self._config.settling_m

    def take_odometry(self, stamp_ns: int, T_odom_base: UncertainTransform) -> None:
        """Keep a pose of the odometry."""
        self.wheels.take(stamp_ns, T_odom_base)

    def track(self, scan: LidarScan) -> Tracked:
        """Register a sweep; raises InputError where it has no points."""
        points, fraction = self._usable(scan)
        first = self._stamp_ns is None and self._surface is None
        wheels = self.wheels.since_last_sweep(scan.t1_ns)
        if self._stamp_ns is None and (driven := self.wheels.velocity(scan.t1_ns)) is not None:
            self._velocity = driven  # a rover may drive when the first sweep is taken
        span_s = 0.1 if self._stamp_ns is None else max((scan.t1_ns - self._stamp_ns) / NS_PER_S, 1e-3)
        guess, guess_covariance = self._guess(wheels, span_s)
        T_before = self._T
        registration: ScanToMapRegistrationOutputs | None = None
        velocity = self._velocity if wheels is None else _twist(wheels) / span_s
        sweep = se3.inverse(_motion(velocity * (scan.t1_ns - scan.t0_ns) / NS_PER_S))
        if not first:
            try:
                share = None if self._stamp_ns is None else min(1.0, (scan.t1_ns - scan.t0_ns) / NS_PER_S / span_s)
                registration = self._register(points, fraction, T_before @ guess, sweep, guess_covariance, share)
            except RefusedError:
                registration = None
        else:
            self._registration.process(ScanToMapRegistrationInputs())
        lost = not first and (registration is None or float(registration.inlier_ratio) < self._config.lost_inlier_ratio)
        if registration is not None and not lost:
            self._T, sweep = np.array(registration.transform), registration.sweep
        elif not first:
            self._T = T_before @ guess
        self._T[:3, :3] = se3.normalise_rotation(self._T[:3, :3])
        still = self._deskewed(points, fraction, sweep)
        self._surface = se3.transform_points(self._T, still)
        increment = se3.inverse(T_before) @ self._T
        if self._stamp_ns is not None:
            self._velocity = _twist(increment) / span_s
        self._stamp_ns = scan.t1_ns
        way_m = float(np.linalg.norm(increment[:3, 3]))
        self._way_m += way_m
        drift, noise = np.zeros((6, 6)), np.zeros((6, 6))
        if not first:
            kept = registration if registration is not None and not lost else None
            drift, noise = self._spread(kept, guess_covariance, way_m)
        return Tracked(
            self._T.copy(),
            UncertainTransform(increment, _turned(drift, T_before[:3, :3].T)),
            _turned(noise, self._T[:3, :3].T),
            still,
            registration,
            lost,
            wheels is not None,
        )

    def _spread(self, found: ScanToMapRegistrationOutputs | None, guess: Float, way_m: float) -> tuple[Float, Float]:
        """What adds up to the covariance by a sweep, and what is of its pose alone, in axes of the odometry's frame.

        What the ground holds has the registration's covariance times ``noise_share`` and a floor, and drifts by
        ``drift_share`` of it a metre. What it does not hold adds the guess's, which is wrong by the same share from
        sweep to sweep: its sigma grows with the way, not with its root. A map of sweeps from one place holds the next
        ones poorly: both are larger until the way settles it.
        """
        c = self._config
        if found is None:
            free = np.eye(6)
            covariance = np.zeros((6, 6))
        else:
            scale = np.concatenate([np.ones(3), np.full(3, max(float(found.radius_m), 1e-6))])
            weak = found.directions[found.sigma_m > c.weak_sigma_m]
            free = (weak.T @ weak) * scale[None, :] / scale[:, None]
            floor = np.square([c.noise_floor_m] * 3 + [c.noise_floor_rad] * 3)
            covariance = c.noise_share * found.covariance + np.diag(floor)
        held = np.eye(6) - free
        noise = held @ covariance @ held.T
        young = max(0.0, 1.0 - self._way_m / c.settling_m)
        share = c.drift_share + (c.settling_drift if young > 0.0 else 0.0)
        drift = share * way_m * noise + (2 * self._held + 1) * (free @ guess @ free.T)
        noise = (1.0 + c.settling_noise * young**2) * noise
        self._held = self._held + 1 if np.any(free) else 0
        return drift, noise

    def _usable(self, scan: LidarScan) -> tuple[Float, Float]:
        """Points within range, and when in the sweep: -1 at its begin, 0 at its end."""
        points = np.asarray(scan.points_m, dtype=np.float64)
        range2 = np.einsum("ij,ij->i", points, points)
        kept = (range2 > self._config.min_range_m**2) & (range2 < self._config.max_range_m**2)  # NaN is neither
        length_us = (scan.t1_ns - scan.t0_ns) / 1000.0
        if length_us <= 0.0:
            return points[kept], np.zeros(int(kept.sum()))
        fraction = np.asarray(scan.time_offset_us, dtype=np.float64)[kept] / length_us - 1.0
        return points[kept], np.minimum(fraction, 0.0)

    def _guess(self, wheels: Float | None, span_s: float) -> tuple[Float, Float]:
        """Motion since the sweep before, and its covariance in axes of the odometry's frame."""
        c = self._config
        turn = np.full(3, c.guess_sigma_rad**2)
        if wheels is None:
            step, shift = _motion(self._velocity * span_s), np.full(3, c.guess_sigma_m**2)
        else:
            step = wheels
            way_m = float(np.linalg.norm(wheels[:3, 3]))
            shift = np.full(3, c.wheels_sigma_m**2 + (c.wheels_share * way_m) ** 2)
            turn[2] = c.wheels_yaw_sigma_rad**2
        return step, _turned(np.diag(np.concatenate([shift, turn])), self._T[:3, :3])

    def _register(
        self, points: Float, fraction: Float, guess: Float, sweep: Float, covariance: Float, share: float | None
    ) -> ScanToMapRegistrationOutputs:
        c = self._config
        guess = se3.transform(se3.normalise_rotation(guess[:3, :3]), guess[:3, 3])
        sigma = np.array([c.sweep_sigma_m] * 3 + [c.sweep_sigma_rad] * 3)
        found: ScanToMapRegistrationOutputs = self._registration.process(
            ScanToMapRegistrationInputs(
                surface=self._surface,
                points=points,
                fraction=fraction,
                guess=guess,
                sweep_guess=sweep,
                guess_covariance=covariance,
                sweep_covariance=np.diag(sigma**2),
                before=None if share is None else self._T,
                sweep_share=None if share is None else np.array(share),
            )
        )
        return found

    def _deskewed(self, points: Float, fraction: Float, sweep: Float) -> Float:
        """Points in the lidar's frame at the end of the sweep."""
        ends = np.array([se3.transform(se3.normalise_rotation(sweep[:3, :3]), sweep[:3, 3]), np.eye(4)])
        stamps = np.array([0, NS_PER_S])  # the sweep's length as one second
        track = PoseTrajectory.from_arrays(stamps, ends, None, parent="end", child="lidar")
        when = np.clip(np.round((fraction + 1.0) * NS_PER_S), 0, NS_PER_S).astype(np.int64)
        moved: Float = self._deskewing.process(PointCloudDeskewingInputs(points, when, track)).points
        return moved


def _motion(twist: Float) -> Float:
    """Translation and rotation vector as a transform."""
    return se3.transform(se3.exp_so3(twist[3:]), twist[:3])


def _twist(T: Float) -> Float:
    """Inverse of ``_motion``."""
    return np.concatenate([T[:3, 3], se3.log_so3(T[:3, :3])])


def _turned(covariance: Float, R: Float) -> Float:
    """A covariance of shift and turn in other axes."""
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = R
    return np.asarray(A @ covariance @ A.T)
