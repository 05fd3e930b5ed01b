# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.types import LaserRangeErrors, LaserScan, RigidBodyState
from cdff_core.dfns.laser_filter.interface import LaserFilterInputs
from cdff_core.dfns.laser_filter.noise_filter import NoiseFilter

RESOLUTION_RAD = np.deg2rad(0.5)


def _scan(ranges_m: ArrayLike, **fields: float) -> LaserScan:
    ranges = np.round(np.asarray(ranges_m) * 1000).astype(np.int32)
    limits = {"min_range": 20, "max_range": 30_000, "start_angle": -1.0, "angular_resolution": RESOLUTION_RAD}
    return LaserScan(ranges=ranges, remission=np.arange(len(ranges), dtype=float), **(limits | fields))


def _filter(scan: LaserScan, **config: float) -> LaserScan:
    dfn = NoiseFilter()
    dfn.configure(config)
    return dfn.process(LaserFilterInputs(scan_samples=scan, laser_2_body_tf=RigidBodyState())).filtered_scans


def _removed(scan: LaserScan, **config: float) -> list[int]:
    return np.flatnonzero(_filter(scan, **config).ranges == LaserRangeErrors.MEASUREMENT_ERROR).tolist()


def _wall(beams: int = 200, distance_m: float = 3.0) -> NDArray[np.float64]:
    """Return the ranges to a straight wall perpendicular to x; the first beam is at -1 rad."""
    angle = -1.0 + RESOLUTION_RAD * np.arange(beams)
    return distance_m / np.cos(angle)


@pytest.mark.req("CDFF-CORE-040")
def test_a_flat_wall_is_unchanged() -> None:
    scan = _scan(_wall())
    filtered = _filter(scan)
    np.testing.assert_array_equal(filtered.ranges, scan.ranges)
    np.testing.assert_array_equal(filtered.remission, scan.remission)


def test_a_wall_with_sensor_noise_is_unchanged(rng: np.random.Generator) -> None:
    assert _removed(_scan(_wall() + rng.normal(0, 0.01, 200))) == []


@pytest.mark.parametrize("spike_m", [0.4, 2.0, 4.5, 12.0])
def test_only_a_single_wrong_range_is_removed(spike_m: float) -> None:
    ranges = _wall()
    ranges[120] = spike_m
    assert _removed(_scan(ranges)) == [120]


def test_a_mixed_pixel_is_removed_and_both_edges_are_unchanged() -> None:
    ranges = np.full(60, 6.0)
    ranges[:30] = 2.0
    ranges[30] = 3.9
    assert _removed(_scan(ranges), max_deviation_m=10) == [30]


def test_a_step_between_two_surfaces_is_unchanged() -> None:
    ranges = np.full(60, 6.0)
    ranges[:30] = 2.0
    assert _removed(_scan(ranges)) == []


def test_a_post_wider_than_half_the_window_is_unchanged() -> None:
    ranges = np.full(60, 6.0)
    ranges[28:32] = 2.0
    assert _removed(_scan(ranges), half_window=3) == []


def test_a_range_beyond_the_limits_gets_its_error_code() -> None:
    ranges = np.full(40, 5.0)
    ranges[10], ranges[20] = 0.5, 25.0
    filtered = _filter(_scan(ranges, min_range=1000, max_range=20_000))
    assert filtered.ranges[10] == LaserRangeErrors.TOO_NEAR
    assert filtered.ranges[20] == LaserRangeErrors.TOO_FAR
    assert np.delete(filtered.ranges, [10, 20]).tolist() == [5000] * 38


def test_a_scan_without_a_maximum_range_has_no_far_limit() -> None:
    assert _filter(_scan(np.full(40, 500.0), max_range=0)).ranges.tolist() == [500_000] * 40


def test_error_codes_of_the_sensor_are_unchanged_and_not_used_as_ranges() -> None:
    scan = _scan(np.full(40, 5.0))
    ranges = scan.ranges.copy()
    ranges[7:12] = [0, 1, 2, 3, 4]
    filtered = _filter(_scan(ranges / 1000))
    np.testing.assert_array_equal(filtered.ranges, ranges)


def test_a_scan_of_only_errors_is_unchanged() -> None:
    assert _filter(_scan(np.full(5, 0.001))).ranges.tolist() == [1] * 5


@pytest.mark.req("CDFF-CORE-013")
def test_beam_geometry_and_time_are_preserved_and_the_input_is_not_modified() -> None:
    ranges = _wall()
    ranges[50] = 9.0
    scan = _scan(ranges, speed=2.5)
    before = scan.ranges.copy()
    filtered = _filter(scan)
    np.testing.assert_array_equal(scan.ranges, before)
    assert (filtered.start_angle, filtered.angular_resolution, filtered.speed) == (-1.0, RESOLUTION_RAD, 2.5)
    assert filtered.ref_time == scan.ref_time


def test_a_scan_without_angles_between_its_beams_is_refused() -> None:
    with pytest.raises(InputError, match="angular_resolution 0"):
        _filter(_scan(_wall(), angular_resolution=0.0))


@pytest.mark.parametrize("config", [{"half_window": 0}, {"max_deviation_m": -1}, {"window": 3}])
def test_an_invalid_configuration_is_refused(config: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError):
        NoiseFilter().configure(config)
