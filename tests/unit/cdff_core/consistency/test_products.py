# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products of a DFPC whose sensors disagree, stepped by the runner of host and replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product, Quality, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_core.runtime import Runner
from tests.support.sensor_drive import MOUNTS, T0, Drive, context

UPSIDE_DOWN = MOUNTS["lidar"] @ se3.transform(se3.exp_so3([np.pi, 0.0, 0.0]), [0, 0, 0])


def in_frame(scan: LidarScan, frame: str) -> LidarScan:
    return replace(scan, metadata=replace(scan.metadata, frame_id=frame))


def products(samples: list[Sample], dfpc: str, stated: Mapping[str, np.ndarray]) -> list[Product]:
    compound = Registry.default().make_dfpc(dfpc)
    compound.configure({}, context(stated))
    runner = Runner(compound)
    out = []
    for sample in samples:
        runner.push(sample)
        out += list(runner.drain())
    return out


@pytest.fixture(scope="module")
def captures() -> list[Sample]:
    return Drive(duration_s=14.0).samples("scan", "poses")


def test_maps_of_a_lidar_upside_down_are_degraded_within_ten_seconds_of_driving(
    captures: list[Sample],
) -> None:
    maps = products(captures, "digital_elevation_mapping", {"lidar": UPSIDE_DOWN})
    late = [p for p in maps if p.header.t1_ns >= T0 + 12_000_000_000 and p.value is not None]
    assert late
    for product in late:
        assert product.header.quality.status is Status.DEGRADED
        assert any(r.startswith("sensor_rotation:lidar_") for r in product.header.quality.reasons)


def test_maps_of_the_right_mount_have_no_reason_of_a_sensor(captures: list[Sample]) -> None:
    maps = products(captures, "digital_elevation_mapping", {})
    assert maps
    assert not [r for p in maps for r in p.header.quality.reasons if r.startswith("sensor_")]


def test_a_map_from_a_pose_with_a_wrong_sensor_inherits_the_reason(captures: list[Sample]) -> None:
    reason = "sensor_rotation:imu_90_deg"
    marked = [
        Sample(s.port, s.stamp_ns, s.seq, s.value, s.id, s.frame, s.child, Quality.from_reasons([reason]))
        if s.port == "poses"
        else s
        for s in captures
    ]
    maps = products(marked, "digital_elevation_mapping", {})
    assert maps
    assert all(reason in p.header.quality.reasons for p in maps if p.value is not None)


def test_maps_of_sweeps_in_an_unknown_frame_fail_with_the_frame_instead_of_silence(
    captures: list[Sample],
) -> None:
    renamed = [replace(s, value=in_frame(s.value, "mana/lidr")) if s.port == "scan" else s for s in captures]
    maps = products(renamed, "digital_elevation_mapping", {})
    failed = [p for p in maps if p.header.quality.status is Status.FAILED]
    assert failed
    assert any(r.startswith("dropped_no_extrinsics") for r in failed[-1].header.quality.reasons)
    assert "sensor_frame:lidar_mana/lidr" in failed[-1].header.quality.reasons
