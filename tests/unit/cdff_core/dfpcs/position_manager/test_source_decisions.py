# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decisions of the source monitor at their limits: intervals, scales, timeouts and refused fractions."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.measurement import Measurement, MeasurementResult
from cdff_core.dfpcs.position_manager.source_monitor import SourceMonitor
from tests.support.position_manager_samples import T0, pose

S = 1_000_000_000
CONFIG = PositionManagerConfig.model_validate(
    {"odometry": {"visual_scale": 3.0, "lidar_scale": 5.0, "timeout_s": 2.0}, "fixes": {"scale": 7.0}}
)
USED, REFUSED = MeasurementResult(True), MeasurementResult(False, ("visual_odometry_refused",))
T = UncertainTransform(np.eye(4), np.diag([9.0, 16.0, 0.0, 0.04, 0.0, 0.09]))


@pytest.fixture
def monitor() -> SourceMonitor:
    monitor = SourceMonitor(CONFIG)
    monitor.start(T0)
    return monitor


def sample(port: str, t_ns: int = 0, status: Status = Status.OK) -> Sample:
    value = pose(port, 0.0, np.eye(4), np.eye(6), "mana/origin", "mana/sensor", status).value
    return Sample(port, T0 + t_ns, 0, value, quality=Quality(status))


def measured(source: str, t_ns: int = 0) -> Measurement:
    return Measurement(T0 + t_ns, source)


def test_wheel_poses_are_at_least_45_ms_apart_and_late_ones_are_accepted(monitor: SourceMonitor) -> None:
    stamps_ms = (0, 44, 45, 89, 90, 50, 134, 135)
    skipped = [monitor.is_too_frequent(sample("odometry", t * 1_000_000)) for t in stamps_ms]
    assert skipped == [False, True, False, True, False, False, True, False]


@pytest.mark.parametrize(
    ("port", "scale", "degraded_scale"),
    [
        ("visual_odometry", 3.0, 75.0),
        ("lidar_odometry", 5.0, 125.0),
        ("fix", 7.0, 175.0),
        ("absolute_fix", 7.0, 175.0),
        ("odometry", 1.0, 1.0),
    ],
)
def test_variances_are_scaled_by_source_and_status(
    monitor: SourceMonitor, port: str, scale: float, degraded_scale: float
) -> None:
    assert monitor.measurement(sample(port), "mana/base").scale == scale
    m = monitor.measurement(sample(port, 5, Status.DEGRADED), "mana/base")
    assert m.scale == degraded_scale
    assert (m.stamp_ns, m.source, m.frame) == (T0 + 5, port, "mana/origin")
    assert m.child == ("mana/base" if port == "odometry" else "mana/sensor")
    assert not m.restart


def test_the_first_measurement_after_a_failure_starts_again(monitor: SourceMonitor) -> None:
    monitor.mark_failed("fix")
    assert not monitor.measurement(sample("visual_odometry"), "mana/base").restart
    assert monitor.measurement(sample("fix"), "mana/base").restart
    monitor.record(measured("fix"), MeasurementResult(False, ("fix_attached",)))
    assert not monitor.measurement(sample("fix"), "mana/base").restart


def test_wheel_poses_are_published_while_all_frequent_sources_are_silent(monitor: SourceMonitor) -> None:
    at_limit, later = measured("odometry", 2 * S), measured("odometry", 2 * S + 1)
    assert not monitor.is_published(at_limit, at_limit.stamp_ns)  # the start counts as use
    assert monitor.is_published(later, later.stamp_ns)
    assert not monitor.is_published(later, later.stamp_ns + 1)
    for source in ("visual_odometry", "lidar_odometry", "fix"):
        recent = SourceMonitor(CONFIG)
        recent.start(T0)
        recent.record(measured(source, S), USED)
        assert not recent.is_published(later, later.stamp_ns)
        assert recent.is_published(measured(source, S), 9 * S)
    monitor.record(measured("absolute_fix", S), USED)  # rare: does not suppress the wheels
    assert monitor.is_published(later, later.stamp_ns)


