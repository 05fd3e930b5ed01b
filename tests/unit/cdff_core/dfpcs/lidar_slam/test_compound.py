# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from cdff_common.codecs import decode, encode
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarMap, Pointcloud, TransformWithCovariance
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyframeMap
from tests.support.hills import Float, Ground, circle, flat_ground, hills, pose_on_ground, scan

PERIOD_NS = 500_000_000
STEP_M = 0.5
RADIUS_M = 8.0
#: Distances for a small world, so that a lap takes seconds to simulate.
CONFIG: dict[str, Any] = {"keyframe_distance_m": 3.0, "keyframe_range_m": 22.0, "merge_distance_m": 2.0}


class Rover:
    """A simulated lidar on the ground, and the outputs of the DFPC."""

    def __init__(self, ground: Ground, seed: int = 0, **config: Any) -> None:
        self.ground, self.rng = ground, np.random.default_rng(seed)
        self.node = LidarSlam()
        frames = FrameGraph()
        frames.set_static("mana/base", "mana/lidar", UncertainTransform.identity())
        self.node.configure({**CONFIG, **config}, DfpcContext("mana", frames))
        self.true_poses: dict[int, Float] = {}
        self.outputs: list[Output] = []
        self.now_ns = 0

    def drive(self, poses: list[Float], *, wheels: bool = False) -> list[Output]:
        """Send one sweep at each pose and return the outputs."""
        outputs: list[Output] = []
        for i, T in enumerate(poses):
            self.now_ns += PERIOD_NS
            previous = poses[max(i - 1, 0)]
            # The sweep covers the last fifth of the path since the previous one.
            start = previous @ se3.exp_se3(0.8 * se3.log_se3(se3.inverse(previous) @ T))
            self.true_poses[self.now_ns] = T
            if wheels:
                value = TransformWithCovariance.from_transform(
                    UncertainTransform.exact(T),
                    parent="mana/odom",
                    child="mana/base",
                    stamp_ns=self.now_ns,
                )
                outputs += self.node.step(Sample("odometry", self.now_ns, i, value))
            sweep = scan(self.ground, start, T, self.now_ns, self.rng)
            outputs += self.node.step(Sample("scan", self.now_ns, i, sweep, id=f"scan{i}"))
        self.outputs += outputs
        return outputs

    def error_m(self, output: Output) -> float:
        """Return the distance between a pose and the true pose, both relative to the first sweep."""
        T = se3.inverse(self.true_poses[min(self.true_poses)]) @ self.true_poses[output.t1_ns]
        return float(np.linalg.norm(output.value.transform.matrix[:3, 3] - T[:3, 3]))


def of(outputs: list[Output], port: str) -> list[Output]:
    """Return the outputs of a port."""
    return [o for o in outputs if o.port == port]


def laps(ground: Ground, count: float) -> list[Float]:
    """Return poses along the circle from rest: the first sweeps at one place, then with increasing speed."""
    path = np.concatenate([[0.0, 0.0, 0.0, 0.05, 0.2], np.arange(0.5, count * 2 * np.pi * RADIUS_M, STEP_M)])
    return circle(ground, RADIUS_M, path)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return hills(1)


@pytest.fixture(scope="module")
def rover_after_lap(ground: Ground) -> tuple[Rover, list[Output]]:
    """A rover after 1.3 laps, and the outputs of finish."""
    rover = Rover(ground)
    rover.drive(laps(ground, 1.3))
    return rover, list(rover.node.finish())


@pytest.mark.req("CDFF-CORE-075")
def test_poses_follow_the_lidar_with_covariance_and_quality(
    rover_after_lap: tuple[Rover, list[Output]],
) -> None:
    rover, _ = rover_after_lap
    poses = of(rover.outputs, "pose")
    assert len(poses) == len(rover.true_poses)
    assert all(o.quality.status is not Status.FAILED for o in poses)
    assert np.mean([o.quality.status is Status.OK for o in poses[3:]]) > 0.95
    assert max(rover.error_m(o) for o in poses) < 0.15
    last = poses[-1]
    assert (last.frame, last.child) == ("mana/slam", "mana/lidar")
    assert last.quality.covariance_kind is CovarianceKind.FORMAL
    assert np.all(np.linalg.eigvalsh(last.value.transform.covariance) > 0)
    assert last.inputs[0].startswith("scan")


