# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shipped scenarios in orbit contain what their names state."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError
from cdff_dev.simulate.orbit.camera_view import CameraRays
from cdff_dev.simulate.orbit.motion import OrbitMotion
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.orbit.world import OrbitWorld
from cdff_dev.simulate.scenario_files import load_any_scenario, read_scenario, scenario_names

IN_ORBIT = [name for name in scenario_names() if name.startswith(("orbit_", "asteroid_"))]
#: One variant of each motion, light and range; the others differ in the same sections.
BUILT = [
    name
    for name in IN_ORBIT
    if name != "asteroid_67p"
    and (
        "matrix" not in name
        or name.endswith(("linear_nominal_far", "spinning_over_mid", "tumbling_under_close"))
    )
]


def scenario(name: str) -> OrbitScenario:
    """Return a shipped scenario in orbit."""
    loaded = load_any_scenario(name)
    assert isinstance(loaded, OrbitScenario)
    return loaded


def distances_m(name: str) -> np.ndarray:
    """Return the distances of the servicer from the client, ten seconds apart."""
    s = scenario(name)
    return np.linalg.norm(OrbitMotion(s).servicer_offsets_m(np.arange(0.0, s.duration_s + 1.0, 10.0)), axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT)
def test_the_bodies_of_a_scenario_are_built_and_its_camera_sees_the_client(name: str) -> None:
    world = OrbitWorld(scenario(name))
    for camera in world.scenario.servicer.cameras.values():
        view = CameraRays(camera).render(world.placed(np.array([0.6 * world.scenario.duration_s])))
        assert (view.number == 1).any()


def test_the_matrix_has_a_scenario_for_each_motion_light_and_range() -> None:
    expected = {
        f"orbit_matrix_{motion}_{light}_{distance}"
        for motion, light, distance in itertools.product(
            ("linear", "spinning", "tumbling"), ("nominal", "under", "over"), ("far", "mid", "close")
        )
    }
    assert {name for name in IN_ORBIT if "matrix" in name} == expected
    rates = [
        scenario(f"orbit_matrix_{m}_nominal_mid").client.attitude.rate_deg_s
        for m in ("linear", "spinning", "tumbling")
    ]
    assert [np.count_nonzero(rate) for rate in rates] == [0, 1, 3]
    suns = [
        scenario(f"orbit_matrix_linear_{light}_mid").lighting.sun for light in ("over", "nominal", "under")
    ]
    phases = [sun.phase_deg for sun in suns if sun is not None]
    assert phases == sorted(phases)
    for distance, limit_m in (("far", 500.0), ("mid", 40.0), ("close", 10.0)):
        assert limit_m < distances_m(f"orbit_matrix_linear_nominal_{distance}").min() < 1.4 * limit_m


def test_a_file_with_variants_is_refused_with_their_names() -> None:
    with pytest.raises(ConfigurationError, match="orbit_matrix_tumbling_over_close"):
        read_scenario("orbit_matrix")


@pytest.mark.parametrize(
    ("name", "first_m", "last_m"),
    [
        ("orbit_approach", 30_000.0, 500.0),
        ("orbit_close_approach", 500.0, 20.0),
        ("orbit_docking", 12.0, 2.9),
    ],
)
def test_approaches_start_and_end_at_their_distances(name: str, first_m: float, last_m: float) -> None:
    distances = distances_m(name)
    np.testing.assert_allclose(distances[[0, -1]], [first_m, last_m], rtol=0.02)


def test_station_keeping_has_day_night_and_penumbra_and_the_dark_approach_has_no_sun() -> None:
    keeping, dark = scenario("orbit_station_keeping"), scenario("orbit_lidar_dark")
    motion = OrbitMotion(keeping)
    sunlit = np.array([motion.light(t).sunlit for t in np.arange(0.0, keeping.duration_s, 2.0)])
    assert (sunlit == 1.0).mean() > 0.3
    assert (sunlit == 0.0).mean() > 0.3
    assert ((sunlit > 0.0) & (sunlit < 1.0)).any()
    in_shadow = OrbitMotion(dark)
    assert max(in_shadow.light(t).sunlit for t in np.linspace(0.0, dark.duration_s, 9)) == 0.0
    assert not dark.servicer.cameras


def test_the_earth_is_behind_the_client_and_lit() -> None:
    shipped = scenario("orbit_earth_in_view")
    motion = OrbitMotion(shipped)
    light = motion.light(0.5 * shipped.duration_s)
    assert light.earth_m is not None
    up = light.earth_m / np.linalg.norm(light.earth_m)
    assert light.to_sun @ up > 0.3
    offset = motion.servicer_offsets_m(np.array([0.5 * shipped.duration_s]))[0]
    assert offset @ up > 0.9 * np.linalg.norm(offset)


def test_debris_passes_in_front_of_the_client() -> None:
    s = scenario("orbit_two_objects")
    motion = OrbitMotion(s)
    T = [
        motion.poses_in_base(name, np.linspace(0.0, s.duration_s, 200))[:, :3, 3]
        for name in ("client", "debris")
    ]
    bearing = [p / np.linalg.norm(p, axis=1, keepdims=True) for p in T]
    angle = np.arccos(np.clip((bearing[0] * bearing[1]).sum(axis=1), -1.0, 1.0))
    nearest = int(angle.argmin())
    assert np.degrees(angle[nearest]) < 1.5
    assert np.linalg.norm(T[1][nearest]) < np.linalg.norm(T[0][nearest])


def test_the_orbit_about_a_small_body_is_closed() -> None:
    distances = distances_m("asteroid_orbit")
    assert distances[0] > 10_000.0
    np.testing.assert_allclose(distances[-3000:], 4000.0, rtol=0.01)


def test_the_comet_is_that_of_the_data_set(
    real_data: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CDFF_DATA", str(real_data("rosetta_67p").parent))
    world = OrbitWorld(scenario("asteroid_67p"))
    assert 4000.0 < world.meshes["comet"].extent_m < 5500.0
    axis = world.motion.body_attitudes("comet", np.zeros(1))[0][:, 2]
    ra, dec = np.degrees(np.arctan2(axis[1], axis[0])), np.degrees(np.arcsin(axis[2]))
    np.testing.assert_allclose([ra, dec], [69.54, 64.11], atol=0.01)