def test_the_source_of_a_pose_is_the_most_accurate_recent_one(monitor: SourceMonitor) -> None:
    order = ["imu", "odometry", "absolute_fix", "fix", "lidar_odometry", "visual_odometry"]
    names = []
    for source in order:
        monitor.record(measured(source, 5 * S), USED)
        names.append(monitor.quality(T0 + 7 * S, T, ()).reasons[0].removeprefix("source:"))
    assert names == ["imu", "wheels", "absolute_fix", "fix", "lidar", "vo"]
    assert monitor.quality(T0 + 7 * S + 1, T, ()).reasons == ("source:none",)
    assert monitor.quality(T0 + 3 * S, T, ()).reasons == ("source:vo",)
    monitor.record(measured("visual_odometry", 4 * S), USED)  # late: the newest use counts
    assert monitor.quality(T0 + 7 * S, T, ()).reasons == ("source:vo",)


def test_poses_of_accurate_sources_and_of_the_start_are_ok(monitor: SourceMonitor) -> None:
    assert monitor.quality(T0 + 2 * S, T, ("other",)).reasons == ("source:start", "other")
    monitor.record(measured("odometry", 2 * S), USED)
    statuses = [monitor.quality(T0 + t, T, ()).status for t in (2 * S, 2 * S + 1)]
    assert statuses == [Status.DEGRADED, Status.DEGRADED]
    assert monitor.degraded_poses == 2
    monitor.record(measured("absolute_fix", 2 * S), USED)
    assert monitor.quality(T0 + 2 * S, T, ()).status is Status.OK
    assert monitor.degraded_poses == 2


def test_a_degraded_input_degrades_poses_until_the_timeout(monitor: SourceMonitor) -> None:
    for t_s in (5, 3):
        monitor.measurement(sample("visual_odometry", t_s * S, Status.DEGRADED), "mana/base")
    monitor.record(measured("visual_odometry", 6 * S), USED)
    degraded, ok = (monitor.quality(T0 + 7 * S + d, T, ("a",)) for d in (0, 1))
    assert (degraded.status, degraded.reasons) == (Status.DEGRADED, ("source:vo", "a", "odometry_degraded"))
    assert (ok.status, ok.reasons) == (Status.OK, ("source:vo", "a"))


@pytest.mark.parametrize(
    ("refused", "used", "reason"),
    [
        (7, 0, ""),
        (8, 0, "refused:vo_1.00"),
        (5, 5, ""),
        (6, 5, "refused:vo_0.55"),
        (11, 9, "refused:vo_0.55"),
    ],
)
def test_a_source_most_of_whose_measurements_are_refused_degrades_the_pose(
    monitor: SourceMonitor, refused: int, used: int, reason: str
) -> None:
    for result in [USED] * 30 * (used == 9) + [REFUSED] * refused + [USED] * used:
        monitor.record(measured("visual_odometry"), result)
    monitor.record(measured("fix"), USED)
    quality = monitor.quality(T0, T, ())
    assert quality.reasons[1:] == ((reason,) if reason else ())
    assert quality.status is (Status.DEGRADED if reason else Status.OK)
    assert quality.metrics["refused_vo"] == refused


def test_a_sensor_without_a_place_on_the_robot_degrades_the_pose_until_it_has_one(
    monitor: SourceMonitor,
) -> None:
    monitor.record(measured("fix"), USED)
    monitor.mark_unplaced("lidar_odometry", "mana/lidar")
    quality = monitor.quality(T0, T, ())
    assert quality.reasons[1:] == ("unplaced:lidar_mana/lidar",)
    assert quality.metrics["refused_lidar"] == 1.0
    assert monitor.measurement(sample("lidar_odometry"), "mana/base").restart
    monitor.record(measured("lidar_odometry"), USED)
    assert monitor.quality(T0, T, ()).reasons == ("source:lidar",)


def test_metrics_are_standard_deviations_and_the_age_of_the_newest_odometry(monitor: SourceMonitor) -> None:
    metrics = monitor.quality(T0 + 4 * S, T, ()).metrics
    assert (metrics["sigma_position_m"], metrics["visual_age_s"]) == pytest.approx((5.0, 4.0))
    assert metrics["sigma_rotation_rad"] == pytest.approx(np.sqrt(0.13))
    monitor.record(measured("visual_odometry", S), USED)
    monitor.record(measured("lidar_odometry", 3 * S), USED)
    assert monitor.quality(T0 + 4 * S, T, ()).metrics["visual_age_s"] == pytest.approx(1.0)
    assert monitor.quality(T0 + 2 * S, T, ()).metrics["visual_age_s"] == 0.0
