# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the odometry of a skid-steered rover: skid, slip, alternating increments and delay."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel


class SkidSteering(StrictModel):
    """A skid-steered rover: its wheels slide sideways in turns.

    The odometry multiplies the turn by the ratio of effective to stated track, and does not measure the
    sideways motion of the base, whose centre of rotation is not below it.

    Source: Martínez et al. (2005), Approximating kinematics for tracked mobile robots,
    doi:10.1177/0278364905058239 (instantaneous centres of rotation).
    """

    yaw_ratio: Annotated[float, Field(ge=0.2, le=3, description="measured by true turn, relative")] = 1.0
    centre_offset_m: Annotated[
        float, Field(ge=-1, le=1, description="x of the centre of rotation in the base, m")
    ] = 0.0


class SlipEpisodes(StrictModel):
    """Wheels that spin in loose ground: episodes at random places, with constant slip.

    Slip is the fraction of the wheel's rotation that does not move the rover.

    Source: Wong (2008), Theory of Ground Vehicles (definition of slip); the places are a Poisson process.
    """

    per_m: Annotated[float, Field(ge=0, description="mean number of episodes per metre, 1/m")] = 0.0
    length_m: Annotated[float, Field(gt=0, description="path length of an episode, m")] = 0.3
    slip: Annotated[float, Field(ge=0, lt=0.95, description="relative")] = 0.3


class WheelFaults(StrictModel):
    """Faults of wheel odometry.

    Source of alternation and delay: measured on a Clearpath Husky, ±17 % and 0.1 s
    (``docs/evaluation/position_manager.md``).
    """

    skid: SkidSteering | None = None
    slip: SlipEpisodes | None = None
    alternation: Annotated[
        float, Field(ge=0, lt=1, description="increments are alternately longer and shorter, relative")
    ] = 0.0
    delay_s: Annotated[float, Field(ge=0, le=2, description="age of a pose at its stamp, s")] = 0.0


def disturbed(
    faults: WheelFaults, dx: FloatArray, dy: FloatArray, dyaw: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the increments ``(n,)`` of odometry in base axes, metres and radians, with the faults."""
    if faults.slip is not None:
        dx = dx / (1.0 - faults.slip.slip * _in_episode(faults.slip, np.abs(dx), rng))
    if faults.skid is not None:
        # The base moves sideways by -centre_offset_m * dyaw, which the wheels do not measure.
        dy = dy + faults.skid.centre_offset_m * dyaw
        dyaw = faults.skid.yaw_ratio * dyaw
    return dx * (1.0 + faults.alternation * (-1.0) ** np.arange(len(dx))), dy, dyaw


def _in_episode(model: SlipEpisodes, distance_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the fraction 0 to 1 of each increment ``(n,)`` that lies in an episode of slip."""
    end = np.cumsum(distance_m)
    total = float(end[-1]) if len(end) else 0.0
    starts = np.sort(rng.uniform(0.0, total, rng.poisson(model.per_m * total)))
    inside = np.zeros(len(distance_m))
    for start in starts:
        inside += np.clip(
            np.minimum(end, start + model.length_m) - np.maximum(end - distance_m, start), 0.0, None
        )
    return np.asarray(np.clip(inside / np.maximum(distance_m, 1e-9), 0.0, 1.0))
