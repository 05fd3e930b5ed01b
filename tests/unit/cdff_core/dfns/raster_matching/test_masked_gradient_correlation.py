# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.errors import ConfigurationError, RefusedError
from cdff_common.geometry import se3
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching.interface import RasterMatchingInputs, RasterMatchingOutputs
from cdff_core.dfns.raster_matching.masked_gradient_correlation import MaskedGradientCorrelation

CELLS = 120
RELIEF = gaussian_filter(np.random.default_rng(5).normal(size=(CELLS, CELLS)), 4.0, mode="wrap") * 8.0
WIDE = GridGeometry.aligned("orbit", 1.0, (-60, -60, 60, 60))


def elevation(geometry: GridGeometry, heights: np.ndarray) -> ElevationMap:
    return ElevationMap.from_layers(geometry, {"mean": heights.astype(np.float32)}, t0_ns=0, t1_ns=0)


REFERENCE = elevation(WIDE, RELIEF)


def template(
    T: np.ndarray, *, cell_m: float = 0.25, noise_m: float = 0.0, holes: float = 0.0
) -> ElevationMap:
    """Return the map of 30 m x 24 m of a rover whose frame is at T in the reference."""
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


def match(
    template_map: ElevationMap, guess: np.ndarray | None = None, **config: Any
) -> RasterMatchingOutputs:
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 20.0, **config})
    return node.process(RasterMatchingInputs(reference=REFERENCE, template=template_map, guess=guess))


@pytest.mark.req("CDFF-CORE-089")
@pytest.mark.parametrize(
    "T", [upright(0.0, 3.0, -5.0, 0.0), upright(6.3, -8.37, 6.71, 250.0), upright(-9.0, 0, 0, -3)]
)
@pytest.mark.parametrize("holes", [0.0, 0.5])
def test_translation_rotation_and_height_are_estimated_to_subcell_precision(
    T: np.ndarray, holes: float
) -> None:
    matches = match(template(T, noise_m=0.02, holes=holes))
    point = np.array([5.0, -2.0, 0.0])
    error = (matches.transforms[0] - T)[:3, :3] @ point + (matches.transforms[0] - T)[:3, 3]
    np.testing.assert_allclose(error, 0.0, atol=0.06)
    assert se3.rotation_angle(matches.transforms[0][:3, :3] @ T[:3, :3].T) < np.radians(0.3)
    assert matches.explained[0] > 0.98
    assert matches.correlations[0] > 0.95
    assert (np.diff(matches.explained) <= 0.0).all()
    assert matches.log_likelihoods[0] > matches.log_likelihoods[1:].max(initial=-np.inf) + 10.0


def test_a_tilt_of_the_template_has_no_effect() -> None:
    T = upright(2.0, 4.4, -3.3, 1.0)
    level = template(T)
    x, _ = level.geometry.centres_m()
    tilted = elevation(level.geometry, level.layer("mean") + 0.05 * x)
    of_level, of_tilted = match(level), match(tilted)
    np.testing.assert_allclose(of_tilted.transforms[0][:2, 3], of_level.transforms[0][:2, 3], atol=0.05)


def test_the_search_covers_only_the_stated_range_around_the_guess() -> None:
    T = upright(100.0, -20.0, 15.0, 0.0)
    matches = match(template(T), upright(95.0, -16.0, 12.0, 3.0))
    np.testing.assert_allclose(matches.transforms[0][:2, 3], T[:2, 3], atol=0.1)
    node = MaskedGradientCorrelation()
    node.configure()
    inputs = RasterMatchingInputs(
        reference=REFERENCE,
        template=template(T),
        guess=upright(100.0, -12.0, 15.0, 0.0),
        reach=np.array([3.0, 0.05]),
    )
    try:
        estimate = node.process(inputs).transforms[0]
    except RefusedError:
        return
    assert np.hypot(*(estimate[:2, 3] - T[:2, 3])) > 2.0


def test_the_covariance_grows_with_the_noise_of_the_reference() -> None:
    T = upright(0.0, 2.0, 2.0, 0.0)
    noisy = elevation(WIDE, RELIEF + np.random.default_rng(2).normal(0.0, 0.2, RELIEF.shape))
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 10.0, "floor_cells": 0.0})
    results = [
        node.process(RasterMatchingInputs(reference=reference, template=template(T)))
        for reference in (REFERENCE, noisy)
    ]
    sigma_m, sigma_noisy_m = (np.sqrt(np.trace(result.covariances[0][:2, :2])) for result in results)
    assert sigma_noisy_m > 2.0 * sigma_m
    assert sigma_noisy_m < 1.0


@pytest.mark.req("CDFF-CORE-089")
def test_a_flat_small_empty_or_distant_template_is_refused() -> None:
    T = upright(0.0, 0.0, 0.0, 0.0)
    rover_map = template(T)
    plane = elevation(rover_map.geometry, np.full(rover_map.geometry.shape, 3.0))
    with pytest.raises(RefusedError) as flat:
        match(plane)
    strip = rover_map.layer("mean").copy()
    strip[:, 20:] = np.nan
    with pytest.raises(RefusedError) as too_small:
        match(elevation(rover_map.geometry, strip))
    with pytest.raises(RefusedError) as empty:
        match(elevation(rover_map.geometry, np.full(rover_map.geometry.shape, np.nan)))
    with pytest.raises(RefusedError) as outside:
        match(rover_map, upright(0.0, 500.0, 0.0, 0.0))
    reasons = [e.value.reasons for e in (flat, too_small, empty, outside)]
    assert reasons == [("flat",), ("little_seen",), ("little_seen",), ("outside",)]


def test_holes_of_the_reference_are_ignored() -> None:
    T = upright(1.0, 3.3, -4.2, 0.0)
    holed = RELIEF.copy()
    holed[55:60, :] = np.nan
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 10.0, "min_overlap": 0.5})
    outputs = node.process(RasterMatchingInputs(reference=elevation(WIDE, holed), template=template(T)))
    np.testing.assert_allclose(outputs.transforms[0][:2, 3], T[:2, 3], atol=0.1)


@pytest.mark.parametrize("cell_m", [1.5, 2.0])
def test_a_template_of_larger_cells_is_located_on_averaged_cells(cell_m: float) -> None:
    T = upright(2.0, 3.3, -4.2, 7.0)
    outputs = match(template(T, cell_m=cell_m))
    at = (T @ [*outputs.centre, 1.0])[:2]
    np.testing.assert_allclose((outputs.transforms[0] @ [*outputs.centre, 1.0])[:2], at, atol=0.15)
    assert outputs.explained[0] > 0.95


def test_an_invalid_parameter_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="search_m"):
        match(template(np.eye(4)), search_m=-1.0)


def test_a_stated_reach_replaces_that_of_the_parameters() -> None:
    T = upright(0.0, 8.0, 5.0, 0.0)
    node = MaskedGradientCorrelation()
    node.configure({"search_m": 2.0, "search_deg": 0.0})
    result = node.process(
        RasterMatchingInputs(reference=REFERENCE, template=template(T), reach=np.array([12.0, 0.05]))
    )
    np.testing.assert_allclose(result.transforms[0][:2, 3], [8.0, 5.0], atol=0.1)
