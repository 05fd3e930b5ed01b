# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The samples of a simulated mission are repeatable and consistent with its terrain and poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from cdff_common.errors import ConflictError
from cdff_common.geometry import se3
from cdff_dev.logs import open_log
from cdff_dev.simulate.camera import StereoCamera
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.store import SIDECAR, deliver, simulated_log
from cdff_dev.simulate.traverse import Entry, levelled, simulate
from cdff_dev.simulate.world import World, cast_scene, make_world, true_heights


@pytest.fixture(scope="module")
def samples(scenario: Scenario, world: World) -> list[tuple[Entry, Any]]:
    return list(simulate(scenario, workers=0, world=world))


def samples_of(samples: list[tuple[Entry, Any]], stream: str) -> list[tuple[Entry, Any]]:
    return [(e, v) for e, v in samples if e.stream == stream]


def test_samples_are_ordered_at_the_requested_rates(
    samples: list[tuple[Entry, Any]], scenario: Scenario
) -> None:
    order = [(e.stamp_ns, e.stream) for e, _ in samples]
    assert order == sorted(order)
    counts = {
        stream: sum(e.stream == stream for e, _ in samples) for stream in {e.stream for e, _ in samples}
    }
    assert counts["/mana/imu.sample"] == 101
    assert counts["/minnie/wheels.odometry"] == 11
    assert counts["/mana/navcam.pair"] == 4
    assert counts["/mana/lidar.scan"] == 2
    assert counts["/site/truth.terrain"] == 1
    assert all(e.stamp_ns % 1000 == 0 for e, _ in samples)
    assert samples[0][0].stamp_ns == scenario.epoch_ns


def test_every_sample_is_labelled_simulated(samples: list[tuple[Entry, Any]]) -> None:
    assert {e.header.producer for e, _ in samples} == {"simulator"}
    assert all("simulated" in e.header.quality.reasons for e, _ in samples)
    assert len({e.header.id for e, _ in samples}) == len(samples)


