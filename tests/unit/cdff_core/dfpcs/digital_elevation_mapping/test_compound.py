# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from cdff_common.errors import ConfigurationError, InputError, ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import (
    Array3D,
    ElevationMap,
    FramePair,
    LidarScan,
    Pointcloud,
    TransformWithCovariance,
)
from cdff_core.dfpcs.digital_elevation_mapping.compound import DigitalElevationMapping

MS = 1_000_000
T_BASE_LIDAR = se3.transform(se3.exp_so3([0.0, 0.15, 0.3]), [0.2, 0.0, 1.1])
COVARIANCE = np.diag([0.01, 0.01, 0.02, 0.002, 0.002, 0.004]) ** 2


def terrain_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(0.8 * x) + 0.05 * y


def pose_at(t_ns: ArrayLike) -> np.ndarray:
    """Return ``T_site_base`` of a pitching rover on a curve at 0.5 m/s and 0.3 rad/s."""
    t = np.asarray(t_ns) / 1e9
    yaw, zero = 0.3 * t, np.zeros_like(t)
    tilt = np.stack([0.05 * np.sin(2.0 * t), 0.08 * np.sin(3.0 * t), zero], -1)
    R = se3.exp_so3(np.stack([zero, zero, yaw], -1)) @ se3.exp_so3(tilt)
    return se3.transform(
        R, np.stack([0.5 / 0.3 * np.sin(yaw), 0.5 / 0.3 * (1 - np.cos(yaw)), 0.05 * np.sin(t)], -1)
    )


