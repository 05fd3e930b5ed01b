# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LidarLocalisation: tracks, recovers, searches the map, and says when it is lost."""

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
from cdff_common.types import ElevationMap, LidarMap, LidarScan, Pointcloud, PoseGraph, TransformWithCovariance
from tests.mapped_hills import HALF_M, Hills

HILLS = Hills(3)
STEP_NS = 500_000_000


def made(**config: Any) -> Dfpc:
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
    E = se3.inverse(T) @ output.value.transform.matrix
    return float(np.linalg.norm(E[:3, 3])), float(np.degrees(se3.rotation_angle(E[:3, :3])))


def assert_right(output: Output, T: np.ndarray) -> None:
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    metres, degrees = error(output, T)
    assert metres < 0.03
    assert degrees < 0.1


@pytest.mark.parametrize("seed", range(4))
def test_two_metres_and_twenty_degrees_off_it_finds_back(seed: int, ground: np.ndarray) -> None:
    rng = np.random.default_rng(seed)
    T = HILLS.pose(*rng.uniform(-15, 15, 2), rng.uniform(-np.pi, np.pi))
    shift, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    wrong = se3.transform(se3.exp_so3(np.radians(20) * axis) @ T[:3, :3], T[:3, 3] + 2.0 * shift)
    (output,) = outputs(made(), map_of(ground), pose_sample("guess", wrong), scan_at(T))
    assert_right(output, T)
    assert output.quality.status is Status.OK
    assert output.quality.covariance_kind is CovarianceKind.CALIBRATED
    assert (output.frame, output.child) == ("site", "rover/lidar")
    assert output.inputs == ("map", "guess", "scan-0")


@pytest.mark.req("CDFF-CORE-078")
def test_without_a_guess_the_whole_map_is_searched(ground: np.ndarray) -> None:
    T = HILLS.pose(9.0, -7.0, 2.0)
    (output,) = outputs(made(), map_of(ground), scan_at(T))
    assert_right(output, T)
    assert output.quality.reasons[0] == "relocalised"


@pytest.mark.parametrize("way", ["shape", "descriptors"])
def test_each_way_of_searching_the_map_finds_the_place_alone(way: str, ground: np.ndarray) -> None:
    T = HILLS.pose(-8.0, 5.0, 1.0)
    (output,) = outputs(made(relocalise_by=(way,)), map_of(ground), scan_at(T))
    assert_right(output, T)
    assert output.quality.reasons[0] == "relocalised"


def test_a_map_that_is_tilted_as_its_first_sweep_was_is_searched_too(ground: np.ndarray) -> None:
    T_map_site = se3.transform(se3.exp_so3(np.radians(20.0) * np.array([0.6, 0.8, 0.0])), np.zeros(3))
    T = HILLS.pose(9.0, -7.0, 2.0)
    (output,) = outputs(made(), map_of(se3.transform_points(T_map_site, ground), "rover/slam"), scan_at(T))
    assert_right(output, T_map_site @ T)
    assert output.quality.reasons[0] == "relocalised"


def test_where_the_map_is_not_to_be_searched_a_robot_without_a_guess_is_lost(ground: np.ndarray) -> None:
    (output,) = outputs(made(relocalise_by=()), map_of(ground), scan_at(HILLS.pose(0, 0, 0)))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == ("lost", "not_on_the_map")


@pytest.mark.req("CDFF-CORE-078")
def test_on_other_ground_it_says_that_it_is_lost(ground: np.ndarray) -> None:
    other = Hills(99)
    (output,) = outputs(made(), map_of(ground), scan_at(other.pose(0, 0, 0), hills=other))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "lost"
    assert output.value is None


def test_carried_away_it_notices_and_finds_itself_again(ground: np.ndarray) -> None:
    here, there = HILLS.pose(-10, -10, 0.0), HILLS.pose(12, 8, 2.5)
    dfpc = made()
    _, output = outputs(dfpc, map_of(ground), pose_sample("guess", here), scan_at(here), scan_at(there, STEP_NS))
    assert_right(output, there)
    assert "relocalised" in output.quality.reasons