@pytest.mark.slow
def test_the_same_scenario_gives_the_same_bytes_for_any_number_of_workers(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logs = []
    for name, workers in (("first", 0), ("second", 1)):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        logs.append(simulated_log(scenario, workers))
    first, second = ([p.read_bytes() for p in sorted(log.iterdir())] for log in logs)
    assert first == second


def test_another_seed_gives_another_world(scenario: Scenario, world: World) -> None:
    other = make_world(scenario.model_copy(update={"seed": scenario.seed + 1}))
    assert np.abs(other.relief.z_m - world.relief.z_m).max() > 0.1


def test_a_log_is_generated_once_and_linked_on_request(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cached = simulated_log(scenario, 0)
    rendered: list[int] = []
    assert simulated_log(scenario, 0, lambda completed, total: rendered.append(completed)) == cached
    assert rendered == []
    deliver(cached, tmp_path / "out")
    log = open_log(tmp_path / "out")
    assert log.streams["/mana/navcam.pair"].count == 4
    log.close()
    assert (tmp_path / "out" / SIDECAR).is_file()
    with pytest.raises(ConflictError, match="--force"):
        deliver(cached, tmp_path / "out")
    deliver(cached, tmp_path / "out", force=True)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work", encoding="utf-8")
    with pytest.raises(ConflictError, match=r"thesis\.txt"):
        deliver(cached, tmp_path / "mine", force=True)


def test_a_replaced_log_leaves_logs_whose_names_start_with_its_name(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "run_first.msg").write_bytes(b"\x80")
    log = simulated_log(scenario, 0)
    deliver(log, tmp_path / "run.msg")
    deliver(log, tmp_path / "run.msg", force=True)
    assert (tmp_path / "run_first.msg").read_bytes() == b"\x80"


def test_lidar_points_are_on_the_terrain_with_the_pose_at_their_own_time(
    samples: list[tuple[Entry, Any]], scenario: Scenario, world: World
) -> None:
    import open3d as o3d

    scene = cast_scene(world.relief, world.rocks)
    for robot in scenario.robots:
        for entry, scan in samples_of(samples, f"/{robot}/lidar.scan"):
            assert (scan.t0_ns, scan.t1_ns) == (entry.header.t0_ns, entry.stamp_ns)
            t_s = (scan.t0_ns - scenario.epoch_ns) * 1e-9 + scan.time_offset_us * 1e-6
            T = world.motions[robot].poses(t_s) @ scenario.lidar.mount.matrix()
            points_site = np.einsum("nij,nj->ni", T[:, :3, :3], scan.points_m) + T[:, :3, 3]
            gap_m = scene.compute_distance(
                o3d.core.Tensor(points_site.astype(np.float32)), nthreads=1
            ).numpy()
            assert len(points_site) > 100
            assert gap_m.max() < 6 * scenario.lidar.range_sigma_m
            assert np.sqrt(np.mean(gap_m**2)) < 1.2 * scenario.lidar.range_sigma_m


def test_image_disparity_agrees_with_the_true_depth(
    samples: list[tuple[Entry, Any]], scenario: Scenario, world: World
) -> None:
    vertices, triangles = world.relief.mesh()
    scene = cast_scene(world.relief, world.rocks)
    camera = StereoCamera(
        scenario.navcam, scene, world.appearance, len(vertices), (triangles, world.rocks.triangles)
    )
    entry, pair = samples_of(samples, "/mana/navcam.pair")[0]
    t_s = np.array([(entry.stamp_ns - scenario.epoch_ns) * 1e-9])
    depth = camera.depth(world.motions["mana"].poses(t_s)[0] @ scenario.navcam.T_base_left)
    assert pair.baseline == pytest.approx(scenario.navcam.baseline_m)
    left, right = pair.left.image.astype(float), pair.right.image.astype(float)
    v, u = np.mgrid[40:90, 20:120]
    disparity = scenario.navcam.focal_px * scenario.navcam.baseline_m / depth[v, u]
    assert disparity.max() > 3.0

    def mismatch(shift_px: float) -> float:
        warped = map_coordinates(right, [v, u - disparity + shift_px], order=1, mode="nearest")
        return float(np.mean((warped - left[v, u]) ** 2))

    shifts = np.arange(-2.0, 2.01, 0.25)
    assert abs(shifts[np.argmin([mismatch(s) for s in shifts])]) <= 0.25


def test_images_have_texture_and_no_saturation(samples: list[tuple[Entry, Any]]) -> None:
    for _, pair in samples_of(samples, "/minnie/navcam.pair"):
        ground = pair.left.image[48:]
        assert 60 < ground.mean() < 190
        assert ground.std() > 6
        assert (ground == 255).mean() < 0.01


def test_the_reference_map_is_the_terrain_with_rocks(samples: list[tuple[Entry, Any]], world: World) -> None:
    ((_, terrain),) = samples_of(samples, "/site/truth.terrain")
    grid = terrain.geometry
    assert (grid.frame, grid.resolution_m) == ("site", 0.05)
    rows, columns = np.mgrid[5 : grid.rows : 37, 5 : grid.cols : 37]
    x = grid.xmin_m + (columns + 0.5) * grid.resolution_m
    y = grid.ymax_m - (rows + 0.5) * grid.resolution_m
    ground = world.relief.height(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(x.shape)
    above = terrain.layer("mean")[rows, columns] - ground
    assert np.median(np.abs(above)) < 5e-3
    assert above.min() > -0.05
    coarse = true_heights(world, 0.2)
    assert np.all(coarse["min"] <= coarse["mean"])
    assert np.all(coarse["mean"] <= coarse["max"])


def test_the_start_pose_is_level_with_the_heading_of_the_rover(scenario: Scenario, world: World) -> None:
    for robot, drive in scenario.robots.items():
        true = world.motions[robot].poses(np.zeros(1))[0]
        T = levelled(true)
        np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-12)
        assert np.degrees(np.arctan2(T[1, 0], T[0, 0])) == pytest.approx(drive.heading_deg, abs=1e-6)
        np.testing.assert_allclose(T[:3, 3], true[:3, 3])
        assert se3.rotation_angle(T[:3, :3].T @ true[:3, :3]) < 0.3