def test_a_lap_closes_loops_and_ends_with_trajectory_graph_and_cloud(
    rover_after_lap: tuple[Rover, list[Output]],
) -> None:
    rover, end = rover_after_lap
    assert {o.port for o in end} == {"trajectory", "graph", "cloud"}
    (graph,) = of(end, "graph")
    assert graph.quality.metrics["loops"] >= 1
    assert graph.value.frame == "mana/slam"
    (trajectory,) = of(end, "trajectory")
    T_map_site = se3.inverse(rover.true_poses[min(rover.true_poses)])
    for stamp, T in zip(trajectory.value.stamps_ns, trajectory.value.matrices, strict=True):
        assert np.linalg.norm((T_map_site @ rover.true_poses[int(stamp)])[:3, 3] - T[:3, 3]) < 0.15
    (cloud,) = of(end, "cloud")
    site = se3.transform_points(rover.true_poses[min(rover.true_poses)], cloud.value.points_m)
    height = site[:, 2] - rover.ground(site[:, 0], site[:, 1])
    assert np.median(np.abs(height)) < 0.05


@pytest.mark.slow
def test_a_second_lap_adds_hardly_any_keyframes(ground: Ground) -> None:
    rover, path = Rover(ground, seed=3), laps(ground, 2.6)
    first_lap = round(len(path) / 2)
    rover.drive(path[:first_lap])
    count = len(rover.node.keyframes)
    rover.drive(path[first_lap:])
    assert len(rover.node.keyframes) <= count + 2


@pytest.mark.slow
def test_each_optimisation_of_the_graph_is_reported(ground: Ground, monkeypatch: pytest.MonkeyPatch) -> None:
    rover = Rover(ground, seed=3)
    optimised_ns: list[int] = []
    optimise = KeyframeMap.optimise

    def record_and_optimise(keyframes: KeyframeMap, optimiser: Any) -> int:
        optimised_ns.append(rover.now_ns)
        return optimise(keyframes, optimiser)

    monkeypatch.setattr(KeyframeMap, "optimise", record_and_optimise)
    rover.drive(laps(ground, 2.6))
    assert len(optimised_ns) > 3
    assert {o.t1_ns for o in of(rover.outputs, "graph")} == set(optimised_ns)


def test_the_odometry_does_not_jump_when_a_loop_closes(rover_after_lap: tuple[Rover, list[Output]]) -> None:
    rover, _ = rover_after_lap
    odometry = of(rover.outputs, "odometry")
    assert {o.frame for o in odometry} == {"mana/lidar_odom"}
    for previous, current in itertools.pairwise(odometry[2:]):
        step = se3.inverse(previous.value.transform.matrix) @ current.value.transform.matrix
        true = se3.inverse(rover.true_poses[previous.t1_ns]) @ rover.true_poses[current.t1_ns]
        assert np.linalg.norm((se3.inverse(true) @ step)[:3, 3]) < 0.06


def test_the_position_manager_accepts_the_odometry(rover_after_lap: tuple[Rover, list[Output]]) -> None:
    rover, _ = rover_after_lap
    manager = Registry.default().make_dfpc("position_manager")
    manager.configure(None, rover.node.context)
    outputs: list[Output] = []
    for i, output in enumerate(of(rover.outputs, "odometry")[:40]):
        sample = Sample("visual_odometry", output.t1_ns, i, output.value, quality=output.quality)
        outputs += manager.step(sample)
    last = [o for o in outputs if o.port == "pose"][-1]
    first = rover.true_poses[min(rover.true_poses)]
    T_first_current = se3.inverse(first) @ rover.true_poses[last.t1_ns]
    assert (last.frame, last.child) == ("site", "mana/base")
    assert "source:vo" in last.quality.reasons
    distance_m = np.linalg.norm(last.value.transform.matrix[:3, 3])
    assert abs(distance_m - np.linalg.norm(T_first_current[:3, 3])) < 0.2


