# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import se3
from cdff_core.bearing_tracking.local_orbital import LocalOrbitalAxes
from cdff_dev.simulate.orbit.kepler import EllipticOrbit, lvlh_axes

ORBIT = EllipticOrbit.from_elements(
    semi_major_axis_m=7.1e6, eccentricity=0.01, inclination_deg=98.0, node_deg=95.0
)


@pytest.mark.parametrize(("interval_s", "tolerance_rad"), [(0.0, 1e-12), (-10.0, 1e-8), (60.0, 3e-6)])
def test_axes_after_a_state_are_those_of_the_orbit(interval_s: float, tolerance_rad: float) -> None:
    r, v = ORBIT.states([700.0])
    axes = LocalOrbitalAxes.of_state(r[0], v[0], interval_s, 5.0, 0.05)
    R, rates = lvlh_axes(*ORBIT.states([700.0 + interval_s]))
    assert se3.rotation_angle(axes.rotation @ R[0].T) < tolerance_rad
    assert axes.rate == pytest.approx(rates[0], rel=1e-4, abs=1e-9)
    assert axes.sigma_rad == pytest.approx(np.hypot(5.0 / np.linalg.norm(r), 0.05 / np.linalg.norm(v)))


def test_a_direction_that_turns_with_the_axes_is_at_rest_in_them() -> None:
    r, v = ORBIT.states([0.0])
    axes = LocalOrbitalAxes.of_state(r[0], v[0], 0.0, 0.0, 7.5)
    ahead = axes.rotation[:, 0]
    covariance = np.diag([1e-10, 4e-10, 9e-10, 1e-14, 1e-14, 1e-14])
    state = axes.state(ahead, axes.rate, covariance)
    assert state.directions[0] == pytest.approx([1.0, 0.0, 0.0])
    assert state.rates[0] == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.trace(state.covariances[0][:3, :3]) == pytest.approx(1.4e-9 + 3.0 * axes.sigma_rad**2)


def test_a_state_that_is_no_orbit_is_refused() -> None:
    with pytest.raises(DegenerateGeometryError, match="expected the state of an orbit"):
        LocalOrbitalAxes.of_state(np.zeros(3), np.array([7500.0, 0.0, 0.0]), 0.0, 5.0, 0.05)