@pytest.mark.req("CDFF-CORE-078")
def test_a_drive_is_tracked_with_odometry_that_drifts(ground: np.ndarray) -> None:
    dfpc = made(odometry_wait_s=0.0)
    true = [HILLS.pose(-8 + 0.8 * i, 0.2 * i, 0.05 * i) for i in range(6)]
    drift = se3.exp_se3([0.05, 0.02, 0.0, 0.0, 0.0, 0.01])
    felt = [np.eye(4)]
    for a, b in itertools.pairwise(true):
        felt.append(felt[-1] @ se3.inverse(a) @ b @ drift)
    samples = [map_of(ground), pose_sample("guess", true[0])]
    for i, (T, odometry) in enumerate(zip(true, felt, strict=True)):
        samples += [pose_sample("odometry", odometry, i * STEP_NS, "rover/odom"), scan_at(T, i * STEP_NS)]
    found = outputs(dfpc, *samples)
    assert len(found) == len(true)
    for output, T in zip(found, true, strict=True):
        assert_right(output, T)
        assert output.quality.status is Status.OK
    graph = dfpc.store.get("pose_graph")
    assert len(graph.vertices.ids) == len(graph.edges.kinds) == len(dfpc.store.get("key_frames").stamps_ns) == 2


def test_a_sweep_waits_for_the_odometry_that_belongs_to_it(ground: np.ndarray) -> None:
    T = HILLS.pose(0, 0, 0)
    dfpc = made()
    before = pose_sample("odometry", np.eye(4), STEP_NS - 100_000_000, "rover/odom")
    assert outputs(dfpc, map_of(ground), pose_sample("guess", T), before, scan_at(T, STEP_NS)) == []
    (output,) = outputs(dfpc, pose_sample("odometry", np.eye(4), STEP_NS, "rover/odom"))
    assert_right(output, T)
    outputs(dfpc, scan_at(T, 2 * STEP_NS - 300_000_000))
    (last,) = dfpc.finish()
    assert_right(last, T)


def test_a_sweep_that_was_taken_in_motion_is_straightened(ground: np.ndarray) -> None:
    T1 = HILLS.pose(2, 3, 0.4)
    step = se3.exp_se3([0.3, 0.0, 0.0, 0.0, 0.0, 0.1])
    T0 = T1 @ se3.inverse(step)
    share = np.linspace(0.0, 1.0, 20)
    clouds = [
        HILLS.scan(np.random.default_rng(i), T0 @ se3.exp_se3(s * se3.log_se3(step)), 1000) for i, s in enumerate(share)
    ]
    offset_us = np.repeat((share * 100_000).astype(np.uint32), 1000)
    value = LidarScan.from_arrays(
        np.vstack(clouds).astype(np.float32), offset_us, frame="rover/lidar", t0_ns=0, t1_ns=100_000_000
    )
    felt = [pose_sample("odometry", T, t, "rover/odom") for t, T in ((0, np.eye(4)), (100_000_000, step))]
    (output,) = outputs(
        made(), map_of(ground), pose_sample("guess", T1), *felt, Sample("scan", 100_000_000, 0, value, id="scan")
    )
    assert_right(output, T1)


def test_on_a_plain_the_prediction_fills_in_what_the_ground_does_not_tell() -> None:
    plain = Hills(5, relief=0.0)
    rng = np.random.default_rng(0)
    T = plain.pose(0, 0, 0)
    (output,) = outputs(made(), map_of(plain.map(rng)), pose_sample("guess", T), scan_at(T, hills=plain))
    assert output.quality.status is Status.DEGRADED
    assert any(r.startswith("degenerate:") for r in output.quality.reasons)
    sigma = np.sqrt(np.diag(output.value.transform.covariance))
    assert sigma[:2].min() > 0.5
    assert sigma[2] < 0.05