@pytest.mark.req("CDFF-CORE-076")
def test_flat_ground_is_degenerate_and_the_odometry_constrains_the_pose() -> None:
    rover = Rover(flat_ground)
    outputs = rover.drive([pose_on_ground(flat_ground, 0.4 * i, 0.0, 0.0) for i in range(14)], wheels=True)
    last_outputs = of(outputs, "pose")[8:]
    assert all(o.quality.status is Status.DEGRADED for o in last_outputs)
    reasons = {r for o in last_outputs for r in o.quality.reasons}
    assert "constrained_by:odometry" in reasons
    assert {"degenerate:translation_x", "degenerate:translation_y"} <= reasons
    assert rover.error_m(last_outputs[-1]) < 0.5


@pytest.mark.slow
@pytest.mark.req("CDFF-CORE-076")
def test_in_degenerate_directions_sigma_grows_linearly_with_the_path_length() -> None:
    rover = Rover(flat_ground)
    outputs = of(
        rover.drive([pose_on_ground(flat_ground, 0.5 * i, 0.0, 0.0) for i in range(24)], wheels=True),
        "odometry",
    )
    sigma_m = np.array([np.sqrt(o.value.transform.covariance[0, 0]) for o in outputs])
    assert sigma_m[23] > 1.7 * sigma_m[12] > 0.3
    assert 0.06 * 11.5 < sigma_m[23] < 0.12 * 11.5  # odometry_sigma_ratio is 8 %
    sigma_z_m = np.sqrt(outputs[-1].value.transform.covariance[2, 2])
    assert sigma_z_m < 0.1 * sigma_m[23]  # the ground constrains the height


@pytest.mark.slow
@pytest.mark.req("CDFF-CORE-077")
def test_a_restart_continues_in_the_same_map(
    ground: Ground, rover_after_lap: tuple[Rover, list[Output]]
) -> None:
    previous, _ = rover_after_lap
    state = decode("LidarMap", encode(previous.node.state(), "uper"), "uper")
    rover = Rover(ground, seed=5)
    rover.node.resume(state)
    rover.true_poses, rover.now_ns = dict(previous.true_poses), previous.now_ns
    path = laps(ground, 1.5)[len(previous.true_poses) :]
    outputs = rover.drive(path)
    poses = of(outputs, "pose")
    # The position from a single sweep, which may have an error of a decimetre, is not published.
    assert poses[0].quality.reasons[0] == "not_localised_in_map"
    assert poses[1].quality.status is not Status.FAILED
    assert max(rover.error_m(o) for o in poses[1:]) < 0.2
    assert rover.node.export_map().frame == "mana/slam"


@pytest.mark.slow
def test_the_covariance_after_a_restart_is_in_the_axes_of_the_keyframe(
    ground: Ground, rover_after_lap: tuple[Rover, list[Output]], monkeypatch: pytest.MonkeyPatch
) -> None:
    restarts: list[tuple[Float, Float, Float]] = []
    restart = LidarSlam._restart_on_map

    def recording_restart(node: LidarSlam, key: int, sweep: Any) -> Any:
        tracking = restart(node, key, sweep)
        assert tracking is not None
        R_map_keyframe = node.keyframes.poses[key][:3, :3]
        restarts.append(
            (R_map_keyframe, tracking.registration.covariance, node._mapper.T_keyframe_lidar.covariance)
        )
        return tracking

    monkeypatch.setattr(LidarSlam, "_restart_on_map", recording_restart)
    previous, _ = rover_after_lap
    rover = Rover(ground, seed=5)
    rover.node.resume(decode("LidarMap", encode(previous.node.state(), "uper"), "uper"))
    rover.true_poses, rover.now_ns = dict(previous.true_poses), previous.now_ns
    rover.drive(laps(ground, 1.5)[len(previous.true_poses) :][:4])
    ((R, in_map, in_keyframe),) = restarts
    assert np.linalg.norm(R - np.eye(3)) > 0.5  # the keyframe is rotated relative to the map
    variances = np.linalg.eigvalsh(in_map[:3, :3])
    assert variances[-1] > 1.2 * variances[0]  # the variances differ between the axes
    for block in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(R @ in_keyframe[block, block] @ R.T, in_map[block, block], rtol=1e-9)


