# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation: tracking, relocalisation in the map, and refusal if the robot is not on the map."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import (
    ElevationMap,
    LidarMap,
    LidarScan,
    Pointcloud,
    PoseGraph,
    TransformWithCovariance,
)
from tests.support.mapped_hills import HALF_M, Hills

HILLS = Hills(3)
STEP_NS = 500_000_000


def make_configured_dfpc(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure(config)
    return dfpc


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    return HILLS.map(np.random.default_rng(0), 0.3)


def map_of(points: np.ndarray, frame: str = "site") -> Sample:
    return Sample("map", 0, 0, Pointcloud.from_points(points, frame=frame, stamp_ns=0), id="map")


def scan_at(T: np.ndarray, stamp_ns: int = 0, hills: Hills = HILLS, seed: int = 1) -> Sample:
    points = hills.scan(np.random.default_rng([seed, stamp_ns]), T).astype(np.float32)
    value = LidarScan.from_arrays(
        points, np.zeros(len(points), np.uint32), frame="rover/lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
    )
    return Sample("scan", stamp_ns, 0, value, id=f"scan-{stamp_ns}")


def pose_sample(port: str, T: np.ndarray, stamp_ns: int = 0, parent: str = "site") -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T), parent=parent, child="rover/lidar", stamp_ns=stamp_ns
    )
    return Sample(port, stamp_ns, 0, value, id=port)


def outputs(dfpc: Dfpc, *samples: Sample) -> list[Output]:
    return [output for sample in samples for output in dfpc.step(sample)]


def error(output: Output, T: np.ndarray) -> tuple[float, float]:
    """Return the position error in metres and the rotation error in degrees."""
    E = se3.inverse(T) @ output.value.transform.matrix
    return float(np.linalg.norm(E[:3, 3])), float(np.degrees(se3.rotation_angle(E[:3, :3])))


def assert_accurate(output: Output, T: np.ndarray) -> None:
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    metres, degrees = error(output, T)
    assert metres < 0.03
    assert degrees < 0.1


@pytest.mark.parametrize("seed", range(4))
def test_a_guess_wrong_by_two_metres_and_twenty_degrees_is_corrected(seed: int, ground: np.ndarray) -> None:
    rng = np.random.default_rng(seed)
    T = HILLS.pose(*rng.uniform(-15, 15, 2), rng.uniform(-np.pi, np.pi))
    direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    inaccurate = se3.transform(se3.exp_so3(np.radians(20) * axis) @ T[:3, :3], T[:3, 3] + 2.0 * direction)
    (output,) = outputs(make_configured_dfpc(), map_of(ground), pose_sample("guess", inaccurate), scan_at(T))
    assert_accurate(output, T)
    assert output.quality.status is Status.OK
    assert output.quality.covariance_kind is CovarianceKind.CALIBRATED
    assert (output.frame, output.child) == ("site", "rover/lidar")
    assert output.inputs == ("map", "guess", "scan-0")


@pytest.mark.req("CDFF-CORE-078")
def test_without_a_guess_the_whole_map_is_searched(ground: np.ndarray) -> None:
    T = HILLS.pose(9.0, -7.0, 2.0)
    (output,) = outputs(make_configured_dfpc(), map_of(ground), scan_at(T))
    assert_accurate(output, T)
    assert output.quality.reasons[0] == "relocalised"


@pytest.mark.parametrize("method", ["shape", "descriptors"])
def test_each_search_method_alone_relocalises(method: str, ground: np.ndarray) -> None:
    T = HILLS.pose(-8.0, 5.0, 1.0)
    (output,) = outputs(make_configured_dfpc(relocalise_by=(method,)), map_of(ground), scan_at(T))
    assert_accurate(output, T)
    assert output.quality.reasons[0] == "relocalised"


def test_a_robot_is_relocalised_in_a_tilted_map(ground: np.ndarray) -> None:
    T_map_site = se3.transform(se3.exp_so3(np.radians(20.0) * np.array([0.6, 0.8, 0.0])), np.zeros(3))
    T = HILLS.pose(9.0, -7.0, 2.0)
    (output,) = outputs(
        make_configured_dfpc(), map_of(se3.transform_points(T_map_site, ground), "rover/slam"), scan_at(T)
    )
    assert_accurate(output, T_map_site @ T)
    assert output.quality.reasons[0] == "relocalised"


def test_with_the_search_disabled_a_robot_without_a_guess_is_lost(ground: np.ndarray) -> None:
    (output,) = outputs(make_configured_dfpc(relocalise_by=()), map_of(ground), scan_at(HILLS.pose(0, 0, 0)))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == ("lost", "not_on_the_map")


