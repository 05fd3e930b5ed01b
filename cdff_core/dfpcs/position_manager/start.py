# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The first estimate: place and heading from anchor and wheels, roll and pitch against gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.gravity_levelling._interface import GravityLevellingInputs
from cdff_core.dfpcs.position_manager.buffers import ImuBuffer
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import FORCE, LINE, ROTATION, Estimate
from cdff_core.dfpcs.position_manager.estimator import first_estimate


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where the time line begins.

    Attributes
    ----------
    T_odom_base : UncertainTransform
    gravity_m_s2 : float or None
        Its strength; None where it was not felt.
    reasons : tuple of str
        What the start lacks.
    """

    estimate: Estimate
    T_odom_base: UncertainTransform
    gravity_m_s2: float | None
    reasons: tuple[str, ...]


def begin(
    stamp_ns: int,
    anchor: UncertainTransform,
    wheels: UncertainTransform,
    imu: ImuBuffer,
    levelling: Dfn[Any, Any, Any],
    config: PositionManagerConfig,
) -> Start:
    """The start at a time; ``anchor`` is ``T_site_odom``, ``wheels`` what the wheels count from there."""
    forces, rates = imu.all()
    reasons: tuple[str, ...] = ()
    tilt, sigma, gravity, at_rest = np.eye(3), config.start_tilt_sigma_rad, None, False
    bias = np.zeros(6)
    try:
        level = levelling.process(GravityLevellingInputs(forces, rates))
    except (RefusedError, DegenerateGeometryError) as error:
        reasons = ("not_levelled", *error.reasons)
    else:
        tilt, at_rest = level.rotation, bool(level.at_rest)
        gravity = float(np.linalg.norm(forces.mean(axis=0)))
        sigma = float(np.sqrt(level.covariance[0, 0]))
        bias[:3] = level.gyro_bias_rad_s
        reasons = () if at_rest else ("levelled_in_motion",)
    ahead = wheels.matrix[:3, 0]
    turn = se3.exp_so3([0.0, 0.0, float(np.arctan2(ahead[1], ahead[0]))])
    covariance = np.zeros((6, 6)) if wheels.covariance is None else wheels.covariance.copy()
    covariance[3:5, :] = covariance[:, 3:5] = 0.0
    R = turn @ tilt
    held = _heading_held(R)
    covariance[3:, 3:] += sigma**2 * held @ held.T
    T_odom_base = UncertainTransform(se3.transform(R, wheels.matrix[:3, 3]), covariance)
    felt = config.felt_bias_sigma_rad_s if at_rest else config.gyro_bias_sigma_rad_s
    biases = np.array([felt] * 3 + [config.acc_bias_sigma_m_s2] * 3)
    in_motion = config.unknown_speed_sigma_m_s if gravity is None else config.start_speed_sigma_m_s
    speed = config.rest_speed_sigma_m_s if at_rest else in_motion
    estimate = first_estimate(stamp_ns, anchor @ T_odom_base, speed, biases, np.array(config.slip_sigma))
    estimate = replace(estimate, biases=bias)
    if gravity is not None and at_rest:
        estimate = _leaning(estimate, gravity, config.acc_bias_sigma_m_s2)
    return Start(estimate, T_odom_base, gravity, reasons)


def _heading_held(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation error ``(3, 3)`` that an error of the tilt (x, y, unused) makes where the heading is known.

    The heading is that of the base's x axis a. If a climbs, an error w about its horizontal part moves a sideways, and
    only a turn about z keeps the heading: ``w_z = a_z (w_x a_x + w_y a_y) / (a_x^2 + a_y^2)``.
    """
    ahead = R[:, 0]
    held = np.diag([1.0, 1.0, 0.0])
    held[2, :2] = ahead[2] * ahead[:2] / float(ahead[:2] @ ahead[:2])
    return held


def _leaning(estimate: Estimate, gravity_m_s2: float, sigma_m_s2: float) -> Estimate:
    """With the tilt's error hanging on the accelerometer's bias, which it came from.

    What is taken for gravity is ``R^T g + b``: a bias b leans the base by ``(-b_y, b_x, 0) / g`` in level axes, and by
    what holds the heading about z. Its part along gravity went into the strength of gravity, and is known as far as
    that is used.
    """
    R = estimate.pose[:3, :3]
    level = np.diag([sigma_m_s2**2, sigma_m_s2**2, (0.1 * sigma_m_s2) ** 2])
    lean = _heading_held(R) @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / gravity_m_s2
    P = estimate.covariance.copy()
    P[FORCE, FORCE] = R.T @ level @ R
    P[ROTATION, FORCE] = lean @ level @ R
    P[FORCE, ROTATION] = P[ROTATION, FORCE].T
    return replace(estimate, covariance=P, since=P[:, LINE].copy())
