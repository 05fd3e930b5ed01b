# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two replays of elevation mapping give equal bytes and the recorded heights."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import LidarScan, TransformWithCovariance
from cdff_dev.logs import LogWriter, open_log

pytestmark = pytest.mark.golden

MS = 1_000_000
#: Patches; of the last patch: cells, and means of the layers mean (m), variance and error_variance (m²).
REFERENCE = (3, 11367, 9.2597e-3, 6.9587e-5, 9.1452e-5)


def ground_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the true heights."""
    return 0.3 * np.sin(0.7 * x) * np.cos(0.5 * y)


def T_site_base(t_ns: np.ndarray | int) -> np.ndarray:
    """Return the true poses: 0.5 m/s along x, 1 m above the mean ground, with a small roll and a slow yaw."""
    t_s = np.asarray(t_ns) * 1e-9
    zero = np.zeros_like(t_s)
    rotation = se3.exp_so3(np.stack([0.03 * np.sin(t_s), zero, 0.05 * t_s], axis=-1))
    return se3.transform(rotation, np.stack([0.5 * t_s, zero, zero + 1.0], axis=-1))


def sweep(rng: np.random.Generator, t1_ns: int) -> LidarScan:
    """Return 6000 ground points within 8 m, each in the base frame at its own time, with 1 cm of noise."""
    offset_us = np.sort(rng.integers(0, 400_000, 6000)).astype(np.uint32)
    xy = rng.uniform(-8.0, 8.0, (6000, 2)) + T_site_base(t1_ns)[:2, 3]
    points = np.column_stack([xy, ground_m(*xy.T) + rng.normal(0.0, 0.01, 6000)])
    t0_ns = t1_ns - 400 * MS
    T_base_site = se3.inverse(T_site_base(t0_ns + offset_us.astype(np.int64) * 1000))
    points_base = np.einsum("nij,nj->ni", T_base_site[:, :3, :3], points) + T_base_site[:, :3, 3]
    return LidarScan.from_arrays(
        points_base.astype(np.float32), offset_us, frame="mana/base", t0_ns=t0_ns, t1_ns=t1_ns
    )


@pytest.mark.req("CDFF-CORE-071")
def test_sweeps_give_repeatable_maps_with_the_recorded_heights(tmp_path: Path) -> None:
    rng = np.random.default_rng(20260801)
    covariance = np.diag([1e-4, 1e-4, 1e-5, 1e-6, 1e-6, 1e-6])
    with LogWriter(tmp_path / "drive.msg") as log:
        for t_ns in range(0, 6001 * MS, 50 * MS):
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(T_site_base(t_ns), covariance),
                parent="site",
                child="mana/base",
                stamp_ns=t_ns,
            )
            log.write("/mana/position_manager.pose", pose, t_ns)
            if t_ns and t_ns % (500 * MS) == 0:
                log.write("/mana/lidar.scan", sweep(rng, t_ns), t_ns)
    wiring = ["--map", "scan=/mana/lidar.scan", "--map", "poses=/mana/position_manager.pose"]
    for out in ("a", "b"):
        command = ["replay", str(tmp_path / "drive.msg"), "--dfpc", "digital_elevation_mapping", *wiring]
        assert main([*command, "--out", str(tmp_path / out)]) == 0
    assert (tmp_path / "a" / "outputs.msg").read_bytes() == (tmp_path / "b" / "outputs.msg").read_bytes()
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as log:
        maps = [s.value for s in log.samples(["/mana/digital_elevation_mapping.map"])]
    last_map = maps[-1]
    observed = np.isfinite(last_map.layer("mean"))
    layer_means = [float(np.nanmean(last_map.layer(name))) for name in ("mean", "variance", "error_variance")]
    x, y = last_map.geometry.centres_m()
    assert np.sqrt(np.mean((last_map.layer("mean") - ground_m(x, y))[observed] ** 2)) < 0.015
    assert (len(maps), int(observed.sum())) == REFERENCE[:2]
    np.testing.assert_allclose(layer_means, REFERENCE[2:], rtol=1e-3)
