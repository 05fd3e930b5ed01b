# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of random numbers of a scenario in orbit: a change of one sensor does not affect the others."""

from __future__ import annotations

import zlib

import numpy as np

from cdff_dev.simulate.orbit.scenario import OrbitScenario

#: Streams; the numbers are different from those of scenarios on terrain.
STREAMS = {
    "attitude": 100,
    "pointing": 101,
    "detector": 102,
    "image": 103,
    "lidar_unit": 104,
    "scan": 105,
    "star_tracker": 106,
    "imu": 107,
    "gnss": 108,
    "thrust": 109,
}


def generator(scenario: OrbitScenario, stream: str, *indices: int) -> np.random.Generator:
    """Return the random number generator of one stream and its indices, independent of all others."""
    return np.random.default_rng([scenario.seed, STREAMS[stream], *indices])


def number_of(name: str) -> int:
    """Return a number for the name of a sensor, which does not depend on the other sensors."""
    return zlib.crc32(name.encode())
