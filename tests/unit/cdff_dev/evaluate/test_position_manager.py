# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How errors on the simulated traverse are counted; the figures themselves are for ``make evaluate``."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_dev.evaluate import __main__ as command
from cdff_dev.evaluate import position_manager, traverse
from cdff_dev.evaluate.traverse import Drive

S = 1_000_000_000
MOUNT = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.3, 0.0, 1.0])


def at(x_m: float) -> np.ndarray:
    return se3.transform(np.eye(3), [x_m, 0.0, 0.0])


@pytest.fixture
def drive() -> Drive:
    """Ten metres along x in ten seconds."""
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/navcam_left", UncertainTransform(MOUNT, np.zeros((6, 6))))
    truth = {k * S: at(float(k)) for k in range(11)}
    return Drive("mana", DfpcContext("mana", frames), cast(Any, SimpleNamespace(close=lambda: None)), truth)


def product(stamp_ns: int, T: np.ndarray, sigma_m: float) -> Any:
    header = SimpleNamespace(
        t1_ns=stamp_ns, seq=0, quality=SimpleNamespace(status="OK", metrics={"disparity_offset_px": -0.01})
    )
    return SimpleNamespace(
        header=header, value=SimpleNamespace(transform=UncertainTransform(T, sigma_m**2 * np.eye(6)))
    )


def test_it_is_among_the_evaluations_and_its_tools_are_not() -> None:
    assert "position_manager" in command.evaluations()
    assert "traverse" not in command.evaluations()


def test_the_error_at_the_end_is_a_share_of_the_way(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(position_manager, "run", lambda *_: [product(10 * S, at(10.2), 0.1)])
    share, squared = position_manager._error(drive, [])
    assert drive.way_m == pytest.approx(10.0)
    assert share == pytest.approx(0.02)
    assert squared == pytest.approx(4.0)


def test_visual_odometry_is_judged_by_the_motion_of_the_camera(drive: Drive) -> None:
    forward = se3.inverse(MOUNT) @ at(7.9) @ MOUNT  # ahead of the base is along the camera's z
    error_m, squared = position_manager._visual_error(
        drive, [product(2 * S, np.eye(4), 0.0), product(10 * S, forward, 0.1)]
    )
    assert error_m == pytest.approx(0.1)
    assert squared == pytest.approx(1.0)


def test_each_set_of_sources_gets_what_it_names(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[list[Sample]] = []

    def run(_dfpc: str, _context: DfpcContext, samples: list[Sample]) -> list[Any]:
        given.append(samples)
        return [product(10 * S, at(10.0), 0.1)]

    seen = [product(k * S, np.eye(4), 0.1) for k in range(11)]
    monkeypatch.setattr(position_manager, "run", run)
    monkeypatch.setattr(position_manager, "visual_odometry", lambda *_: seen)
    monkeypatch.setattr(traverse.Drive, "samples", lambda *_: [Sample("odometry", 0, 0, None)])
    monkeypatch.setattr(position_manager, "drives", lambda: (1, [drive]))
    monkeypatch.setattr(position_manager, "SEEDS", range(2))
    monkeypatch.setattr(position_manager, "lidar_slam", lambda _drive, _port: [])
    monkeypatch.setattr(position_manager, "consistency", lambda _progress: {"drives": 50})
    report = position_manager.evaluate(cast(Any, None), lambda _text: None)
    counts = [sum(s.port == "visual_odometry" for s in samples) for samples in given]
    assert counts == [11, 10, 3, 0, 11, 11, 10, 3, 11, 0, 11, 0], "wheels and IMU alone are the same for each seed"
    assert report["mana"]["position_manager"]["wheels, imu"]["end_error_percent"]["count"] == 1
    assert report["mana"]["visual_odometry_sparse"]["poses"] == 22
    assert report["measurement level"] == {"drives": 50}
    assert report["mana"]["visual_odometry_sparse"]["disparity_offset_px"]["max"] == pytest.approx(0.01)
