# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.kepler import (
    MU_EARTH,
    EllipticOrbit,
    lvlh_axes,
    relative_orbit,
    relative_states,
    transfer,
)

LOW = EllipticOrbit.from_elements(semi_major_axis_m=6_928_137.0, inclination_deg=97.6, node_deg=40.0)


@pytest.mark.parametrize("eccentricity", [0.0, 0.01, 0.3, 0.8])
def test_states_equal_the_integrated_motion(eccentricity: float) -> None:
    orbit = EllipticOrbit.from_elements(
        semi_major_axis_m=2.0e7,
        eccentricity=eccentricity,
        inclination_deg=63.4,
        node_deg=120.0,
        periapsis_deg=270.0,
        true_anomaly_deg=200.0,
    )
    times_s = np.linspace(0.0, 2.2 * orbit.period_s, 40)

    def derivative(_: float, state: FloatArray) -> FloatArray:
        return np.concatenate([state[3:], -MU_EARTH * state[:3] / np.linalg.norm(state[:3]) ** 3])

    r, v = orbit.states(times_s)
    options = {"t_eval": times_s, "method": "DOP853", "rtol": 1e-12, "atol": 1e-6}
    states = solve_ivp(derivative, (0.0, times_s[-1]), np.concatenate([r[0], v[0]]), **options).y.T
    assert r == pytest.approx(states[:, :3], abs=0.05)
    assert v == pytest.approx(states[:, 3:], abs=5e-5)


def test_elements_give_the_orbit_that_they_name() -> None:
    orbit = EllipticOrbit.from_elements(
        semi_major_axis_m=1e7, eccentricity=0.2, inclination_deg=30.0, node_deg=90.0
    )
    r, v = orbit.states([0.0, orbit.period_s / 2.0])
    assert r[0] == pytest.approx([0.0, 0.8e7, 0.0], abs=1e-6)  # periapsis at the ascending node
    assert np.linalg.norm(r, axis=1) == pytest.approx([0.8e7, 1.2e7])
    normal = np.cross(r[0], v[0])
    assert math.degrees(math.acos(normal[2] / np.linalg.norm(normal))) == pytest.approx(30.0)
    assert orbit.period_s == pytest.approx(2.0 * math.pi * math.sqrt(1e21 / MU_EARTH))


def test_lvlh_axes_point_along_the_velocity_and_down() -> None:
    r, v = LOW.states([0.0, 1000.0])
    R, rates = lvlh_axes(r, v)
    assert np.linalg.det(R) == pytest.approx(np.ones(2))
    assert R[:, :, 0] == pytest.approx(v / np.linalg.norm(v, axis=1, keepdims=True))
    assert R[:, :, 2] == pytest.approx(-r / np.linalg.norm(r, axis=1, keepdims=True))
    assert np.linalg.norm(rates, axis=1) == pytest.approx([LOW.mean_motion_rad_s] * 2)


def test_small_relative_motion_follows_clohessy_and_wiltshire() -> None:
    n = LOW.mean_motion_rad_s
    x0, z0, vx0, vz0 = 10.0, 5.0, 0.01, -0.02  # along the velocity, down
    orbit = relative_orbit(LOW, [x0, 3.0, z0], [vx0, 0.0, vz0], 100.0)
    elapsed_s = np.array([0.0, 500.0, 2000.0, 5000.0])
    positions_m, velocities_m_s = relative_states(LOW, orbit, 100.0 + elapsed_s)
    s, c = np.sin(n * elapsed_s), np.cos(n * elapsed_s)  # Fehse 2003, equation 3.22
    x = (4 * vx0 / n - 6 * z0) * s - 2 * vz0 / n * c + (6 * n * z0 - 3 * vx0) * elapsed_s + x0 + 2 * vz0 / n
    z = (2 * vx0 / n - 3 * z0) * c + vz0 / n * s + 4 * z0 - 2 * vx0 / n
    assert positions_m == pytest.approx(np.column_stack([x, 3.0 * c, z]), abs=0.02)
    assert velocities_m_s[0] == pytest.approx([vx0, 0.0, vz0], abs=1e-9)


def test_a_transfer_reaches_its_end() -> None:
    eccentric = EllipticOrbit.from_elements(semi_major_axis_m=2.4e7, eccentricity=0.6)
    for reference in (LOW, eccentric):
        orbit = transfer(reference, [-30e3, 50.0, 2e3], [-500.0, 0.0, 0.0], 10.0, 2500.0)
        positions_m, _ = relative_states(reference, orbit, [10.0, 2500.0])
        assert positions_m == pytest.approx(np.array([[-30e3, 50.0, 2e3], [-500.0, 0.0, 0.0]]), abs=1e-4)


def test_impossible_transfers_are_refused() -> None:
    with pytest.raises(InputError, match="below the period"):
        transfer(LOW, [0, 0, 0], [1, 0, 0], 0.0, 2.0 * LOW.period_s)
    with pytest.raises(InputError, match="choose another duration"):
        transfer(LOW, [0, 10.0, 0], [0, 50.0, 0], 0.0, LOW.period_s / 2.0)


@pytest.mark.parametrize(
    ("position_m", "velocity_m_s", "message"),
    [
        ([7e6, 0, 0], [0, 12e3, 0], "that of escape"),
        ([7e6, 0, 0], [100.0, 0, 0], "elliptic orbit"),
        ([0, 0, 0], [0, 7e3, 0], "away from the centre"),
        ([7e6, 0], [0, 7e3, 0], "expected \\(3,\\)"),
    ],
)
def test_states_that_are_no_ellipse_are_refused(
    position_m: list[float], velocity_m_s: list[float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        EllipticOrbit(position_m, velocity_m_s)


def test_elements_out_of_range_are_refused() -> None:
    with pytest.raises(InputError, match="eccentricity=1"):
        EllipticOrbit.from_elements(semi_major_axis_m=7e6, eccentricity=1.0)