def sweep(rng: np.random.Generator, t1_ns: int, n: int = 2000, duration_ns: int = 100 * MS) -> LidarScan:
    """Return points of the terrain, each in the lidar's frame at its own time."""
    t0_ns = t1_ns - duration_ns
    offset_us = np.sort(rng.integers(0, duration_ns // 1000 + 1, n))
    centre = pose_at(t1_ns)[:2, 3]
    xy = centre + rng.uniform(-4, 4, (n, 2))
    site = np.column_stack([xy, terrain_m(xy[:, 0], xy[:, 1]), np.ones(n)])
    T_lidar_site = se3.inverse(pose_at(t0_ns + 1000.0 * offset_us) @ T_BASE_LIDAR)
    points = np.einsum("nij,nj->ni", T_lidar_site, site)[:, :3]
    return LidarScan.from_arrays(points, offset_us, frame="mana/lidar", t0_ns=t0_ns, t1_ns=t1_ns)


def dem(implementation: str = "Lidar", frames: bool = True, **config: Any) -> DigitalElevationMapping:
    graph = FrameGraph()
    if frames:
        graph.set_static("mana/base", "mana/lidar", UncertainTransform.exact(T_BASE_LIDAR))
    result = DigitalElevationMapping()
    result.configure({"resolution_m": 0.1, **config}, DfpcContext("mana", graph), implementation)
    return result


def pose(
    t_ns: int,
    covariance: np.ndarray | None = COVARIANCE,
    quality: Quality | None = None,
    parent: str = "site",
) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(pose_at(t_ns), covariance), parent=parent, child="mana/base", stamp_ns=t_ns
    )
    return Sample("poses", t_ns, t_ns // (20 * MS), value, id=f"pose-{t_ns}", quality=quality or Quality())


def scan(rng: np.random.Generator, t1_ns: int, **kwargs: Any) -> Sample:
    return Sample("scan", t1_ns, t1_ns // (100 * MS), sweep(rng, t1_ns, **kwargs), id=f"scan-{t1_ns}")


def drive(
    node: DigitalElevationMapping, rng: np.random.Generator, seconds: float, late_ns: int = 0
) -> list[Output]:
    """Process sweeps at 10 Hz and poses at 50 Hz that arrive ``late_ns`` late; return the outputs."""
    end = round(seconds * 1000) * MS
    events = [(t, scan(rng, t)) for t in range(100 * MS, end + 1, 100 * MS)]
    events += [(t + late_ns, pose(t)) for t in range(0, end + 1, 20 * MS)]
    outputs: list[Output] = []
    for _, sample in sorted(events, key=lambda e: (e[0], e[1].port)):
        outputs += node.step(sample)
    return [*outputs, *node.finish()]


def maps(outputs: list[Output]) -> list[Output]:
    return [o for o in outputs if o.port == "map"]


def statistics(dem: ElevationMap) -> CellStatistics:
    return CellStatistics.from_layers(dem.geometry, {n: dem.layer(n) for n in dem.layer_names}, dem.t1_ns)


def height_errors_m(dem: ElevationMap) -> np.ndarray:
    x, y = dem.geometry.centres_m()
    return (dem.layer("mean") - terrain_m(x, y))[np.isfinite(dem.layer("mean"))]


@pytest.mark.req("CDFF-CORE-071")
def test_a_map_from_sweeps_of_a_rotating_rover_has_no_bias(rng: np.random.Generator) -> None:
    result = maps(drive(dem(), rng, 2.0))[0].value
    errors = height_errors_m(result)
    assert abs(errors.mean()) < 0.001
    # Points are not centred in their cells of 0.1 m, on slopes of up to 5 degrees.
    assert np.sqrt(np.mean(errors**2)) < 0.006


def test_a_sweep_with_only_one_pose_is_used_without_deskewing_and_reported(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1 << 30))
    node = dem()
    node.step(pose(1000 * MS))
    one_pose = maps([*node.step(scan(np.random.default_rng(seed), 1000 * MS)), *node.finish()])[0]
    for t in range(880, 1001, 20):
        node.step(pose(t * MS))
    many_poses = maps([*node.step(scan(np.random.default_rng(seed), 1000 * MS)), *node.finish()])[0]
    assert one_pose.quality.status is Status.DEGRADED
    assert "not_deskewed:one_pose" in one_pose.quality.reasons
    assert np.std(height_errors_m(one_pose.value)) > 2 * np.std(height_errors_m(many_poses.value))


def test_patches_fuse_to_the_statistics_of_all_measurements(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1 << 30))
    patches = maps(drive(dem(patch_period_s=0.3, align=False), np.random.default_rng(seed), 2.0))
    whole_map = maps(drive(dem(patch_period_s=1e6, patch_distance_m=1e6), np.random.default_rng(seed), 2.0))
    assert len(patches) > 4
    assert len(whole_map) == 1
    g = whole_map[0].value.geometry
    fused = CellStatistics.empty(GridGeometry.aligned("site", g.resolution_m, g.bounds))
    for output in patches:
        fused.add(statistics(output.value))
    at_once = statistics(whole_map[0].value)
    np.testing.assert_array_equal(fused.count, at_once.count)
    for name in ("mean", "minimum", "maximum"):
        np.testing.assert_allclose(getattr(fused, name), getattr(at_once, name), atol=1e-6, err_msg=name)
    np.testing.assert_allclose(fused.variance, at_once.variance, atol=1e-6)
    np.testing.assert_allclose(fused.newest_ns, at_once.newest_ns, atol=100, rtol=0)


def test_no_measurement_is_part_of_two_patches(rng: np.random.Generator) -> None:
    outputs = maps(drive(dem(patch_period_s=0.25), rng, 1.5))
    scans = [i for o in outputs for i in o.inputs if i.startswith("scan")]
    assert len(scans) == len(set(scans)) == 15
    for earlier, later in pairwise(outputs):
        assert earlier.t1_ns <= later.t0_ns + 100 * MS
    assert sum(o.quality.metrics["points"] for o in outputs) == sum(
        np.nansum(o.value.layer("count")) for o in outputs
    )


@pytest.mark.req("CDFF-CORE-071")
def test_cells_without_points_are_nan(rng: np.random.Generator) -> None:
    out = maps(drive(dem(resolution_m=0.02), rng, 0.5))[0]
    unobserved = np.isnan(out.value.layer("mean"))
    assert unobserved.mean() > 0.5
    for name in out.value.layer_names:
        np.testing.assert_array_equal(np.isnan(out.value.layer(name)), unobserved, err_msg=name)
    assert out.quality.metrics["cells"] == np.count_nonzero(~unobserved)


def test_sweeps_wait_for_late_poses(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1 << 30))
    prompt = maps(drive(dem(), np.random.default_rng(seed), 1.0))
    late = maps(drive(dem(), np.random.default_rng(seed), 1.0, late_ns=700 * MS))
    assert [o.quality.status for o in late] == [Status.OK]
    assert late[0].value == prompt[0].value


