# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.simulate.orbit.eclipse import EARTH_RADIUS_M, SUN_RADIUS_M, sunlit_fraction
from cdff_dev.simulate.orbit.kepler import EllipticOrbit

AU_M = 1.495978707e11
SUN_M = np.array([AU_M, 0.0, 0.0])


def test_light_umbra_and_the_middle_of_the_penumbra() -> None:
    r = 7e6
    limb = np.arcsin(EARTH_RADIUS_M / r)
    behind_limb = r * np.array([-np.cos(limb), np.sin(limb), 0.0])  # the Sun's centre is on the limb
    fractions = sunlit_fraction([[r, 0, 0], [-r, 0, 0], behind_limb], SUN_M)
    assert fractions[:2].tolist() == [1.0, 0.0]
    assert fractions[2] == pytest.approx(0.5, abs=0.01)


def test_the_fraction_is_that_of_rays_to_the_disc() -> None:
    rng = np.random.default_rng(3)
    disc = rng.uniform(-1.0, 1.0, (40000, 2))
    disc = disc[np.hypot(*disc.T) < 1.0]
    for angle in np.linspace(-0.004, 0.004, 5):
        limb = np.arcsin(EARTH_RADIUS_M / 8e6) + angle
        position = 8e6 * np.array([-np.cos(limb), 0.0, np.sin(limb)])
        targets = SUN_M + SUN_RADIUS_M * np.column_stack([np.zeros(len(disc)), disc])
        rays = targets - position
        nearest = np.linalg.norm(np.cross(position, rays), axis=1) / np.linalg.norm(rays, axis=1)
        assert sunlit_fraction(position, SUN_M)[0] == pytest.approx(
            np.mean(nearest > EARTH_RADIUS_M), abs=0.01
        )


def test_a_body_smaller_than_the_disc_hides_a_ring_of_it() -> None:
    distance_m = 4.0e8  # beyond the umbra of a body of 500 km
    fraction = sunlit_fraction([-distance_m, 0.0, 0.0], SUN_M, body_radius_m=5.0e5)[0]
    expected = 1.0 - (5.0e5 / distance_m * (AU_M + distance_m) / SUN_RADIUS_M) ** 2
    assert fraction == pytest.approx(expected, rel=1e-4)


def test_a_low_orbit_in_the_plane_of_the_ecliptic_is_dark_for_35_minutes() -> None:
    orbit = EllipticOrbit.from_elements(semi_major_axis_m=6_778_137.0)
    times_s = np.linspace(0.0, orbit.period_s, 4000)
    dark_s = np.mean(sunlit_fraction(orbit.states(times_s)[0], SUN_M) < 0.5) * orbit.period_s
    shadow_rad = 2.0 * np.arcsin(EARTH_RADIUS_M / 6_778_137.0)
    assert dark_s == pytest.approx(shadow_rad / orbit.mean_motion_rad_s, rel=0.005)
