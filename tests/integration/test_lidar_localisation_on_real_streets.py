# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation on measured street scans: one scan is the map, another one the sweep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.product import Status
from evaluation.data_sets.clouds import kitti_pair, small_gicp_pair
from evaluation.lidar_localisation_streets import inaccurate_guess, localise

pytestmark = pytest.mark.slow

RealData = Callable[[str], Path]


@pytest.mark.parametrize(("read", "limit_m"), [(kitti_pair, 0.02), (small_gicp_pair, 0.03)])
def test_a_guess_two_metres_and_twenty_degrees_off_is_corrected(
    real_data: RealData, read: Callable[[Path], tuple[np.ndarray, ...]], limit_m: float
) -> None:
    sweep, street, T_true = read(real_data("kitti_velodyne").parent)
    output = localise(street, sweep, inaccurate_guess(T_true, seed=1))
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    T = output.value.transform
    e = pose_error(T_true, T.matrix)
    assert np.linalg.norm(e[:3]) < limit_m
    assert e @ np.linalg.solve(T.covariance, e) < 15.0


def test_a_sweep_of_another_street_is_lost(real_data: RealData) -> None:
    _, street, _ = kitti_pair(real_data("kitti_velodyne").parent)
    elsewhere = read_kitti_bin(real_data("kitti_velodyne") / "000000.bin").points_m
    output = localise(street, elsewhere, None)
    assert output.value is None
    assert "lost" in output.quality.reasons