def test_a_full_queue_drops_the_oldest_and_reports_it(rng: np.random.Generator) -> None:
    node = dem(max_waiting=3)
    outputs: list[Output] = []
    for k in range(1, 6):
        outputs += node.step(scan(rng, k * 100 * MS, n=200))
    assert [o.quality.reasons for o in maps(outputs)] == [("dropped_queue_full:1", "no_measurements")]
    for t in range(0, 501, 20):
        outputs += node.step(pose(t * MS))
    out = maps([*outputs, *node.finish()])[-1]
    assert out.quality.status is Status.DEGRADED
    assert "dropped_queue_full:1" in out.quality.reasons
    assert out.quality.metrics["captures"] == 3


def test_captures_without_poses_fail_with_the_reason(rng: np.random.Generator) -> None:
    node = dem(max_waiting=2)
    outputs: list[Output] = []
    for k in range(1, 40):
        outputs += node.step(scan(rng, k * 100 * MS, n=50))
    assert outputs, "no output states the reason while poses are missing"
    outputs += node.finish()
    assert all(o.value is None and o.quality.status is Status.FAILED for o in outputs)
    assert "dropped_not_covered_by_poses:2" in outputs[-1].quality.reasons


def test_the_variance_contains_the_covariance_of_the_poses(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1 << 30))

    def map_with(pose_covariance: np.ndarray | None) -> Output:
        node = dem()
        for t in range(0, 101, 20):
            node.step(pose(t * MS, pose_covariance))
        sweep_noise = np.random.default_rng(seed)
        return maps([*node.step(scan(sweep_noise, 100 * MS)), *node.finish()])[0]

    exact = map_with(np.zeros((6, 6)))
    uncertain = map_with(np.diag([0, 0, 0.04, 0, 0, 0]) ** 2)
    unknown = map_with(None)
    difference_m2 = uncertain.value.layer("variance") - exact.value.layer("variance")
    np.testing.assert_allclose(difference_m2[np.isfinite(difference_m2)], 0.0016, atol=1e-7)
    assert uncertain.quality.metrics["pose_height_sigma_m"] == pytest.approx(0.04)
    assert uncertain.quality.covariance_kind is CovarianceKind.FORMAL
    assert unknown.quality.covariance_kind is CovarianceKind.NONE
    assert "pose_covariance_unknown" in unknown.quality.reasons
    np.testing.assert_array_equal(unknown.value.layer("variance"), exact.value.layer("variance"))


def test_an_uncertain_tilt_increases_the_variance_of_distant_cells(rng: np.random.Generator) -> None:
    node = dem(max_range_m=10.0)
    for t in range(0, 101, 20):
        node.step(pose(t * MS, np.diag([0, 0, 0, 0.05, 0.05, 0]) ** 2))
    result = maps([*node.step(scan(rng, 100 * MS)), *node.finish()])[0].value
    x, y = result.geometry.centres_m()
    distance, sigma = np.hypot(x, y), np.sqrt(result.layer("variance"))
    assert np.nanmedian(sigma[(distance > 3.0) & (distance < 4.0)]) == pytest.approx(0.05 * 3.5, rel=0.1)
    assert np.nanmedian(sigma[distance < 1.5]) < 0.05 * 1.5 + 0.01


