# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from evaluation.runs.lidar_slam_page import (
    covariance_table,
    draw,
    ground_table,
    laps_table,
    peer_table,
    table,
)

TIMES = {"count": 9, "min": 0.02, "median": 0.03, "p95": 0.05, "max": 0.2, "mean": 0.04}
RATE = {"degenerate": 9, "trials": 10, "interval_95": [0.55, 1.0]}


def errors(nees: dict[str, float]) -> dict[str, Any]:
    along = {"path_length_m": [0.0, 9.0], "error_m": [0.0, 0.1]}
    along |= {of + axis: [0.0, 5.0] for of in ("", "estimated_") for axis in ("x_m", "y_m")}
    return {
        "drift_percent": {"10": 0.2, "50": 0.04, "100": 0.03},
        "ate_rmse_m": 0.02,
        "ate_percent_of_path": 0.004,
        "nees": nees,
        "along": along,
    }


@pytest.fixture
def figures() -> dict[str, Any]:
    ours = {
        of: errors({"count": 3, "mean": 5.5})
        for of in ("odometry", "pose as published", "trajectory at the end")
    }
    loops = {"loops": 2, "loops_rejected": 0, "error_m": {"max": 0.03}, "error_deg": {"max": 0.1}}
    run = {
        "path_length_m": 593.0,
        "sweeps": 9,
        "loops": loops,
        "keyframes": 4,
        "cloud_mb": 1.0,
        "degraded": 1,
        "failed": 0,
    }
    simulated = {
        "lidar_traverse, seed 5": run | ours | {"cpu_s_per_sweep": TIMES, "wall_s_per_sweep": TIMES},
        "loops": {
            "keyframes": 4,
            "pairs": 12,
            "detection": {
                "pairs_within_5_m": 6,
                "proposed": 5,
                "recall_95": [0.4, 0.9],
                "proposed_in_total": 7,
                "of_these_within_10_m": 6,
                "precision_95": [0.5, 0.98],
            },
            "verification": {
                where: {"trials": 6, "correct": 6, "wrong": 0, "refused": 0, "wrong_95": [0.0, 0.4]}
                for where in ("near", "far")
            },
        },
    }
    kitti = {
        "94, 95": {"status": "OK", "moved_m": 0.5, "error_m": 0.012, "error_deg": 0.02},
        "0, 1": {"status": "OK"},
    }
    return {"simulated": simulated, "real": {"kitti_velodyne": kitti}}


def test_each_drive_is_listed_with_the_peer_on_the_same_sweeps(figures: dict[str, Any]) -> None:
    lines = table(figures).splitlines()
    assert "| lidar_traverse, seed 5, 593 m | odometry | 0.040 / 0.030 % | 2.0 cm | 0.0040 % | 5.5 |" in lines
    peer = peer_table(
        {"lidar_traverse, seed 5": errors({"count": 0}) | {"cpu_s_per_sweep": TIMES}}
    ).splitlines()
    assert peer[:2] == lines[:2]
    assert "| lidar_traverse, seed 5 | kiss-icp 1.3.0 | 0.040 / 0.030 % | 2.0 cm | 0.0040 % | – |" in peer


def test_a_missing_peer_is_reported() -> None:
    assert "CDFF_PEER_PYTHON" in peer_table({})


def test_the_page_is_reproducible_from_stored_figures(figures: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "figures.json").write_text(json.dumps(figures))
    read = json.loads((tmp_path / "figures.json").read_text())
    assert table(read) == table(figures)
    assert draw(read) == draw(figures)


def test_the_nees_is_listed_with_its_band() -> None:
    row = {
        "drives": 50,
        "seconds": 16.0,
        "mean_nees": 5.9,
        "nees": {"median": 5.0, "max": 19.0},
        "band_95": [5.1, 7.0],
        "mean_sigma_m": 0.01,
        "mean_sigma_deg": 0.05,
    }
    assert "mean NEES of 5.90 (median 5.00, greatest 19.0; the two-sided 95 % band" in covariance_table(row)


def test_plains_and_sparse_lidars_are_listed_with_their_status() -> None:
    plains = {
        "degenerate_on_the_plain": RATE,
        "degenerate_outside_the_plain": RATE,
        "seed 7, with wheel odometry": errors({"count": 3, "mean": 4.0}),
    }
    drift = {"10": 0.5, "20": 0.25}
    sparse = {
        "16 x 1800, seed 7": {"tracking": {}, "drift_percent": drift, "sweeps": {"OK": 3, "DEGRADED": 9}}
    }
    text = ground_table({"lidar_plain": plains, "sparse": sparse})
    assert "on the plain 9 of 10 (55.0 to 100.0 %)" in text
    assert "| 16 x 1800, seed 7 | defaults | 0.50 / 0.25 % | 3 / 9 / 0 |" in text


def test_laps_are_ordered_as_numbers_and_as_text() -> None:
    row = {"path_length_m": 253.0, "keyframes": 40, "edges": 50, "cloud_mb": 12.0}
    figures = {
        "lap_m": 251.3,
        "loops": 4,
        "trajectory at the end": errors({"count": 0}),
        "after_lap": {2: row, 1: row},
    }
    text = laps_table(figures)
    assert text == laps_table(json.loads(json.dumps(figures)))
    assert text.splitlines()[-2:] == [f"| {lap} | 253 m | 40 | 50 | 12.0 MB |" for lap in (1, 2)]