@pytest.mark.slow
def test_a_rover_that_moved_while_not_mapping_is_relocalised_without_a_guess(
    ground: Ground, rover_after_lap: tuple[Rover, list[Output]]
) -> None:
    previous, _ = rover_after_lap
    rover = Rover(ground, seed=6, report_keyframes=True)
    rover.node.resume(previous.node.export_map())
    rover.true_poses, rover.now_ns = dict(previous.true_poses), previous.now_ns
    path = laps(ground, 0.85)[round(0.4 * len(laps(ground, 1.0))) :]
    poses = of(rover.drive([path[0]] * 3 + path), "pose")
    localised = [o for o in poses if o.value is not None]
    assert all(o.quality.reasons[0] == "not_localised_in_map" for o in poses if o.value is None)
    assert len(localised) > 0.8 * len(poses)
    assert max(rover.error_m(o) for o in localised) < 0.3


@pytest.mark.slow
def test_without_relocalisation_no_pose_in_the_map_is_published(
    rover_after_lap: tuple[Rover, list[Output]],
) -> None:
    previous, _ = rover_after_lap
    rover = Rover(hills(77), seed=6, report_keyframes=True)
    state = previous.node.export_map()
    rover.node.resume(state)
    rover.now_ns = previous.now_ns
    outputs = rover.drive(laps(rover.ground, 0.2))
    assert {o.quality.reasons[0] for o in of(outputs, "pose")} == {"not_localised_in_map"}
    assert of(outputs, "trajectory") == []
    graphs = of(outputs, "graph")
    assert graphs
    assert {tuple(g.value.vertices.stamps_ns) for g in graphs} == {tuple(state.graph.vertices.stamps_ns)}
    exported = rover.node.export_map()
    assert exported.last_position is not None  # the next run starts its search here
    stamp_of = dict(
        zip(exported.graph.vertices.ids.tolist(), exported.graph.vertices.stamps_ns.tolist(), strict=True)
    )
    assert stamp_of[exported.last_position[0]] in set(state.graph.vertices.stamps_ns.tolist())


def test_a_new_map_is_checkpointed_whenever_its_number_of_sweeps_has_doubled(ground: Ground) -> None:
    rover, revisions = Rover(ground), list[int]()
    for T in [laps(ground, 0.1)[0]] * 9:  # at rest
        rover.drive([T])
        revisions.append(rover.node.state_revision)
    checkpoints = [i + 1 for i in range(1, 9) if revisions[i] > revisions[i - 1]]
    assert checkpoints == [2, 4, 8]


def test_the_first_sweep_of_a_map_is_checkpointed(ground: Ground) -> None:
    rover = Rover(ground)
    revision = rover.node.state_revision
    rover.drive(laps(ground, 0.1)[:1])
    assert rover.node.state_revision > revision
    restarted = Rover(ground, seed=3)
    restarted.node.resume(decode("LidarMap", encode(rover.node.state(), "uper"), "uper"))
    restarted.true_poses, restarted.now_ns = dict(rover.true_poses), rover.now_ns
    poses = of(restarted.drive(laps(ground, 0.2)[8:], wheels=True), "pose")
    assert poses[-1].value is not None
    assert restarted.error_m(poses[-1]) < 0.3


