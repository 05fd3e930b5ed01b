# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A small version of the shipped scenario ``outing``: 24 m of terrain and a lidar with few points."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_dev.missions.driven_log import GrowingLog
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.world import World, cast_scene, make_world


def tiny_scenario() -> Scenario:
    """Return the scenario ``outing`` on 24 m of terrain, with 16 rings of 128 points, for 4 s."""
    full = load_scenario("outing").model_dump()
    full["duration_s"] = 4.0
    full["terrain"] |= {"fine_half_width_m": 12.0, "far_half_width_m": 30.0}
    full["terrain"]["craters"] |= {"count": 4, "half_width_m": 12.0}
    full["terrain"]["rocks"] |= {"count": 10, "half_width_m": 11.0}
    full["lidar"] |= {"rings": 16, "columns": 128}
    full["robots"]["mana"] |= {"rest_before_s": 0.5, "rest_after_s": 0.5, "ramp_s": 0.5}
    return Scenario.model_validate(full)


@pytest.fixture(scope="session")
def world() -> World:
    """The world of the tiny scenario."""
    return make_world(tiny_scenario())


@pytest.fixture(scope="session")
def camera_world() -> World:
    """The world of the tiny scenario with a camera of 64 x 48 pixels."""
    fields = tiny_scenario().model_dump()
    camera_scenario = load_scenario("camera_outing")
    assert camera_scenario.navcam is not None
    assert camera_scenario.terrain.surface is not None
    fields["navcam"] = camera_scenario.navcam.model_dump() | {
        "rows": 48,
        "columns": 64,
        "focal_px": 48.0,
        "rate_hz": 2.0,
    }
    fields["terrain"]["surface"] = camera_scenario.terrain.surface.model_dump() | {"texel_m": 0.1}
    return make_world(Scenario.model_validate(fields))


@pytest.fixture(scope="session")
def scene(world: World) -> Any:
    """Terrain and rocks of the tiny scenario, for ray casting."""
    return cast_scene(world.relief, world.rocks)


@pytest.fixture(scope="session")
def smoothed_relief(world: World) -> Relief:
    """The terrain of the tiny scenario, smoothed over the size of a wheel."""
    return world.relief.smoothed(0.5)


@pytest.fixture
def growing_log(world: World) -> GrowingLog:
    """A simulated log of the tiny scenario at its start, without a writer for the ground truth."""
    return GrowingLog(world, None)
