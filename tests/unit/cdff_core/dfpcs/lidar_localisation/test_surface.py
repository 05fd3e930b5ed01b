# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The roughness of a surface follows from its points; the coarser surface has a third of them."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfpcs.lidar_localisation.surface import Surface, joint_roughness_m


def plane(rng: np.random.Generator, noise_m: float) -> Surface:
    points = np.c_[rng.uniform(-10.0, 10.0, (4000, 2)), rng.normal(0.0, noise_m, 4000)]
    return Surface(points, lambda p: np.tile([0.0, 0.0, 1.0], (len(p), 1)))


def test_the_roughness_of_a_noisy_plane_is_that_of_two_points(rng: np.random.Generator) -> None:
    surface = plane(rng, 0.02)
    assert surface.roughness_m == pytest.approx(0.02 * np.sqrt(2.0), rel=0.05)
    assert joint_roughness_m(surface, surface, 0.005) == pytest.approx(0.04, rel=0.05)


def test_the_roughness_of_exact_planes_is_the_range_resolution(rng: np.random.Generator) -> None:
    exact = plane(rng, 0.0)
    assert joint_roughness_m(exact, exact, 0.005) == 0.005


def test_a_coarser_surface_has_a_third_of_the_points(rng: np.random.Generator) -> None:
    assert len(plane(rng, 0.02).coarser.points_m) == pytest.approx(4000 / 3, rel=0.15)
