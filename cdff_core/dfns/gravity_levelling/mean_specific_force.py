# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MeanSpecificForce: at rest the mean specific force points up."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.gravity_levelling._interface import (
    GravityLevellingInputs,
    GravityLevellingInterface,
    GravityLevellingOutputs,
)

_LEAST_FORCE_M_S2 = 0.05


class MeanSpecificForceConfig(DfnConfig):
    """Parameters of MeanSpecificForce."""

    min_samples: Annotated[int, Field(ge=1, le=100_000)] = 10
    rest_rate_rad_s: Annotated[float, Field(gt=0, le=1, description="rad/s")] = 0.01
    rest_force_m_s2: Annotated[float, Field(gt=0, le=10, description="m/s^2")] = 0.06
    acc_bias_sigma_m_s2: Annotated[float, Field(ge=0, le=1, description="m/s^2")] = 0.01
    moving_sigma_rad: Annotated[float, Field(gt=0, le=1, description="rad")] = 0.05


class MeanSpecificForce(GravityLevellingInterface):
    """Direction of the mean force; a body that moves is levelled too, with the larger sigma that says so."""

    Config = MeanSpecificForceConfig
    config: MeanSpecificForceConfig

    def process(self, inputs: GravityLevellingInputs) -> GravityLevellingOutputs:
        """Level the body.

        Raises
        ------
        InputError
            On arrays that are not (n, 3) and equally long.
        RefusedError
            On too few readings.
        DegenerateGeometryError
            If the mean force is nearly zero or along the body's x axis.
        """
        force, rates, c = inputs.specific_force, inputs.rates_rad_s, self.config
        if force.ndim != 2 or force.shape[1] != 3 or force.shape != rates.shape or not np.isfinite(force).all():
            raise InputError(f"specific_force {force.shape}, rates {rates.shape}: expected finite (n, 3), equally many")
        if len(force) < c.min_samples:
            raise RefusedError(
                f"{len(force)} readings, expected {c.min_samples}", reasons=[f"few_samples:{len(force)}"]
            )
        mean = force.mean(axis=0)
        magnitude = float(np.linalg.norm(mean))
        if magnitude < _LEAST_FORCE_M_S2:
            raise DegenerateGeometryError(f"mean force {magnitude:.3g} m/s^2 shows no gravity", ["roll", "pitch"])
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
        return GravityLevellingOutputs(R, np.diag([sigma**2, sigma**2, 0.0]), bias, np.asarray(at_rest))


def _level(up: FloatArray) -> FloatArray:
    """``R_level_body`` whose third row is ``up`` and whose first lies in the plane of up and the body's x."""
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    length = float(np.linalg.norm(ahead))
    if length < 1e-3:
        raise DegenerateGeometryError("gravity lies along the body's x axis", ["heading"])
    ahead /= length
    return np.stack([ahead, np.cross(up, ahead), up])