@pytest.mark.req("CDFF-CORE-078")
def test_on_other_terrain_the_robot_is_lost(ground: np.ndarray) -> None:
    other = Hills(99)
    (output,) = outputs(make_configured_dfpc(), map_of(ground), scan_at(other.pose(0, 0, 0), hills=other))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "lost"
    assert output.value is None


def test_a_displaced_robot_is_relocalised(ground: np.ndarray) -> None:
    first, second = HILLS.pose(-10, -10, 0.0), HILLS.pose(12, 8, 2.5)
    dfpc = make_configured_dfpc()
    _, output = outputs(
        dfpc, map_of(ground), pose_sample("guess", first), scan_at(first), scan_at(second, STEP_NS)
    )
    assert_accurate(output, second)
    assert "relocalised" in output.quality.reasons


@pytest.mark.req("CDFF-CORE-078")
def test_a_run_is_tracked_with_drifting_odometry(ground: np.ndarray) -> None:
    dfpc = make_configured_dfpc(odometry_wait_s=0.0)
    true = [HILLS.pose(-8 + 0.8 * i, 0.2 * i, 0.05 * i) for i in range(6)]
    drift = se3.exp_se3([0.05, 0.02, 0.0, 0.0, 0.0, 0.01])
    odometry_poses = [np.eye(4)]
    for a, b in itertools.pairwise(true):
        odometry_poses.append(odometry_poses[-1] @ se3.inverse(a) @ b @ drift)
    samples = [map_of(ground), pose_sample("guess", true[0])]
    for i, (T, odometry) in enumerate(zip(true, odometry_poses, strict=True)):
        samples += [pose_sample("odometry", odometry, i * STEP_NS, "rover/odom"), scan_at(T, i * STEP_NS)]
    result = outputs(dfpc, *samples)
    assert len(result) == len(true)
    for output, T in zip(result, true, strict=True):
        assert_accurate(output, T)
        assert output.quality.status is Status.OK
    graph = dfpc.store.get("pose_graph")
    assert (
        len(graph.vertices.ids) == len(graph.edges.kinds) == len(dfpc.store.get("key_frames").stamps_ns) == 2
    )


def test_a_sweep_waits_for_the_odometry_of_its_time(ground: np.ndarray) -> None:
    T = HILLS.pose(0, 0, 0)
    dfpc = make_configured_dfpc()
    earlier = pose_sample("odometry", np.eye(4), STEP_NS - 100_000_000, "rover/odom")
    assert outputs(dfpc, map_of(ground), pose_sample("guess", T), earlier, scan_at(T, STEP_NS)) == []
    (output,) = outputs(dfpc, pose_sample("odometry", np.eye(4), STEP_NS, "rover/odom"))
    assert_accurate(output, T)
    outputs(dfpc, scan_at(T, 2 * STEP_NS - 300_000_000))
    (last,) = dfpc.finish()
    assert_accurate(last, T)


def test_a_sweep_taken_in_motion_is_deskewed(ground: np.ndarray) -> None:
    T1 = HILLS.pose(2, 3, 0.4)
    step = se3.exp_se3([0.3, 0.0, 0.0, 0.0, 0.0, 0.1])
    T0 = T1 @ se3.inverse(step)
    fractions = np.linspace(0.0, 1.0, 20)
    clouds = [
        HILLS.scan(np.random.default_rng(i), T0 @ se3.exp_se3(s * se3.log_se3(step)), 1000)
        for i, s in enumerate(fractions)
    ]
    offset_us = np.repeat((fractions * 100_000).astype(np.uint32), 1000)
    value = LidarScan.from_arrays(
        np.vstack(clouds).astype(np.float32), offset_us, frame="rover/lidar", t0_ns=0, t1_ns=100_000_000
    )
    odometry_poses = [
        pose_sample("odometry", T, t, "rover/odom") for t, T in ((0, np.eye(4)), (100_000_000, step))
    ]
    (output,) = outputs(
        make_configured_dfpc(),
        map_of(ground),
        pose_sample("guess", T1),
        *odometry_poses,
        Sample("scan", 100_000_000, 0, value, id="scan"),
    )
    assert_accurate(output, T1)


def test_on_flat_ground_the_prediction_constrains_the_degenerate_directions() -> None:
    flat = Hills(5, relief=0.0)
    rng = np.random.default_rng(0)
    T = flat.pose(0, 0, 0)
    (output,) = outputs(
        make_configured_dfpc(), map_of(flat.map(rng)), pose_sample("guess", T), scan_at(T, hills=flat)
    )
    assert output.quality.status is Status.DEGRADED
    assert any(r.startswith("degenerate:") for r in output.quality.reasons)
    sigma = np.sqrt(np.diag(output.value.transform.covariance))
    assert sigma[:2].min() > 0.5
    assert sigma[2] < 0.05