def test_an_elevation_map_is_a_map_too() -> None:
    geometry = GridGeometry("site", 0.25, -HALF_M, HALF_M, 320, 320)
    x = -HALF_M + 0.25 * (np.arange(320) + 0.5)
    xx, yy = np.meshgrid(x, -x)
    mean = HILLS.height(np.column_stack([xx.ravel(), yy.ravel()])).reshape(320, 320).astype(np.float32)
    mean[:5] = np.nan
    dem = ElevationMap.from_layers(geometry, {"mean": mean}, t0_ns=0, t1_ns=0)
    T = HILLS.pose(5, 5, 1.0)
    (output,) = outputs(made(), Sample("dem", 0, 0, dem, id="dem"), pose_sample("guess", T), scan_at(T))
    assert_right(output, T)


def test_pieces_of_a_map_add_up_and_another_frame_begins_anew(ground: np.ndarray) -> None:
    dfpc = made()
    left = ground[:, 0] < 0
    outputs(dfpc, map_of(ground[left]), map_of(ground[~left]))
    whole = len(dfpc.store.get("scan_map").points_m)
    outputs(dfpc, map_of(ground[left], "other"))
    assert len(dfpc.store.get("scan_map").points_m) < 0.6 * whole


def test_the_mount_of_the_lidar_makes_it_the_pose_of_the_base(ground: np.ndarray) -> None:
    mount = se3.exp_se3([0.3, 0.0, 0.9, 0.0, 0.0, 0.5])
    frames = FrameGraph()
    frames.set_static("rover/base", "rover/lidar", UncertainTransform(mount))
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure({}, DfpcContext(robot="rover", frames=frames))
    T = HILLS.pose(1, 2, 0.3)
    lidar = scan_at(T)  # the ground as seen from the lidar, which stands where the base was
    guess = T @ se3.inverse(mount)
    (output,) = outputs(dfpc, map_of(ground), pose_sample("guess", guess), lidar)
    assert output.child == "rover/base"
    assert_right(output, T @ se3.inverse(mount))


def test_without_a_map_it_is_refused() -> None:
    (output,) = outputs(made(), scan_at(HILLS.pose(0, 0, 0)))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons == ("no_map",)


def test_an_empty_sweep_is_refused_with_what_was_expected(ground: np.ndarray) -> None:
    value = LidarScan.from_arrays(
        np.ones((10, 3), np.float32), np.zeros(10, np.uint32), frame="rover/lidar", t0_ns=0, t1_ns=0
    )
    (output,) = outputs(made(), map_of(ground), Sample("scan", 0, 0, value))
    assert output.quality.status is Status.FAILED
    assert "10 points" in output.quality.reasons[0]


def test_operations_hand_out_the_local_map_and_forget(ground: np.ndarray) -> None:
    dfpc = made()
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


def test_a_map_of_key_frames_is_a_map_and_stays_in_the_graph(ground: np.ndarray) -> None:
    dfpc = made()
    T = HILLS.pose(0, 0, 0)
    there = se3.transform(np.eye(3), [1.0, 2.0, 0.0])
    graph = PoseGraph.from_arrays(
        [4, 5], [0, 0], [np.eye(4), there], [[4, 5]], [there], np.eye(6)[None], [0], frame="site"
    )
    clouds = [ground[::2], se3.transform_points(se3.inverse(there), ground[1::2])]
    value = LidarMap.from_parts(graph, clouds, sensor="rover/lidar", stamp_ns=0)
    first, second = (
        outputs(dfpc, Sample("graph_map", 0, 0, value, id="graph"), *before, scan_at(T, stamp_ns))
        for before, stamp_ns in (([pose_sample("guess", T)], 0), ([], STEP_NS))
    )
    assert_right(first[0], T)
    assert second[0].quality.reasons == ()  # the map came again, the estimate stayed
    kept = dfpc.store.get("pose_graph")
    assert kept.vertices.ids.tolist() == [4, 5, 6]
    assert kept.edges.ends.tolist() == [[4, 5], [6, 6]]
