# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor monitor: wrong mounts and clocks are found and named, good drives have no finding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.consistency.finding import Finding
from cdff_core.consistency.monitor import SensorMonitor
from tests.support.sensor_drive import MOUNTS, T0, Drive, context

#: Start of the motion, seconds after the first sample.
MOTION_S = 2.0
POSITION = ("imu", "odometry", "visual_odometry")
MAPPING = ("scan", "poses")
UPSIDE_DOWN = se3.transform(se3.exp_so3([np.pi, 0.0, 0.0]), [0, 0, 0])
TURNED = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [0, 0, 0])


def found(
    dfpc: str, drive: Drive, ports: tuple[str, ...], stated: Mapping[str, np.ndarray] | None = None
) -> tuple[SensorMonitor, dict[str, tuple[float, Finding]]]:
    """Return the monitor after a drive, and each finding with the time of driving after which it began."""
    monitor = SensorMonitor(context(stated), Registry.default().dfpc(dfpc).input_ports)
    first: dict[str, tuple[float, Finding]] = {}
    for sample in drive.samples(*ports):
        monitor.add(sample)
        for finding in monitor.findings:
            first.setdefault(finding.kind, ((sample.stamp_ns - T0) * 1e-9 - MOTION_S, finding))
    return monitor, first


@pytest.mark.parametrize(
    ("stated", "least_deg", "most_deg"),
    [
        # The ground alone shows a tilt of 140 degrees, the motion also the rotation about its normal.
        pytest.param(MOUNTS["lidar"] @ UPSIDE_DOWN, 134.0, 180.0, id="upside down"),
        pytest.param(
            se3.transform(se3.exp_so3([0.0, -np.radians(20.0), 0.0]), [0.1, 0.0, 0.85]),
            34.0,
            46.0,
            id="wrong sign",
        ),
    ],
)
def test_a_lidar_with_a_wrong_tilt_is_found_with_expected_and_observed_rotation(
    stated: np.ndarray, least_deg: float, most_deg: float
) -> None:
    _, first = found("digital_elevation_mapping", Drive(duration_s=14.0), MAPPING, {"lidar": stated})
    after_s, finding = first["sensor_rotation"]
    assert after_s <= 10.0
    assert finding.sensors == ("lidar",)
    assert least_deg <= float(finding.value.removesuffix("_deg")) <= most_deg
    assert "expected rpy_deg" in finding.what
    assert "observed" in finding.what


@pytest.mark.parametrize(
    ("frame", "wrong", "sensor"),
    [
        pytest.param("imu", TURNED, "imu", id="IMU turned by 90 degrees"),
        pytest.param("imu", UPSIDE_DOWN, "imu", id="IMU upside down"),
        pytest.param(
            "navcam_left",
            se3.inverse(MOUNTS["navcam_left"]) @ np.eye(4),
            "navcam",
            id="camera forward-left-up",
        ),
        pytest.param(
            "navcam_left",
            se3.inverse(MOUNTS["navcam_left"]) @ se3.inverse(MOUNTS["navcam_left"]),
            "navcam",
            id="camera pose inverted",
        ),
    ],
)
def test_a_wrong_mount_is_found_and_its_sensor_named_by_comparison_with_the_others(
    frame: str, wrong: np.ndarray, sensor: str
) -> None:
    T_stated = MOUNTS[frame] @ wrong
    _, first = found("position_manager", Drive(duration_s=16.0), POSITION, {frame: T_stated})
    after_s, finding = first["sensor_rotation"]
    assert after_s <= 10.0
    assert finding.sensors == (sensor,)
    assert "sensor_clock" not in first


@pytest.mark.slow
@pytest.mark.parametrize("offset_s", [1.0, -1.0])
@pytest.mark.parametrize(
    ("dfpc", "ports", "port", "sensor"),
    [
        ("position_manager", POSITION, "imu", "imu"),
        ("digital_elevation_mapping", MAPPING, "scan", "lidar"),
    ],
)
def test_a_clock_offset_is_estimated_with_its_sigma_and_its_stream_named(
    dfpc: str, ports: tuple[str, ...], port: str, sensor: str, offset_s: float
) -> None:
    _, first = found(dfpc, Drive(duration_s=25.0, offset_s={port: offset_s}), ports)
    _after_s, finding = first["sensor_clock"]
    assert finding.sensors == (sensor,)
    assert abs(float(finding.value.removesuffix("_s")) - offset_s) < 0.15
    assert "sigma" in finding.what
    assert "sensor_rotation" not in first


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_good_drive_has_no_finding_and_mounts_and_clocks_agree(seed: int) -> None:
    for dfpc, ports in (("position_manager", POSITION), ("digital_elevation_mapping", MAPPING)):
        monitor, first = found(dfpc, Drive(seed=seed, duration_s=20.0), ports)
        assert not first
        verticals, relations = monitor.estimates()
        assert verticals
        assert relations
        for estimate in relations.values():
            assert abs(estimate.offset_s) < 4.0 * estimate.offset_sigma_s + 0.05


def test_rotations_that_the_motion_does_not_show_are_named_as_unobservable() -> None:
    """On level ground the rotation of an IMU about the vertical has no effect on gravity or heading."""
    monitor, first = found(
        "position_manager",
        Drive(relief_m=0.0, duration_s=20.0),
        ("imu", "odometry"),
        {"imu": MOUNTS["imu"] @ TURNED},
    )
    assert not first
    _, relations = monitor.estimates()
    assert "z" in relations["wheels", "imu"].unobservable


def test_a_finding_ends_when_the_sensors_agree_again() -> None:
    monitor, first = found(
        "digital_elevation_mapping", Drive(duration_s=12.0), MAPPING, {"lidar": MOUNTS["lidar"] @ UPSIDE_DOWN}
    )
    assert first
    assert monitor.findings
    monitor.reset()
    assert not monitor.findings
    assert monitor.history  # remains for the summary of a replay


def test_positions_without_a_measured_orientation_are_no_rotation() -> None:
    monitor = SensorMonitor(context(), Registry.default().dfpc("position_manager").input_ports)
    for sample in Drive(duration_s=20.0).samples("imu", "odometry", "visual_odometry"):
        if sample.port == "visual_odometry":
            T = se3.transform(np.eye(3), sample.value.transform.matrix[:3, 3])
            position = TransformWithCovariance.from_transform(
                UncertainTransform.exact(T), parent="mana/enu", child="mana/navcam_left", stamp_ns=T0
            )
            estimated = np.array([True] * 3 + [False] * 4)
            metadata = replace(position.metadata, data_estimated=estimated)
            sample = replace(sample, value=replace(position, metadata=metadata))
        monitor.add(sample)
    assert set(monitor.sources) == {"imu", "wheels"}
    assert not monitor.history