def test_an_elevation_map_can_be_the_map() -> None:
    geometry = GridGeometry("site", 0.25, -HALF_M, HALF_M, 320, 320)
    x = -HALF_M + 0.25 * (np.arange(320) + 0.5)
    xx, yy = np.meshgrid(x, -x)
    mean = HILLS.height(np.column_stack([xx.ravel(), yy.ravel()])).reshape(320, 320).astype(np.float32)
    mean[:5] = np.nan
    dem = ElevationMap.from_layers(geometry, {"mean": mean}, t0_ns=0, t1_ns=0)
    T = HILLS.pose(5, 5, 1.0)
    (output,) = outputs(
        make_configured_dfpc(), Sample("dem", 0, 0, dem, id="dem"), pose_sample("guess", T), scan_at(T)
    )
    assert_accurate(output, T)


def test_pieces_of_a_map_accumulate_and_another_frame_starts_a_new_map(ground: np.ndarray) -> None:
    dfpc = make_configured_dfpc()
    left = ground[:, 0] < 0
    outputs(dfpc, map_of(ground[left]), map_of(ground[~left]))
    count_of_both = len(dfpc.store.get("scan_map").points_m)
    outputs(dfpc, map_of(ground[left], "other"))
    assert len(dfpc.store.get("scan_map").points_m) < 0.6 * count_of_both


def test_with_a_known_mount_the_pose_is_that_of_the_base(ground: np.ndarray) -> None:
    T_base_lidar = se3.exp_se3([0.3, 0.0, 0.9, 0.0, 0.0, 0.5])
    frames = FrameGraph()
    frames.set_static("rover/base", "rover/lidar", UncertainTransform(T_base_lidar))
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure({}, DfpcContext(robot="rover", frames=frames))
    T = HILLS.pose(1, 2, 0.3)
    T_site_base = T @ se3.inverse(T_base_lidar)
    (output,) = outputs(dfpc, map_of(ground), pose_sample("guess", T_site_base), scan_at(T))
    assert output.child == "rover/base"
    assert_accurate(output, T_site_base)


def test_a_sweep_without_a_map_is_refused() -> None:
    (output,) = outputs(make_configured_dfpc(), scan_at(HILLS.pose(0, 0, 0)))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == ("no_map",)


def test_an_empty_sweep_is_refused_with_the_expected_input(ground: np.ndarray) -> None:
    value = LidarScan.from_arrays(
        np.ones((10, 3), np.float32), np.zeros(10, np.uint32), frame="rover/lidar", t0_ns=0, t1_ns=0
    )
    (output,) = outputs(make_configured_dfpc(), map_of(ground), Sample("scan", 0, 0, value))
    assert output.quality.status is Status.FAILED
    assert "10 points" in output.quality.reasons[0]


def test_operations_return_the_local_map_and_clear_the_state(ground: np.ndarray) -> None:
    dfpc = make_configured_dfpc()
    T = HILLS.pose(0, 0, 0)
    with pytest.raises(ProductNotFoundError):
        dfpc.call("get_local_map", {})
    outputs(dfpc, map_of(ground), pose_sample("guess", T), scan_at(T))
    assert dfpc.call("get_local_map", {}).extent_m()[3] < HALF_M
    assert dfpc.store.get("last_pose").stamp_ns == 0
    dfpc.call("relocalise", {})
    (output,) = outputs(dfpc, scan_at(T, STEP_NS))
    assert "relocalised" in output.quality.reasons
    dfpc.call("forget_map", {})
    with pytest.raises(ProductNotFoundError):
        dfpc.store.get("scan_map")


def test_a_map_of_keyframes_can_be_the_map_and_its_vertices_are_kept_in_the_graph(ground: np.ndarray) -> None:
    dfpc = make_configured_dfpc()
    T = HILLS.pose(0, 0, 0)
    T_second = se3.transform(np.eye(3), [1.0, 2.0, 0.0])
    graph = PoseGraph.from_arrays(
        [4, 5], [0, 0], [np.eye(4), T_second], [[4, 5]], [T_second], np.eye(6)[None], [0], frame="site"
    )
    clouds = [ground[::2], se3.transform_points(se3.inverse(T_second), ground[1::2])]
    value = LidarMap.from_parts(graph, clouds, sensor="rover/lidar", stamp_ns=0)
    first, second = (
        outputs(dfpc, Sample("graph_map", 0, 0, value, id="graph"), *guesses, scan_at(T, stamp_ns))
        for guesses, stamp_ns in (([pose_sample("guess", T)], 0), ([], STEP_NS))
    )
    assert_accurate(first[0], T)
    assert second[0].quality.reasons == ()  # the same map again: the estimate is kept
    stored_graph = dfpc.store.get("pose_graph")
    assert stored_graph.vertices.ids.tolist() == [4, 5, 6]
    assert stored_graph.edges.ends.tolist() == [[4, 5], [6, 6]]
