# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Levelling by the mean specific force, which points up at rest."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.gravity_levelling.interface import Inputs, Interface, Outputs

_LEAST_FORCE_M_S2 = 0.05
#: Number of readings below which their standard deviation does not distinguish rest from motion.
_MIN_SAMPLES = 10


class MeanSpecificForceConfig(DfnConfig):
    """Parameters of MeanSpecificForce."""

    rest_rate_rad_s: float = Field(
        0.01, gt=0, le=1, description="Largest standard deviation and mean of the rates at rest"
    )
    rest_force_m_s2: float = Field(
        0.06, gt=0, le=10, description="Largest standard deviation of the specific force at rest"
    )
    acc_bias_sigma_m_s2: float = Field(
        0.01, ge=0, le=1, description="Standard deviation of the accelerometer bias"
    )
    moving_sigma_rad: float = Field(
        0.05, gt=0, le=1, description="Standard deviation of roll and pitch in motion"
    )


class MeanSpecificForce(Interface[MeanSpecificForceConfig]):
    """Direction of the mean force; a moving body is levelled with a larger standard deviation."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return roll and pitch of the body.

        Raises
        ------
        RefusedError
            On too few readings.
        DegenerateGeometryError
            If the mean force is nearly zero or along the body's x axis.
        """
        force, rates, c = inputs.specific_force, inputs.rates_rad_s, self.config
        if len(force) < _MIN_SAMPLES:
            raise RefusedError(
                f"{len(force)} readings, expected {_MIN_SAMPLES}", reasons=[f"few_samples:{len(force)}"]
            )
        mean = force.mean(axis=0)
        magnitude = float(np.linalg.norm(mean))
        if magnitude < _LEAST_FORCE_M_S2:
            raise DegenerateGeometryError(
                f"mean force {magnitude:.3g} m/s^2 shows no gravity", ["roll", "pitch"]
            )
        at_rest = bool(
            np.all(force.std(axis=0) < c.rest_force_m_s2)
            and np.all(rates.std(axis=0) < c.rest_rate_rad_s)
            and np.all(np.abs(rates.mean(axis=0)) < c.rest_rate_rad_s)
        )
        R = _level(mean / magnitude)
        sigma = c.moving_sigma_rad
        if at_rest:
            spread = float(np.mean(force.var(axis=0))) / len(force)
            sigma = float(np.sqrt(c.acc_bias_sigma_m_s2**2 + spread)) / magnitude
        bias = rates.mean(axis=0) if at_rest else np.zeros(3)
        return Outputs(
            rotation=R,
            covariance=np.diag([sigma**2, sigma**2, 0.0]),
            gyro_bias_rad_s=bias,
            at_rest=at_rest,
        )


def _level(up: FloatArray) -> FloatArray:
    """Return ``R_level_body`` with third row ``up``, the first in the plane of up and the body's x axis."""
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    length = float(np.linalg.norm(ahead))
    if length < 1e-3:
        raise DegenerateGeometryError("gravity lies along the body's x axis", ["heading"])
    ahead /= length
    return np.stack([ahead, np.cross(up, ahead), up])