@pytest.mark.slow
def test_the_map_of_another_rover_is_connected_by_a_loop(ground: Ground) -> None:
    path = laps(ground, 1.0)
    half = len(path) // 2
    first, second = Rover(ground, seed=7), Rover(ground, seed=8)
    first.drive(path[: half + 8])
    second.drive([path[half - 8]] * 3 + path[half - 8 :])
    for rover in (first, second):
        list(rover.node.finish())
    own_keyframes = len(first.node.keyframes)
    outputs = list(first.node.step(Sample("map", first.now_ns, 0, second.node.export_map())))
    keyframes = first.node.keyframes
    assert keyframes.component(keyframes.root) == set(keyframes.keyframes)
    assert len(keyframes) > own_keyframes
    assert not any(r.startswith("keyframes_not_linked") for r in of(outputs, "graph")[0].quality.reasons)
    cloud = first.node.get_map(0.5)
    assert isinstance(cloud, Pointcloud)
    site = se3.transform_points(first.true_poses[min(first.true_poses)], cloud.points_m)
    assert np.median(np.abs(site[:, 2] - ground(site[:, 0], site[:, 1]))) < 0.1


@pytest.mark.slow
def test_a_map_without_overlap_is_reported_as_not_linked(ground: Ground) -> None:
    rover, distant_rover = Rover(ground, seed=9), Rover(hills(77), seed=10)
    rover.drive(laps(ground, 0.3))
    distant_rover.drive(laps(hills(77), 0.3))
    list(distant_rover.node.finish())
    outputs = list(rover.node.step(Sample("map", rover.now_ns, 0, distant_rover.node.export_map())))
    assert of(outputs, "graph")[0].quality.reasons[-1].startswith("keyframes_not_linked:")


def test_a_map_imported_into_an_empty_map_becomes_the_map(
    ground: Ground, rover_after_lap: tuple[Rover, list[Output]]
) -> None:
    rover = Rover(ground)
    assert list(rover.node.step(Sample("map", 0, 0, rover_after_lap[0].node.export_map()))) == []
    assert len(rover.node.keyframes) == len(rover_after_lap[0].node.keyframes)


def test_before_the_first_sweep_there_are_no_products() -> None:
    rover = Rover(flat_ground)
    assert rover.node.state() is None
    assert list(rover.node.finish()) == []
    for operation in (
        rover.node.export_map,
        lambda: rover.node.get_map(0.0),
        lambda: rover.node.get_trajectory(-1, -1),
    ):
        with pytest.raises(ProductNotFoundError):
            operation()
    for item in rover.node.store.items:
        with pytest.raises(ProductNotFoundError):
            rover.node.store.get(item)


def test_the_store_has_the_items_of_the_description(rover_after_lap: tuple[Rover, list[Output]]) -> None:
    node = rover_after_lap[0].node
    assert set(node.store.items) == {m.item for m in node.description.product_management}
    assert isinstance(node.store.get("map"), LidarMap)


def test_a_state_of_another_type_is_refused() -> None:
    with pytest.raises(InputError, match="LidarMap"):
        Rover(flat_ground).node.resume("nonsense")


def test_forget_starts_a_new_map(ground: Ground) -> None:
    rover = Rover(ground)
    rover.drive(laps(ground, 0.1))
    rover.node.forget()
    assert len(rover.node.keyframes) == 0
    rover.drive(laps(ground, 0.1))
    assert of(rover.outputs, "pose")[-1].quality.status is not Status.FAILED


def send_empty_sweep(rover: Rover) -> list[Output]:
    """Send a sweep without points and return the outputs."""
    rover.now_ns += PERIOD_NS
    sweep = scan(rover.ground, np.eye(4), np.eye(4), rover.now_ns, rover.rng)
    empty = type(sweep).from_arrays(
        np.zeros((0, 3), np.float32),
        np.zeros(0, np.uint32),
        frame="mana/lidar",
        t0_ns=sweep.t0_ns,
        t1_ns=sweep.t1_ns,
    )
    return list(rover.node.step(Sample("scan", rover.now_ns, 99, empty)))


