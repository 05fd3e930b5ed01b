# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hard scenarios have separate grounds, and their errors and flags are counted correctly."""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.product import Header, Product, Quality, Status
from cdff_common.types import TransformWithCovariance
from cdff_dev.simulate.scenario import Scenario, load_scenario
from evaluation.runs.hard_drives import ROBOT, SCENARIOS, HardDrive, pose_scores, status_scores

NAMES = [*chain(*SCENARIOS.values())]
SECOND_NS = 1_000_000_000


def test_the_grounds_of_training_and_test_differ() -> None:
    scenarios = [load_scenario(name) for name in NAMES]
    assert not set(SCENARIOS["training"]) & set(SCENARIOS["test"])
    for a, b in combinations(scenarios, 2):
        assert a.seed != b.seed
        for part in ("spectrum", "rocks", "craters", "surface"):
            assert getattr(a.terrain, part) != getattr(b.terrain, part), (a.name, b.name, part)
        assert a.faults != b.faults


@pytest.mark.parametrize("name", NAMES)
def test_a_hard_scenario_has_faults_of_every_sensor(name: str) -> None:
    faults = load_scenario(name).faults
    assert faults is not None
    for sensor in ("camera", "lidar", "wheels", "imu", "timing"):
        assert getattr(faults, sensor) is not None, sensor


@pytest.fixture
def drive() -> HardDrive:
    """A rover that drives 4 m along x in 4 s, with a sensor at the base."""
    data = load_scenario(NAMES[0]).model_dump() | {"faults": None}
    data["lidar"]["mount"] = {"xyz_m": [0.0, 0.0, 0.0]}
    stamps_ns = np.arange(5) * SECOND_NS
    truth = se3.transform(np.tile(np.eye(3), (5, 1, 1)), np.column_stack([np.arange(5.0), *np.zeros((2, 5))]))
    context = DfpcContext(ROBOT, FrameGraph())
    scenario = Scenario.model_validate(data)
    return HardDrive(scenario, context, {}, stamps_ns, truth, None)  # type: ignore[arg-type]


def product(seq: int, x_m: float | None, status: Status = Status.OK) -> Product:
    stamp_ns = seq * SECOND_NS
    value = None
    if x_m is not None:
        T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), np.eye(6) * 0.01)
        value = TransformWithCovariance.from_transform(T, parent="map", child="lidar", stamp_ns=stamp_ns)
    quality = Quality(status=status, reasons=() if status is Status.OK else ("held: 3",))
    header = Header(
        id=f"p{seq}",
        seq=seq,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame="map",
        child="lidar",
        producer="test",
        config_hash="0",
        quality=quality,
    )
    return Product(ROBOT, "any", "pose", "pose", "TransformWithCovariance", header, value)


def test_truth_is_interpolated_and_constant_outside_the_drive(drive: HardDrive) -> None:
    assert drive.path_length_m == pytest.approx(4.0)
    for stamp_ns, x_m in ((SECOND_NS // 2, 0.5), (-5, 0.0), (9 * SECOND_NS, 4.0)):
        assert drive.true_pose(stamp_ns)[0, 3] == pytest.approx(x_m)


def test_errors_are_relative_to_the_first_pose_and_normalised_by_the_covariance(drive: HardDrive) -> None:
    row = pose_scores(drive, [product(0, 10.0), product(2, 12.0), product(4, 14.5)], "lidar")
    assert row["end_error_m"] == pytest.approx(0.5)
    assert row["end_error_percent"] == pytest.approx(12.5)
    assert row["squared_error_end"] == pytest.approx(25.0)
    assert row["squared_error_median"] == pytest.approx(0.0)
    assert row["ok_beyond_3_sigma"] == pytest.approx(1 / 3, abs=1e-3)
    absolute = pose_scores(drive, [product(0, 0.0), product(4, 4.1)], None)
    assert absolute["end_error_m"] == pytest.approx(0.1)


def test_flagged_and_failed_products_are_counted_and_flagged_errors_are_not_overstatements(
    drive: HardDrive,
) -> None:
    results = [product(0, 0.0), product(1, None, Status.FAILED), product(4, 6.0, Status.DEGRADED)]
    row = pose_scores(drive, results, "lidar")
    assert (row["degraded"], row["failed"]) == (pytest.approx(1 / 3, abs=1e-3),) * 2
    assert row["ok_beyond_3_sigma"] == 0.0
    assert status_scores(results)["reasons"] == {"held": 2}
