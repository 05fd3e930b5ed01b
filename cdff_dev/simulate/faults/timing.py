# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of stamps and lost samples of a sensor."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from cdff_common.interfaces.dfn import StrictModel


class Clock(StrictModel):
    """Errors of the clock that stamps the samples of a sensor, and lost samples.

    The stamp is the true time, plus an offset, a drift from the start on, and jitter. Samples are lost in
    bursts: a channel with two states loses all samples in one of them. The stamps stay in order.

    Source: Gilbert (1960), Capacity of a burst-noise channel, doi:10.1002/j.1538-7305.1960.tb03959.x; the
    drift is the frequency error of the oscillator.
    """

    offset_s: Annotated[float, Field(ge=-1, le=1, description="stamp minus true time, s")] = 0.0
    drift_ppm: Annotated[float, Field(ge=-1000, le=1000, description="growth of the offset, µs/s")] = 0.0
    jitter_s: Annotated[float, Field(ge=0, le=1, description="standard deviation of each stamp, s")] = 0.0
    loss: Annotated[float, Field(ge=0, lt=1, description="fraction of the samples that are lost")] = 0.0
    burst: Annotated[float, Field(ge=1, description="mean number of successive samples lost together")] = 1.0

    @model_validator(mode="after")
    def _check_bursts(self) -> Clock:
        if self.loss / self.burst > 1.0 - self.loss:
            raise ValueError(
                f"loss {self.loss} with bursts of {self.burst} samples: expected at most "
                "burst / (1 + burst); use longer bursts"
            )
        return self


class Timing(StrictModel):
    """Clock of each sensor; a sensor without a clock has true stamps and loses no samples."""

    navcam: Clock | None = None
    lidar: Clock | None = None
    imu: Clock | None = None
    wheels: Clock | None = None


def stamps(
    clock: Clock, t_us: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the stamps ``(n,)`` of samples at times ``(n,)``, microseconds, and whether each one arrives."""
    error_us = 1e6 * clock.offset_s + 1e-6 * clock.drift_ppm * t_us
    error_us = error_us + 1e6 * clock.jitter_s * rng.standard_normal(len(t_us))
    stamped = t_us + np.round(error_us).astype(np.int64)
    order = np.arange(len(t_us))  # each stamp is at least 1 us after the previous one
    return np.maximum.accumulate(stamped - order) + order, _arrives(clock, len(t_us), rng)


def _arrives(clock: Clock, n: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return whether each of ``n`` samples arrives: a Markov chain with the stationary loss of the clock."""
    draws = rng.random(n)
    end = 1.0 / clock.burst
    start = end * clock.loss / (1.0 - clock.loss)
    is_lost, state = np.zeros(n, dtype=bool), False
    for i, draw in enumerate(draws):
        state = draw >= end if state else draw < start
        is_lost[i] = state
    return ~is_lost
