# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the lidar change ranges by the amounts that their physics predicts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cdff_dev.simulate.faults.lidar import (
    BeamWidth,
    DustPlume,
    RangeWalk,
    beam_offsets,
    dust_ranges,
    echo,
    walk,
)
from cdff_dev.simulate.faults.spinning_lidar import FaultyLidar
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.world import World, cast_scene

BEAM = BeamWidth(divergence_mrad=4.0, resolution_m=0.5)


def lidar(world: World, **faults: Any) -> FaultyLidar:
    data = world.scenario.model_dump() | {"faults": faults}
    data["lidar"] |= {"range_sigma_m": 0.0, "dropout": 0.0}
    faulty = World(Scenario.model_validate(data), world.relief, world.rocks, world.motions, world.appearance)
    return FaultyLidar(faulty, "mana", cast_scene(world.relief, world.rocks))


def rngs() -> tuple[np.random.Generator, np.random.Generator]:
    return np.random.default_rng(3), np.random.default_rng(4)


def test_without_faults_the_scan_is_that_of_the_plain_lidar(world: World) -> None:
    result = lidar(world)
    model = result._model
    expected = scan(model, result._scene, world.motions["mana"], 0.3, rngs()[0])
    points = result.scan(0.3, *rngs()).points_m
    assert len(points) == len(expected.points_m)
    np.testing.assert_allclose(points, expected.points_m, atol=2e-3)


def test_the_rays_of_a_beam_are_inside_its_divergence() -> None:
    offsets, weights = beam_offsets(BEAM)
    assert weights.sum() == pytest.approx(1.0)
    assert np.hypot(*offsets.T).max() == pytest.approx(0.7 * 2e-3)
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=1e-12)


def test_a_mixed_pixel_lies_between_its_two_surfaces_and_the_stronger_of_separate_echoes_is_measured() -> (
    None
):
    _, weights = beam_offsets(BEAM)
    near, far = 5.0, 5.3
    ranges = np.where(np.arange(7)[:, None] < np.arange(1, 7), near, far)
    mixed, _ = echo(BEAM, ranges, np.repeat(weights[:, None], 6, axis=1))
    assert np.all((mixed > near) & (mixed < far))
    assert np.all(np.diff(mixed) < 0)  # more rays on the near surface
    separate, _ = echo(BEAM, np.where(ranges == far, 9.0, near), np.repeat(weights[:, None], 6, axis=1))
    assert np.all((np.abs(separate - near) < 1e-9) | (np.abs(separate - 9.0) < 1e-9))
    assert separate[-1] == pytest.approx(near)


def test_a_beam_without_a_hit_has_no_range_and_partial_hits_do_not_shift_it() -> None:
    _, weights = beam_offsets(BEAM)
    ranges = np.array([[np.inf] * 7, [4.0] + [np.inf] * 6]).T
    range_m, power = echo(BEAM, ranges, np.repeat(weights[:, None], 2, axis=1))
    assert np.isinf(range_m[0])
    assert range_m[1] == pytest.approx(4.0)
    assert power[1] == pytest.approx(weights[0])


def test_range_walk_is_zero_on_the_calibration_target_and_grows_as_the_power_falls() -> None:
    model = RangeWalk(rise_m=0.3, threshold=0.02, reference_m=10.0)
    assert walk(model, np.array([10.0]), np.array([0.6]))[0] == pytest.approx(10.0)
    # At 20 m the power is a quarter: the threshold is crossed 0.3 * 0.02 / 0.15 after the edge's start.
    expected = 20.0 + 0.3 * 0.02 * (1 / 0.15 - 1 / 0.6)
    assert walk(model, np.array([20.0]), np.array([0.6]))[0] == pytest.approx(expected)
    assert np.isinf(walk(model, np.array([20.0]), np.array([0.07]))[0])


def test_dense_dust_returns_at_the_leading_edge_of_its_sector(rng: np.random.Generator) -> None:
    model = DustPlume(returns_per_m=20.0, from_m=2.0, to_m=6.0, azimuth_deg=180.0, width_deg=60.0)
    azimuth = np.radians(np.array([180.0, 160.0, 140.0, 0.0]))[:, None]
    ranges = dust_ranges(model, azimuth, (4, 2000), rng)
    assert np.isinf(ranges[2:]).all()
    assert ranges[:2].mean() == pytest.approx(2.0 + 1.0 / 20.0, abs=0.01)
    thin = dust_ranges(model.model_copy(update={"returns_per_m": 0.05}), azimuth, (4, 4000), rng)
    assert np.isfinite(thin[0]).mean() == pytest.approx(1.0 - np.exp(-0.05 * 4.0), abs=0.03)
    with pytest.raises(ValidationError, match="to_m"):
        DustPlume(returns_per_m=1.0, from_m=3.0, to_m=2.0)


def test_ring_offsets_are_constant_for_each_ring(world: World) -> None:
    plain, offset = lidar(world), lidar(world, lidar={"rings": {"range_sigma_m": 0.05}})
    scans = [device.scan(0.3, *rngs()) for device in (plain, offset)]
    by_beam = [
        {
            (int(r), int(t)): np.linalg.norm(p)
            for r, t, p in zip(s.ring, s.time_offset_us, s.points_m, strict=True)
        }
        for s in scans
    ]
    difference: dict[int, list[float]] = {}
    for key, range_m in by_beam[0].items():
        if key in by_beam[1]:
            difference.setdefault(key[0], []).append(by_beam[1][key] - range_m)
    means = {ring: np.mean(values) for ring, values in difference.items()}
    assert len(means) > 4
    assert np.std(list(means.values())) > 0.01
    for ring, values in difference.items():
        np.testing.assert_allclose(values, offset._ring_offset_m[ring], atol=1e-4)


def test_a_moving_object_is_seen_where_it_is_at_the_time_of_each_column(world: World) -> None:
    base = world.motions["mana"].poses(np.array([0.3]))[0]
    start = base[:2, 3] + 4.0 * base[:2, 0]
    speed_m_s = 2.0
    moving_object = {"size_m": [1.5, 1.5, 3.0], "start_xy_m": list(start), "velocity_m_s": [0.0, speed_m_s]}
    device = lidar(world, objects=[moving_object])
    centres = []
    for t0_s in (0.0, 0.5):
        result = device.scan(t0_s, *rngs())
        near = np.linalg.norm(result.points_m[:, :2], axis=1) < 6.0
        points = result.points_m[near & (result.points_m[:, 0] > 0.0) & (result.points_m[:, 2] > -0.2)]
        assert len(points) > 5
        T = world.motions["mana"].poses(np.array([t0_s + 0.25]))[0] @ device._model.mount.matrix()
        y = (points @ T[:3, :3].T + T[:3, 3])[:, 1]
        centres.append(0.5 * (y.min() + y.max()))
    assert centres[1] - centres[0] == pytest.approx(0.5 * speed_m_s, abs=0.3)
