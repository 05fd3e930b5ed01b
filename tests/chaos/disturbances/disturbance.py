# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A disturbance, and the scene on which it acts."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from tests.chaos.mission import Mission
from tests.chaos.oracle import Oracle


@dataclass(frozen=True, slots=True)
class Scene:
    """Mission, oracle and random numbers of a disturbance."""

    mission: Mission
    oracle: Oracle
    rng: random.Random


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A disturbance: ``run`` begins it, waits for the alarms that it must raise, and ends it.

    Attributes
    ----------
    name : str
    run : callable
    longest_s : float
        Usual duration with the recovery; it is not started later than that before the end of a run.
    is_possible : callable
        False where this machine does not permit it.
    """

    name: str
    run: Callable[[Scene], None]
    longest_s: float
    is_possible: Callable[[Mission], bool] = lambda _: True
