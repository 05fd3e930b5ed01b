# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Computation of errors on the simulated traverse; ``make evaluate`` gives the results."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from evaluation import __main__ as command
from evaluation import position_manager
from evaluation.runs import traverse
from evaluation.runs.traverse import TraverseRun

S = 1_000_000_000
MOUNT = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.3, 0.0, 1.0])


def at(x_m: float) -> np.ndarray:
    return se3.transform(np.eye(3), [x_m, 0.0, 0.0])


@pytest.fixture
def drive() -> TraverseRun:
    """Run with true poses of 10 m along x in 10 s."""
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform.exact(MOUNT))
    truth = {k * S: at(float(k)) for k in range(11)}
    return TraverseRun(
        "mana", DfpcContext("mana", frames), cast(Any, SimpleNamespace(close=lambda: None)), truth
    )


def product(stamp_ns: int, T: np.ndarray, sigma_m: float) -> Any:
    header = SimpleNamespace(
        t1_ns=stamp_ns, seq=0, quality=SimpleNamespace(status="OK", metrics={"disparity_offset_px": -0.01})
    )
    return SimpleNamespace(
        header=header, value=SimpleNamespace(transform=UncertainTransform(T, sigma_m**2 * np.eye(6)))
    )


def test_the_evaluation_is_listed_and_its_tools_are_not() -> None:
    assert "position_manager" in command.evaluations()
    assert "traverse" not in command.evaluations()


def test_the_end_error_is_a_percentage_of_the_path_length(
    drive: TraverseRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(position_manager, "run", lambda *_, **__: [product(10 * S, at(10.2), 0.1)])
    share, squared = position_manager._error(drive, [])
    assert drive.path_length_m == pytest.approx(10.0)
    assert share == pytest.approx(0.02)
    assert squared == pytest.approx(4.0)


def test_visual_odometry_is_evaluated_by_the_camera_motion(drive: TraverseRun) -> None:
    forward = se3.inverse(MOUNT) @ at(7.9) @ MOUNT  # forward of the base is along the camera's z axis
    error_m, squared = position_manager._visual_error(
        drive, [product(2 * S, np.eye(4), 0.0), product(10 * S, forward, 0.1)]
    )
    assert error_m == pytest.approx(0.1)
    assert squared == pytest.approx(1.0)


def test_each_set_of_sources_gets_its_named_inputs(
    drive: TraverseRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    received: list[list[Sample]] = []

    def run(_dfpc: str, _context: DfpcContext, samples: list[Sample], **_parameters: Any) -> list[Any]:
        received.append(samples)
        return [product(10 * S, at(10.0), 0.1)]

    visual_poses = [product(k * S, np.eye(4), 0.1) for k in range(11)]
    monkeypatch.setattr(position_manager, "run", run)
    monkeypatch.setattr(position_manager, "visual_odometry", lambda *_: visual_poses)
    monkeypatch.setattr(traverse.TraverseRun, "samples", lambda *_: [Sample("odometry", 0, 0, None)])
    monkeypatch.setattr(position_manager, "traverse_runs", lambda: (1, [drive]))
    monkeypatch.setattr(position_manager, "SEEDS", range(2))
    monkeypatch.setattr(position_manager, "lidar_slam", lambda _drive, _port: [])
    monkeypatch.setattr(position_manager, "consistency", lambda _progress: {"drives": 50})
    report = position_manager.evaluate(cast(Any, None), lambda _text: None)
    counts = [sum(s.port == "visual_odometry" for s in samples) for samples in received]
    assert counts == [11, 10, 3, 0, 11, 11, 10, 3, 11, 0, 11, 0], (
        "wheels and IMU alone are the same for each seed"
    )
    assert report["mana"]["position_manager"]["wheels, imu"]["end_error_percent"]["count"] == 1
    assert report["mana"]["visual_odometry_sparse"]["poses"] == 22
    assert report["measurement level"] == {"drives": 50}
    assert report["mana"]["visual_odometry_sparse"]["disparity_offset_px"]["max"] == pytest.approx(0.01)
