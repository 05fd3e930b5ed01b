# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated terrain: spectrum, craters, grid and rocks."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_dev.simulate.relief import crater_profile, fractal_tile, graded_axis, power_law_sizes
from cdff_dev.simulate.world import World


def test_a_fractal_tile_has_the_requested_slope_and_spectral_exponent(rng: np.random.Generator) -> None:
    n, cell_m, hurst = 256, 0.1, 0.7
    tile = fractal_tile(rng, n, cell_m, (0.4, 12.8), hurst, 0.1)
    kx, ky = np.meshgrid(np.fft.fftfreq(n, cell_m), np.fft.fftfreq(n, cell_m))
    spectrum = np.fft.fft2(tile)
    gx, gy = (np.fft.ifft2(2j * np.pi * k * spectrum).real for k in (kx, ky))
    assert np.sqrt(np.mean(gx**2 + gy**2)) == pytest.approx(0.1)
    k, power = np.hypot(kx, ky).ravel(), np.abs(spectrum).ravel() ** 2
    inside = (k > 1 / 10.0) & (k < 1 / 0.5)
    exponent = np.polyfit(np.log(k[inside]), np.log(power[inside]), 1)[0]
    assert exponent == pytest.approx(-(2 * hurst + 2), abs=0.15)
    assert power[(k > 1 / 0.39)].max() < 1e-12 * power.max()


def test_a_crater_is_a_bowl_with_a_rim_and_ejecta_that_end() -> None:
    r = np.array([0.0, 5.0, 5.0001, 10.0, 15.0, 40.0])
    z = crater_profile(r, 10.0, 1.2, 0.35)
    assert z[0] == pytest.approx(-1.2)
    assert z[1] == pytest.approx(0.35)
    assert z[2] == pytest.approx(0.35, abs=1e-3)
    assert 0 < z[3] < 0.35 / 7
    assert z[4] == z[5] == 0.0


def test_sizes_follow_their_power_law(rng: np.random.Generator) -> None:
    sizes = power_law_sizes(rng, 20_000, 0.1, 10.0, 2.0)
    assert sizes.min() >= 0.1
    assert sizes.max() <= 10.0
    assert np.all(np.diff(sizes) <= 0)
    assert np.mean(sizes > 0.2) == pytest.approx(0.25, abs=0.02)


def test_the_grid_is_uniform_inside_and_extends_to_the_far_edge() -> None:
    axis = graded_axis(2.0, 0.1, 50.0, 1.2)
    inner = axis[np.abs(axis) <= 2.0 + 1e-9]
    np.testing.assert_allclose(np.diff(inner), 0.1)
    np.testing.assert_allclose(axis, -axis[::-1])
    assert axis[-1] >= 50.0
    assert np.diff(axis).max() <= 5.0


def test_heights_are_those_of_the_nodes_and_linear_between_them(world: World) -> None:
    relief = world.relief
    x, y = relief.x_m[[100, 101]], relief.y_m[[90, 91]]
    assert relief.height(np.array([[x[0], y[0]]]))[0] == pytest.approx(relief.z_m[90, 100])
    middle = relief.height(np.array([[x.mean(), y.mean()]]))[0]
    assert middle == pytest.approx(relief.z_m[90:92, 100:102].mean())


def test_no_rock_is_on_the_path_of_a_rover(world: World) -> None:
    t_s = np.linspace(0, world.scenario.duration_s, 20)
    clearance_m = world.scenario.terrain.rocks.track_clearance_m
    for motion in world.motions.values():
        path_xy = motion.poses(t_s)[:, :2, 3]
        gaps = np.linalg.norm(world.rocks.vertices[None, :, :2] - path_xy[:, None, :], axis=-1)
        assert gaps.min() > clearance_m - 0.15