def test_an_empty_sweep_is_lost(ground: Ground) -> None:
    rover = Rover(ground)
    rover.drive(laps(ground, 0.1))
    outputs = send_empty_sweep(rover)
    assert {o.quality.status for o in outputs} == {Status.FAILED}
    assert {o.quality.reasons[0] for o in outputs} == {"lost"}


def test_empty_sweeps_at_the_start_are_lost_and_the_next_sweep_starts_the_map(ground: Ground) -> None:
    rover = Rover(ground)
    for _ in range(3):
        outputs = send_empty_sweep(rover)
        assert [(o.quality.status, o.quality.reasons[0]) for o in outputs] == [(Status.FAILED, "lost")] * 2
    poses = of(rover.drive(laps(ground, 0.2)), "pose")
    assert all(o.quality.status is not Status.FAILED for o in poses)
    np.testing.assert_allclose(poses[0].value.transform.matrix, np.eye(4), atol=1e-12)
    assert max(rover.error_m(o) for o in poses) < 0.15


def test_poses_predicted_from_odometry_without_the_mount_of_the_lidar_are_degraded(ground: Ground) -> None:
    rover = Rover(ground)
    rover.node.configure(CONFIG, DfpcContext("mana", FrameGraph()))
    path = [pose_on_ground(ground, 0.3 * i, 0.0, 0.0) for i in range(4)]
    for output in of(rover.drive(path, wheels=True), "pose")[1:]:
        assert output.quality.status is Status.DEGRADED
        assert "lidar_mount_unknown" in output.quality.reasons
    rover.node.forget()
    assert of(rover.drive(path), "pose")[-1].quality.status is Status.OK  # odometry is not used


def test_a_turn_of_50_degrees_within_a_sweep_is_found(ground: Ground) -> None:
    rover = Rover(ground, seed=5)
    rover.drive([pose_on_ground(ground, 0.3 * i, 0.0, 0.0) for i in range(8)])
    outputs = of(
        rover.drive([pose_on_ground(ground, 2.4 + 0.3 * i, 0.0, np.radians(50.0)) for i in range(4)]),
        "odometry",
    )
    assert all(o.quality.status is not Status.FAILED for o in outputs)
    assert max(rover.error_m(o) for o in outputs) < 0.15
    T = se3.inverse(rover.true_poses[min(rover.true_poses)]) @ rover.true_poses[outputs[-1].t1_ns]
    E = se3.inverse(T) @ outputs[-1].value.transform.matrix
    assert np.degrees(se3.rotation_angle(E[:3, :3])) < 0.5


@pytest.mark.slow
def test_the_covariance_after_lost_sweeps_contains_the_motion_without_measurement(ground: Ground) -> None:
    rover = Rover(ground, seed=6)
    before = of(rover.drive([pose_on_ground(ground, 0.4 * i, 0.0, 0.0) for i in range(8)]), "odometry")[-1]
    for _ in range(2):  # sweeps without points
        rover.now_ns += PERIOD_NS
        empty = scan(ground, np.eye(4), np.eye(4), rover.now_ns, rover.rng)
        empty = type(empty).from_arrays(
            np.zeros((0, 3)), np.zeros(0, np.uint32), frame="mana/lidar", t0_ns=empty.t0_ns, t1_ns=empty.t1_ns
        )
        lost = list(rover.node.step(Sample("scan", rover.now_ns, 99, empty)))
        assert {o.quality.status for o in lost} == {Status.FAILED}
    after = of(rover.drive([pose_on_ground(ground, 4.0, 0.0, 0.0)]), "odometry")[-1]
    sigma_m = [np.sqrt(np.trace(o.value.transform.covariance[:3, :3]) / 3.0) for o in (before, after)]
    assert sigma_m[1] > sigma_m[0] + 0.2
    assert rover.error_m(after) < 0.5
