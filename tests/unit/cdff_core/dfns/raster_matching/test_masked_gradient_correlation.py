# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.errors import ConfigurationError, InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching._interface import RasterMatchingInputs, RasterMatchingOutputs
from cdff_core.dfns.raster_matching.masked_gradient_correlation import MaskedGradientCorrelation

CELLS = 120
RELIEF = gaussian_filter(np.random.default_rng(5).normal(size=(CELLS, CELLS)), 4.0, mode="wrap") * 8.0
WIDE = GridGeometry.aligned("orbit", 1.0, (-60, -60, 60, 60))


def elevation(geometry: GridGeometry, heights: np.ndarray) -> ElevationMap:
    return ElevationMap.from_layers(geometry, {"mean": heights.astype(np.float32)}, t0_ns=0, t1_ns=0)


REFERENCE = elevation(WIDE, RELIEF)


def template(T: np.ndarray, *, cell_m: float = 0.25, noise_m: float = 0.0, holes: float = 0.0) -> ElevationMap:
    """What a rover whose frame lies at T in the reference's maps of 30 m x 24 m of it."""
    geometry = GridGeometry.aligned("rover", cell_m, (-10, -14, 20, 10))
    x, y = (c.ravel() for c in geometry.centres_m())
    p = T[:2, :2] @ np.stack([x, y]) + T[:2, 3, None]
    z = map_coordinates(RELIEF, [60.0 - p[1] - 0.5, p[0] + 60.0 - 0.5], order=3) - T[2, 3]
    rng = np.random.default_rng(1)
    z += rng.normal(0.0, noise_m, z.shape) if noise_m else 0.0
    z[rng.random(z.shape) < holes] = np.nan
    return elevation(geometry, z.reshape(geometry.shape))


def upright(yaw_deg: float, x: float, y: float, z: float) -> np.ndarray:
    return se3.transform(se3.exp_so3(np.radians([0.0, 0.0, yaw_deg])), [x, y, z])


def match(looked_for: ElevationMap, guess: np.ndarray | None = None, **config: Any) -> RasterMatchingOutputs:
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 20.0, **config})
    return node.process(RasterMatchingInputs(reference=REFERENCE, template=looked_for, guess=guess))


@pytest.mark.req("CDFF-CORE-089")
@pytest.mark.parametrize("T", [upright(0.0, 3.0, -5.0, 0.0), upright(6.3, -8.37, 6.71, 250.0), upright(-9.0, 0, 0, -3)])
@pytest.mark.parametrize("holes", [0.0, 0.5])
def test_shift_turn_and_height_are_found_well_below_a_cell(T: np.ndarray, holes: float) -> None:
    found = match(template(T, noise_m=0.02, holes=holes))
    at = np.array([5.0, -2.0, 0.0])
    error = (found.transforms[0] - T)[:3, :3] @ at + (found.transforms[0] - T)[:3, 3]
    np.testing.assert_allclose(error, 0.0, atol=0.06)
    assert se3.rotation_angle(found.transforms[0][:3, :3] @ T[:3, :3].T) < np.radians(0.3)
    assert found.explained[0] > 0.98
    assert found.correlations[0] > 0.95
    assert (np.diff(found.explained) <= 0.0).all()
    assert found.log_likelihoods[0] > found.log_likelihoods[1:].max(initial=-np.inf) + 10.0


def test_a_tilt_of_the_template_changes_nothing() -> None:
    T = upright(2.0, 4.4, -3.3, 1.0)
    level = template(T)
    x, _ = level.geometry.centres_m()
    tilted = elevation(level.geometry, level.layer("mean") + 0.05 * x)
    first, second = match(level), match(tilted)
    np.testing.assert_allclose(second.transforms[0][:2, 3], first.transforms[0][:2, 3], atol=0.05)


def test_the_search_is_about_the_guess_and_as_far_as_said() -> None:
    T = upright(100.0, -20.0, 15.0, 0.0)
    found = match(template(T), upright(95.0, -16.0, 12.0, 3.0))
    np.testing.assert_allclose(found.transforms[0][:2, 3], T[:2, 3], atol=0.1)
    node = MaskedGradientCorrelation()
    node.configure()
    near = RasterMatchingInputs(REFERENCE, template(T), upright(100.0, -12.0, 15.0, 0.0), np.array([3.0, 0.05]))
    try:
        other = node.process(near).transforms[0]
    except RefusedError:
        return
    assert np.hypot(*(other[:2, 3] - T[:2, 3])) > 2.0


def test_the_covariance_grows_with_the_noise_of_the_reference() -> None:
    T = upright(0.0, 2.0, 2.0, 0.0)
    noisy = elevation(WIDE, RELIEF + np.random.default_rng(2).normal(0.0, 0.2, RELIEF.shape))
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 10.0, "floor_cells": 0.0})
    sigma = [
        float(np.sqrt(np.trace(node.process(RasterMatchingInputs(r, template(T))).covariances[0][:2, :2])))
        for r in (REFERENCE, noisy)
    ]
    assert sigma[1] > 2.0 * sigma[0]
    assert sigma[1] < 1.0


@pytest.mark.req("CDFF-CORE-089")
def test_flat_ground_little_ground_and_ground_beside_the_reference_are_refused() -> None:
    T = upright(0.0, 0.0, 0.0, 0.0)
    seen = template(T)
    plane = elevation(seen.geometry, np.full(seen.geometry.shape, 3.0))
    with pytest.raises(RefusedError) as flat:
        match(plane)
    few = seen.layer("mean").copy()
    few[:, 20:] = np.nan
    with pytest.raises(RefusedError) as little:
        match(elevation(seen.geometry, few))
    with pytest.raises(RefusedError) as none:
        match(elevation(seen.geometry, np.full(seen.geometry.shape, np.nan)))
    with pytest.raises(RefusedError) as away:
        match(seen, upright(0.0, 500.0, 0.0, 0.0))
    reasons = [e.value.reasons for e in (flat, little, none, away)]
    assert reasons == [("flat",), ("little_seen",), ("little_seen",), ("outside",)]


def test_holes_of_the_reference_are_not_ground() -> None:
    T = upright(1.0, 3.3, -4.2, 0.0)
    holed = RELIEF.copy()
    holed[55:60, :] = np.nan
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 10.0, "min_overlap": 0.5})
    found = node.process(RasterMatchingInputs(elevation(WIDE, holed), template(T)))
    np.testing.assert_allclose(found.transforms[0][:2, 3], T[:2, 3], atol=0.1)


def test_a_template_of_larger_cells_and_a_wrong_parameter_are_refused() -> None:
    with pytest.raises(InputError, match="cells of 2"):
        match(template(np.eye(4), cell_m=2.0))
    with pytest.raises(ConfigurationError, match="search_m"):
        match(template(np.eye(4)), search_m=-1.0)
