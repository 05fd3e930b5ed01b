# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A small and short version of the shipped scenario ``rover_traverse``, simulated in seconds."""

from __future__ import annotations

import pytest

from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.world import World, make_world


def tiny_scenario(seed: int = 3) -> Scenario:
    """Return one second of the shipped scenario, with small images, few beams and coarse terrain."""
    full = load_scenario("rover_traverse", seed).model_dump()
    full["duration_s"] = 1.0
    full["navcam"] |= {"rows": 96, "columns": 128, "focal_px": 96.0}
    full["lidar"] |= {"rings": 8, "columns": 120}
    full["terrain"] |= {"fine_half_width_m": 12.8, "resolution_m": 0.1, "far_half_width_m": 80.0}
    full["terrain"]["surface"] |= {"texel_m": 0.1}
    full["terrain"]["rocks"] |= {"count": 120, "half_width_m": 12.0}
    for drive in full["robots"].values():
        drive |= {"rest_before_s": 0.1, "rest_after_s": 0.1, "ramp_s": 0.3}
    return Scenario.model_validate(full)


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """The tiny scenario."""
    return tiny_scenario()


@pytest.fixture(scope="session")
def world(scenario: Scenario) -> World:
    """The world of the tiny scenario."""
    return make_world(scenario)
