# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A small valid profile as text, and copies of it with one mistake each."""

from __future__ import annotations

from pathlib import Path

SMALL_PROFILE = """\
name: small
body: {name: moon}
robots:
  - id: pico
    limits:
      max_slope_deg: 20.0
      width_m: 0.8
    frames:
      - {parent: site, child: pico/odom}
      - {parent: pico/base, child: pico/mast, translation_m: [0.2, 0.0, 0.6]}
      - {parent: pico/mast, child: pico/lidar, translation_m: [0.0, 0.0, 0.2], rpy_deg: [0, 12, 0]}
      - {parent: pico/mast, child: pico/left, quaternion_xyzw: [-0.5, 0.5, -0.5, 0.5]}
      - {parent: pico/left, child: pico/right, translation_m: [0.12, 0.0, 0.0]}
      - {parent: pico/base, child: pico/imu, translation_m: [0.0, 0.0, 0.1]}
    sensors:
      lidar:
        kind: lidar
        frame: pico/lidar
        streams: {scan: LidarScan}
        modes: {"off": {on: false}, nominal: {rate_hz: 2.0}}
      camera:
        kind: stereo_camera
        frame: pico/left
        streams: {pair: FramePair}
        modes: {"off": {on: false}, nominal: {rate_hz: 4.0}}
      imu:
        kind: imu
        frame: pico/imu
        streams: {sample: IMUSensors}
      wheels:
        kind: wheels
        frame: pico/base
        streams: {odometry: TransformWithCovariance}
    dfpcs:
      - name: lidar_slam
        activation: always
        inputs: {scan: sensor/lidar/scan, odometry: sensor/wheels/odometry}
        modes: {lidar: nominal}
      - name: visual_odometry_sparse
        inputs: {stereo: sensor/camera/pair, odometry: sensor/wheels/odometry}
        modes: {camera: nominal}
      - name: position_manager
        inputs:
          odometry: sensor/wheels/odometry
          imu: sensor/imu/sample
          lidar_odometry: product/lidar_slam/odometry
      - name: digital_elevation_mapping
        implementation: Lidar
        inputs: {scan: sensor/lidar/scan, poses: product/position_manager/pose}
        parameters:
          resolution_m: 0.2
          thinning: {voxel_m: 0.4}
history:
  - {sensor: lidar, stream: scan, every_n: 10}
retention:
  - {product: trajectory, max_count: 20}
"""


def with_mistake(correct: str, mistaken: str) -> str:
    """Return the small profile with its only occurrence of ``correct`` replaced."""
    assert SMALL_PROFILE.count(correct) == 1, correct
    return SMALL_PROFILE.replace(correct, mistaken)


def written(folder: Path, text: str = SMALL_PROFILE) -> Path:
    """Write a profile as ``small.yaml`` and return its path."""
    path = folder / "small.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def line_of(text: str, part: str) -> int:
    """Return the number of the first line that contains ``part``, from 1."""
    return next(number for number, line in enumerate(text.splitlines(), start=1) if part in line)