def test_points_outside_the_range_and_height_gates_are_removed(rng: np.random.Generator) -> None:
    node = dem(min_range_m=2.0, max_range_m=3.0, max_height_m=-1.1)
    outputs = maps(drive(node, rng, 0.5))
    result = outputs[0].value
    assert outputs[0].quality.metrics["points_gated"] > 0
    x, y = result.geometry.centres_m()
    observed = np.isfinite(result.layer("mean"))
    assert np.hypot(x, y)[observed].max() < 3.5
    lidar_height_m, margin_m = T_BASE_LIDAR[2, 3], 0.15
    assert np.nanmax(result.layer("max")) < lidar_height_m - 1.1 + margin_m


def test_a_cloud_without_poses_is_mapped_in_its_own_frame(rng: np.random.Generator) -> None:
    points = np.column_stack([rng.uniform(0, 5, (3000, 2)), rng.normal(0, 0.1, 3000)])
    node = dem(resolution_m=0.5)
    cloud = Pointcloud.from_points(points, frame="site", stamp_ns=7000)
    assert list(node.step(Sample("cloud", 7000, 0, cloud))) == []
    out = maps(list(node.finish()))[0]
    direct = CellStatistics.from_points(out.value.geometry, points, stamps_ns=7000).to_layers(7000)
    assert (out.frame, out.quality.status, out.t1_ns) == ("site", Status.OK, 7000)
    for name in direct:
        np.testing.assert_array_equal(out.value.layer(name), direct[name])


def test_the_mount_in_a_cloud_is_used_if_the_profile_has_none(
    rng: np.random.Generator,
) -> None:
    node = dem(frames=False, min_range_m=0.0)
    xy = rng.uniform(-3, 3, (2000, 2))
    site = np.column_stack([xy, terrain_m(*xy.T)])
    t = 300 * MS
    points = se3.transform_points(se3.inverse(pose_at(t) @ T_BASE_LIDAR), site)
    T = UncertainTransform.exact(T_BASE_LIDAR)
    node.step(pose(t))
    cloud = Pointcloud.from_points(points, frame="mana/lidar", stamp_ns=t, T_robot_sensor=T)
    node.step(Sample("cloud", t, 0, cloud))
    out = maps(list(node.finish()))[0]
    assert np.abs(height_errors_m(out.value)).max() < 0.02


def test_a_sensor_with_unknown_mount_is_dropped_with_a_reason(rng: np.random.Generator) -> None:
    outputs = drive(dem(frames=False), rng, 0.3)
    assert outputs[-1].quality.status is Status.FAILED
    assert any(r.startswith("dropped_no_extrinsics") for r in outputs[-1].quality.reasons)


def test_a_gap_in_the_poses_is_not_interpolated(rng: np.random.Generator) -> None:
    node = dem(deskewing={"max_gap_s": 0.5})
    for t in (0, 1000):
        node.step(pose(t * MS))
    outputs = [*node.step(scan(rng, 500 * MS, n=50)), *node.finish()]
    assert "dropped_gap_in_poses:1" in outputs[-1].quality.reasons


def test_failed_poses_are_not_used_and_degraded_ones_degrade_the_map(rng: np.random.Generator) -> None:
    node = dem()
    node.step(Sample("poses", 0, 0, None, quality=Quality(status=Status.FAILED)))
    for t in range(0, 101, 20):
        node.step(pose(t * MS, quality=Quality(status=Status.DEGRADED)))
    out = maps([*node.step(scan(rng, 100 * MS)), *node.finish()])[0]
    assert out.quality.status is Status.DEGRADED
    assert {"dropped_failed_poses:1", "poses_degraded"} <= set(out.quality.reasons)


def test_poses_in_another_frame_end_the_patch(rng: np.random.Generator) -> None:
    node = dem()
    outputs: list[Output] = []
    for k, parent in enumerate(("site", "mana/odom")):
        for t in range(k * 1000, k * 1000 + 101, 20):
            outputs += node.step(pose(t * MS, parent=parent))
        outputs += node.step(scan(rng, (k * 1000 + 100) * MS, n=500))
    outputs += node.finish()
    assert [(o.frame, o.value.frame) for o in maps(outputs)] == [("site", "site"), ("mana/odom", "mana/odom")]


