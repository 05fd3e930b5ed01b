# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cdff_dev.evaluate._lidar_slam_page import draw, table

TIMES = {"count": 9, "min": 0.02, "median": 0.03, "p95": 0.05, "max": 0.2, "mean": 0.04}
RATE = {"flagged": 9, "trials": 10, "interval_95": [0.55, 1.0]}


def errors(nees: dict[str, float]) -> dict[str, Any]:
    along = {"way_m": [0.0, 9.0], "error_m": [0.0, 0.1]}
    along |= {of + axis: [0.0, 5.0] for of in ("", "estimated_") for axis in ("x_m", "y_m")}
    return {
        "drift_percent": {"10": 0.2, "50": 0.04, "100": 0.03}, "ate_rmse_m": 0.02, "ate_percent_of_way": 0.004,
        "nees": nees, "along": along,
    }  # fmt: skip


@pytest.fixture
def figures() -> dict[str, Any]:
    ours = {of: errors({"count": 3, "mean": 5.5}) for of in ("odometry", "pose as published", "trajectory at the end")}
    loops = {"loops": 2, "loops_rejected": 0, "error_m": {"max": 0.03}, "error_deg": {"max": 0.1}}
    run = {"way_m": 593.0, "sweeps": 9, "loops": loops, "keyframes": 4, "cloud_mb": 1.0, "degraded": 1, "failed": 0}
    simulated = {
        "lidar_traverse, seed 5": run | ours | {"cpu_s_per_sweep": TIMES, "wall_s_per_sweep": TIMES},
        "kiss-icp 1.3.0, seed 5": errors({"count": 0}) | {"cpu_s_per_sweep": TIMES},
        "loops": {
            "keyframes": 4, "pairs": 12,
            "detection": {
                "pairs_within_5_m": 6, "named": 5, "recall_95": [0.4, 0.9], "named_in_all": 7,
                "of_these_within_10_m": 6, "precision_95": [0.5, 0.98],
            },
            "verification": {
                where: {"trials": 6, "right": 6, "wrong": 0, "refused": 0, "wrong_95": [0.0, 0.4]}
                for where in ("near", "far")
            },
        },
        "short drives": {
            "drives": 50, "seconds": 16.0, "mean_nees": 5.9, "nees": {"median": 5.0}, "band_95": [5.1, 7.0],
            "mean_sigma_m": 0.01, "mean_sigma_deg": 0.05,
        },
        "lidar_plain": {
            "sweeps_on_the_plain_flagged": RATE, "sweeps_off_it_flagged": RATE,
            "seed 7, with wheel odometry": errors({"count": 3, "mean": 4.0}),
        },
        "laps": {
            "by_way_m": {way: {"keyframes": 3, "cloud_mb": 2.0} for way in (50, 1000)},
            "trajectory at the end": errors({"count": 0}),
        },
    }  # fmt: skip
    kitti = {"94, 95": {"status": "OK", "moved_m": 0.5, "error_m": 0.012, "error_deg": 0.02}, "0, 1": {"status": "OK"}}
    return {"simulated": simulated, "real": {"kitti_velodyne": kitti}}


def test_each_drive_stands_beside_the_peer_on_the_same_sweeps(figures: dict[str, Any]) -> None:
    lines = table(figures).splitlines()
    assert "| lidar_traverse, seed 5, 593 m | odometry | 0.040 / 0.030 % | 2.0 cm | 0.0040 % | 5.5 |" in lines
    assert "| lidar_traverse, seed 5 | kiss-icp 1.3.0 | 0.040 / 0.030 % | 2.0 cm | 0.0040 % | – |" in lines
    assert any(line.startswith("**Covariance**, 50 drives") for line in lines)


def test_the_page_is_the_same_from_figures_that_were_written_and_read(figures: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "figures.json").write_text(json.dumps(figures))
    read = json.loads((tmp_path / "figures.json").read_text())
    assert table(read) == table(figures)
    assert draw(read) == draw(figures)


def test_the_drawing_has_a_curve_for_the_peer_where_it_ran(figures: dict[str, Any]) -> None:
    with_peer = draw(figures)
    del figures["simulated"]["kiss-icp 1.3.0, seed 5"]
    assert with_peer.count(b"kiss-icp") == 1
    assert b"kiss-icp" not in draw(figures)
    assert "kiss-icp" not in table(figures)
