# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scans of a lidar in orbit: geometry, motion during a scan, mixed echoes and noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_dev.simulate.orbit.scans import LidarSimulator
from cdff_dev.simulate.orbit.world import OrbitWorld
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario

EXACT = {"range_sigma_m": 0.0, "detection_threshold": 0.0, "divergence_deg": 0.0}


def simulator(lidar: dict[str, Any] | None = None, **changes: Any) -> LidarSimulator:
    """Return the lidar of the small scenario with changed values."""
    settings = {f"servicer__lidars__lidar__{k}": v for k, v in (lidar or {}).items()}
    return LidarSimulator(OrbitWorld(small_scenario(**settings, **changes)), "lidar")


def distances_to_surface(lidar: LidarSimulator, points_m: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Return the distances (n,) of points (n, 3) in lidar axes at times (n,) from the mesh of the client."""
    import open3d as o3d

    T = se3.inverse(lidar.world.motion.poses_in_base("client", t_s))
    on_body = np.einsum("nij,nj->ni", T[:, :3, :3], points_m) + T[:, :3, 3]
    mesh = lidar.world.meshes["client"]
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(mesh.vertices_m.astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
    )
    return scene.compute_distance(o3d.core.Tensor.from_numpy(on_body.astype(np.float32))).numpy()


def test_each_point_is_on_the_surface_at_its_own_time() -> None:
    fast = {"client__attitude__rate_deg_s": [0.0, 10.0, 0.0]}
    lidar = simulator(EXACT, **fast)
    scan = lidar.scan(2.0, 0)
    assert len(scan.points_m) > 150
    times_s = 2.0 + scan.time_offset_us * 1e-6
    assert np.diff(scan.time_offset_us.astype(int)).min() >= 0
    assert distances_to_surface(lidar, scan.points_m, times_s).max() < 1e-3
    at_end = distances_to_surface(lidar, scan.points_m, np.full(len(times_s), 3.0))
    assert np.percentile(at_end, 90) > 0.01  # the motion during the scan distorts it


def test_a_flash_sees_all_points_at_one_time() -> None:
    lidar = simulator(
        EXACT | {"kind": "flash", "scan_s": None}, client__attitude__rate_deg_s=[0.0, 10.0, 0.0]
    )
    scan = lidar.scan(2.0, 0)
    assert not scan.time_offset_us.any()
    assert distances_to_surface(lidar, scan.points_m, np.full(len(scan.points_m), 2.0)).max() < 1e-3


def test_range_noise_grows_with_distance_and_inclination() -> None:
    noisy = {
        "range_sigma_m": 0.02,
        "detection_threshold": 0.0,
        "divergence_deg": 0.0,
        "kind": "flash",
        "scan_s": None,
    }
    near, far = (
        np.concatenate(
            [
                np.linalg.norm(noise.scan(0.0, k).points_m, axis=1)
                - np.linalg.norm(exact.scan(0.0, k).points_m, axis=1)
                for k in range(3)
            ]
        ).std()
        for noise, exact in (
            (
                simulator(noisy, servicer__start_m=[d, 0.0, 0.0]),
                simulator(noisy | {"range_sigma_m": 0.0}, servicer__start_m=[d, 0.0, 0.0]),
            )
            for d in (-10.0, -20.0)
        )
    )
    assert 0.005 < near < far
    assert far > 1.2 * near


def test_beams_across_an_edge_give_mixed_ranges() -> None:
    wide = EXACT | {"divergence_deg": 1.0, "kind": "flash", "scan_s": None}
    lidar = simulator(wide)
    scan = lidar.scan(0.0, 0)
    off = distances_to_surface(lidar, scan.points_m, np.zeros(len(scan.points_m)))
    assert 3 < (off > 0.05).sum() < 0.5 * len(off)


def test_weak_echoes_are_lost_and_false_ones_are_added() -> None:
    flash = {"kind": "flash", "scan_s": None}
    all_echoes = len(simulator(flash | {"detection_threshold": 0.0}).scan(0.0, 0).points_m)
    strong = len(simulator(flash | {"detection_threshold": 0.3}).scan(0.0, 0).points_m)
    assert 0 < strong < 0.9 * all_echoes
    false = simulator(flash | {"false_alarms": 0.1, "detection_threshold": 1e9}).scan(0.0, 0)
    assert len(false.points_m) == pytest.approx(0.1 * 48 * 64, rel=0.2)
    ranges = np.linalg.norm(false.points_m, axis=1)
    assert ranges.min() >= 0.3
    assert ranges.max() <= 500.0


def test_a_lidar_needs_no_light_and_a_scan_is_repeatable() -> None:
    dark = simulator(lighting={"sun": {"phase_deg": 180.0}, "earthshine": False})
    scan = dark.scan(0.0, 0)
    assert len(scan.points_m) > 100
    np.testing.assert_array_equal(dark.scan(0.0, 0).points_m, scan.points_m)
    assert (
        len(dark.scan(0.0, 1).points_m) != len(scan.points_m)
        or (dark.scan(0.0, 1).points_m != scan.points_m).any()
    )


def test_the_first_row_is_above_and_the_first_column_to_the_left() -> None:
    directions = simulator().directions.reshape(48, 64, 3)
    assert directions[0, 0, 2] > 0.1 > -0.1 > directions[-1, 0, 2]
    assert directions[0, 0, 1] > 0.1 > -0.1 > directions[0, -1, 1]