def test_the_cloud_contains_the_downsampled_measurements_of_the_patch(rng: np.random.Generator) -> None:
    outputs = drive(dem(max_cloud_points=500), rng, 1.0)
    clouds = [o for o in outputs if o.port == "cloud"]
    assert len(clouds) == len(maps(outputs))
    points = clouds[0].value.points_m
    assert 250 < len(points) <= 500
    assert np.abs(points[:, 2] - terrain_m(points[:, 0], points[:, 1])).max() < 0.01
    assert clouds[0].frame == clouds[0].value.frame == "site"


def test_the_local_map_follows_the_robot_in_bounded_memory_and_can_be_retrieved_with_coarser_cells(
    rng: np.random.Generator,
) -> None:
    node = dem(fusion={"size_m": 6.0}, patch_period_s=0.2)
    with pytest.raises(ProductNotFoundError):
        node.call("get_map", {})
    drive(node, rng, 3.0)
    local = node.call("get_map", {})
    assert local.geometry.shape == (60, 60)
    assert node.store.get("map") is local
    b, robot = local.geometry.bounds, pose_at(3000 * MS)[:2, 3]
    assert abs((b.xmin + b.xmax) / 2 - robot[0]) < 0.2
    coarse = node.call("get_map", {"resolution_m": "0.35"})
    assert coarse.geometry.resolution_m == pytest.approx(0.3)
    assert np.nansum(coarse.layer("count")) == np.nansum(local.layer("count"))


def test_the_far_map_is_returned_for_its_cell_size_and_above(rng: np.random.Generator) -> None:
    node = dem(fusion={"size_m": 6.0}, far_factor=4, patch_period_s=0.2)
    drive(node, rng, 1.0)
    far = node.call("get_map", {"resolution_m": "0.4"})
    assert far.geometry.resolution_m == pytest.approx(0.4)
    assert far.geometry.rows == 400  # 160 m; the local map covers 6 m
    assert np.nansum(far.layer("count")) > np.nansum(node.call("get_map", {}).layer("count"))
    assert node.call("get_map", {"resolution_m": "1.2"}).geometry.resolution_m == pytest.approx(1.2)


def test_the_whole_map_of_lidar_global_is_bounded_and_removed_tiles_are_reported(
    rng: np.random.Generator,
) -> None:
    node = dem(
        "LidarGlobal", fusion={"size_m": 6.0, "max_tiles": 2, "max_cells": 1 << 14}, patch_period_s=0.2
    )
    with pytest.raises(ProductNotFoundError):
        node.call("get_whole_map", {})
    outputs = maps(drive(node, rng, 1.0))
    degraded = [o.quality for o in outputs if o.quality.metrics["tiles_forgotten"]]
    assert degraded
    for quality in degraded:
        assert quality.status is Status.DEGRADED
        assert f"tiles_forgotten:{quality.metrics['tiles_forgotten']:.0f}" in quality.reasons
    whole_map = node.call("get_whole_map", {})
    assert whole_map.geometry.rows * whole_map.geometry.cols <= 1 << 14
    assert whole_map.geometry.resolution_m == pytest.approx(0.2)


def test_the_whole_map_of_lidar_global_contains_every_measurement(
    rng: np.random.Generator,
) -> None:
    node = dem("LidarGlobal", fusion={"size_m": 6.0, "clear_margin_m": 100.0}, patch_period_s=0.2)
    outputs = maps(drive(node, rng, 1.0))
    whole_map = node.call("get_whole_map", {})
    assert whole_map.geometry.resolution_m == 0.1
    assert np.nansum(whole_map.layer("count")) == sum(np.nansum(o.value.layer("count")) for o in outputs)
    assert all(o.quality.metrics["tiles_forgotten"] == 0 for o in outputs)


