# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Levelling by the mean specific force, which points upwards at rest."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.gravity_levelling.interface import Inputs, Interface, Outputs

#: Least specific force that has a direction: far below lunar gravity, above the bias of an accelerometer.
_MIN_FORCE_M_S2 = 0.05
#: Number of readings below which their standard deviation does not distinguish rest from motion.
_MIN_SAMPLES = 10


class MeanSpecificForceConfig(DfnConfig):
    """Parameters of MeanSpecificForce."""

    rest_rate_rad_s: float = Field(
        0.01,
        gt=0,
        le=1,
        description="Upper bound at rest of the standard deviation and of the mean of each rate",
    )
    rest_force_m_s2: float = Field(
        0.06,
        gt=0,
        le=10,
        description="Upper bound at rest of the standard deviation of each component of the specific force",
    )
    acc_bias_sigma_m_s2: float = Field(
        0.01, ge=0, le=1, description="Standard deviation of the accelerometer bias"
    )
    moving_sigma_rad: float = Field(
        0.05, gt=0, le=1, description="Standard deviation of roll and pitch in motion"
    )


class MeanSpecificForce(Interface[MeanSpecificForceConfig]):
    """Levelling by the direction of the mean force, with a larger standard deviation for a moving body."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the rotation to the level frame, and the gyroscope bias at rest.

        Raises
        ------
        RefusedError
            If there are fewer than 10 readings.
        DegenerateGeometryError
            If the mean force is nearly zero or along the body's x axis.
        """
        force, rates, cfg = inputs.specific_force, inputs.rates_rad_s, self.config
        if len(force) < _MIN_SAMPLES:
            raise RefusedError(
                f"{len(force)} readings, expected at least {_MIN_SAMPLES}",
                reasons=[f"few_samples:{len(force)}"],
            )
        mean = force.mean(axis=0)
        magnitude = float(np.linalg.norm(mean))
        if magnitude < _MIN_FORCE_M_S2:
            raise DegenerateGeometryError(
                f"mean force {magnitude:.3g} m/s^2: expected gravity, at least {_MIN_FORCE_M_S2} m/s^2",
                ["roll", "pitch"],
            )
        at_rest = bool(
            np.all(force.std(axis=0) < cfg.rest_force_m_s2)
            and np.all(rates.std(axis=0) < cfg.rest_rate_rad_s)
            and np.all(np.abs(rates.mean(axis=0)) < cfg.rest_rate_rad_s)
        )
        R = _level_rotation(mean / magnitude)
        sigma = cfg.moving_sigma_rad
        if at_rest:
            mean_variance = float(np.mean(force.var(axis=0))) / len(force)
            sigma = float(np.sqrt(cfg.acc_bias_sigma_m_s2**2 + mean_variance)) / magnitude
        bias = rates.mean(axis=0) if at_rest else np.zeros(3)
        return Outputs(
            rotation=R,
            covariance=np.diag([sigma**2, sigma**2, 0.0]),
            gyro_bias_rad_s=bias,
            at_rest=at_rest,
        )


def _level_rotation(up: FloatArray) -> FloatArray:
    """Return ``R_level_body``; x of the level frame is the horizontal projection of the body's x axis.

    ``up`` is the unit vector against gravity in the axes of the body.
    """
    x_level = np.array([1.0, 0.0, 0.0]) - up[0] * up
    x_length = float(np.linalg.norm(x_level))
    if x_length < 1e-3:
        raise DegenerateGeometryError("gravity lies along the body's x axis", ["heading"])
    x_level /= x_length
    return np.stack([x_level, np.cross(up, x_level), up])