def test_a_patch_is_published_on_request(rng: np.random.Generator) -> None:
    node = dem(patch_period_s=1e6, patch_distance_m=1e6)
    for t in range(0, 301, 20):
        node.step(pose(t * MS))
    assert maps(list(node.step(scan(rng, 100 * MS, n=50)))) == []
    node.call("publish_patch", {})
    assert len(maps(list(node.step(scan(rng, 200 * MS, n=50))))) == 1
    assert maps(list(node.step(scan(rng, 300 * MS, n=50)))) == []


def test_reset_clears_the_state(rng: np.random.Generator) -> None:
    node = dem()
    drive(node, rng, 0.5)
    node.reset()
    assert list(node.finish()) == []
    with pytest.raises(ProductNotFoundError):
        node.store.get("map")


def test_two_runs_are_equal_bit_for_bit(rng: np.random.Generator) -> None:
    seed = int(rng.integers(1 << 30))
    first, second = (drive(dem(), np.random.default_rng(seed), 1.0) for _ in range(2))
    assert [o.value for o in first] == [o.value for o in second]


def wall(rng: np.random.Generator, lower_px: int = 0, *, exchanged: bool = False) -> FramePair:
    """Return a stereo pair of a wall 4 m away; the right image is too low, or exchanged with the left one."""
    import cv2

    texture = cv2.GaussianBlur(rng.uniform(0, 255, (200, 320)).astype(np.float32), (0, 0), 1.2)
    left = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    x, y = np.meshgrid(np.arange(320, dtype=np.float32), np.arange(200, dtype=np.float32))
    right = cv2.remap(left, x + 20, y - lower_px, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    images = (right, left) if exchanged else (left, right)
    return FramePair.from_images(
        *images,
        baseline_m=0.2,
        camera_matrix=np.array([[400.0, 0, 160], [0, 400, 100], [0, 0, 1]]),
        stamp_ns=0,
        sensor="mana/navcam_left",
        T_robot_sensor=UncertainTransform.exact(
            se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.0, 0.0, 1.0])
        ),
    )


def map_pair(pair: FramePair) -> list[Output]:
    node = dem("Stereo", frames=False, disparity={"num_disparities": 32})
    node.step(pose(0))
    return [*node.step(Sample("stereo", 0, 0, pair)), *node.finish()]


def test_a_stereo_pair_of_a_wall_gives_a_map_of_the_wall(rng: np.random.Generator) -> None:
    out = map_pair(wall(rng))
    points = next(o for o in out if o.port == "cloud").value.points_m
    assert np.median(points[:, 0]) == pytest.approx(4.0, abs=0.03)
    assert 0.0 < points[:, 2].min() < 0.3
    assert 1.8 < points[:, 2].max() < 2.1


def test_pairs_with_a_row_offset_are_degraded_and_pairs_of_two_scenes_or_without_texture_are_dropped(
    rng: np.random.Generator,
) -> None:
    (lower, *_), (exchanged, *_) = map_pair(wall(rng, 1)), map_pair(wall(rng, exchanged=True))
    assert lower.quality.status is Status.DEGRADED
    assert any(reason.startswith("row_error:1.0") for reason in lower.quality.reasons)
    assert exchanged.quality.reasons[0].startswith(("dropped_stereo_mismatch:1", "dropped_no_points:1"))
    flat = np.full((200, 320), 90, np.uint8)
    both = wall(rng)
    frame = replace(both.left, data=Array3D.from_array(flat))
    black = replace(both, left=frame, right=frame)
    (failed, *_) = map_pair(black)
    assert failed.quality.status is Status.FAILED
    assert failed.quality.reasons[0] == "dropped_no_points:1"


@pytest.mark.parametrize(
    "config",
    [
        {"resolution_m": 0.0},
        {"patch": 1},
        {"rasterisation": {"resolution_m": 0.1}},
        {"disparity": {"blocks": 3}},
        {"min_range_m": 5.0, "max_range_m": 1.0},
    ],
)
def test_a_wrong_configuration_is_refused(config: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        dem(**config)


def test_an_unknown_port_is_refused() -> None:
    with pytest.raises(InputError, match="no input port"):
        dem().step(Sample("image", 0, 0, None))
