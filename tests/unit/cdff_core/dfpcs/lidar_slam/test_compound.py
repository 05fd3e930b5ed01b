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
from tests.hills import Float, Ground, circle, hills, plain, scan, standing

PERIOD_NS = 500_000_000
STEP_M = 0.5
RADIUS_M = 8.0
#: Small enough for a second lap within seconds; clouds of the small world are sparse.
CONFIG: dict[str, Any] = {"keyframe_distance_m": 3.0, "keyframe_range_m": 22.0, "reuse_distance_m": 2.0}


class Rover:
    """A lidar that is driven over the ground, and what the DFPC says of it."""

    def __init__(self, ground: Ground, seed: int = 0, **config: Any) -> None:
        self.ground, self.rng = ground, np.random.default_rng(seed)
        self.node = LidarSlam()
        frames = FrameGraph()
        frames.set_static("mana/base", "mana/lidar", UncertainTransform(np.eye(4), np.zeros((6, 6))))
        self.node.configure({**CONFIG, **config}, DfpcContext("mana", frames))
        self.truth: dict[int, Float] = {}
        self.outputs: list[Output] = []
        self.now_ns = 0

    def drive(self, poses: list[Float], *, wheels: bool = False) -> list[Output]:
        """One sweep at each pose; the outputs."""
        made: list[Output] = []
        for i, T in enumerate(poses):
            self.now_ns += PERIOD_NS
            before = poses[max(i - 1, 0)]
            begin = before @ se3.exp_se3(0.8 * se3.log_se3(se3.inverse(before) @ T))  # a fifth of the way since
            self.truth[self.now_ns] = T
            if wheels:
                value = TransformWithCovariance.from_transform(
                    UncertainTransform(T, np.zeros((6, 6))), parent="mana/odom", child="mana/base", stamp_ns=self.now_ns
                )
                made += self.node.step(Sample("odometry", self.now_ns, i, value))
            sweep = scan(self.ground, begin, T, self.now_ns, self.rng)
            made += self.node.step(Sample("scan", self.now_ns, i, sweep, id=f"scan{i}"))
        self.outputs += made
        return made

    def error_m(self, output: Output) -> float:
        """Distance of a pose from the truth, both since the first sweep."""
        T = se3.inverse(self.truth[min(self.truth)]) @ self.truth[output.t1_ns]
        return float(np.linalg.norm(output.value.transform.matrix[:3, 3] - T[:3, 3]))


def of(outputs: list[Output], port: str) -> list[Output]:
    return [o for o in outputs if o.port == port]


def laps(ground: Ground, count: float) -> list[Float]:
    """Poses along the circle from rest: the first sweeps at one place, then faster."""
    way = np.concatenate([[0.0, 0.0, 0.0, 0.05, 0.2], np.arange(0.5, count * 2 * np.pi * RADIUS_M, STEP_M)])
    return circle(ground, RADIUS_M, way)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return hills(1)


@pytest.fixture(scope="module")
def lapped(ground: Ground) -> tuple[Rover, list[Output]]:
    """A lap and a bit, then the end."""
    rover = Rover(ground)
    rover.drive(laps(ground, 1.3))
    return rover, list(rover.node.finish())


@pytest.mark.req("CDFF-CORE-075")
def test_poses_follow_the_lidar_with_covariance_and_quality(lapped: tuple[Rover, list[Output]]) -> None:
    rover, _ = lapped
    poses = of(rover.outputs, "pose")
    assert len(poses) == len(rover.truth)
    assert all(o.quality.status is not Status.FAILED for o in poses)
    assert np.mean([o.quality.status is Status.OK for o in poses[3:]]) > 0.95
    assert max(rover.error_m(o) for o in poses) < 0.15
    last = poses[-1]
    assert (last.frame, last.child) == ("mana/slam", "mana/lidar")
    assert last.quality.covariance_kind is CovarianceKind.FORMAL
    assert np.all(np.linalg.eigvalsh(last.value.transform.covariance) > 0)
    assert last.inputs[0].startswith("scan")


def test_a_lap_closes_loops_and_ends_with_trajectory_graph_and_cloud(lapped: tuple[Rover, list[Output]]) -> None:
    rover, end = lapped
    assert {o.port for o in end} == {"trajectory", "graph", "cloud"}
    (graph,) = of(end, "graph")
    assert graph.quality.metrics["loops"] >= 1
    assert graph.value.frame == "mana/slam"
    (trajectory,) = of(end, "trajectory")
    first = se3.inverse(rover.truth[min(rover.truth)])
    for stamp, T in zip(trajectory.value.stamps_ns, trajectory.value.matrices, strict=True):
        assert np.linalg.norm((first @ rover.truth[int(stamp)])[:3, 3] - T[:3, 3]) < 0.15
    (cloud,) = of(end, "cloud")
    site = se3.transform_points(rover.truth[min(rover.truth)], cloud.value.points_m)
    height = site[:, 2] - rover.ground(site[:, 0], site[:, 1])
    assert np.median(np.abs(height)) < 0.05


@pytest.mark.slow
def test_a_second_lap_adds_next_to_nothing(ground: Ground) -> None:
    rover, way = Rover(ground, seed=3), laps(ground, 2.6)
    one = round(len(way) / 2)
    rover.drive(way[:one])
    first = len(rover.node.places)
    rover.drive(way[one:])
    assert len(rover.node.places) <= first + 2


def test_the_odometry_never_jumps_when_the_map_does(lapped: tuple[Rover, list[Output]]) -> None:
    rover, _ = lapped
    odometry = of(rover.outputs, "odometry")
    assert {o.frame for o in odometry} == {"mana/lidar_odom"}
    for before, now in itertools.pairwise(odometry[2:]):
        step = se3.inverse(before.value.transform.matrix) @ now.value.transform.matrix
        true = se3.inverse(rover.truth[before.t1_ns]) @ rover.truth[now.t1_ns]
        assert np.linalg.norm((se3.inverse(true) @ step)[:3, 3]) < 0.06


def test_the_position_manager_takes_the_odometry(lapped: tuple[Rover, list[Output]]) -> None:
    rover, _ = lapped
    manager = Registry.default().make_dfpc("position_manager")
    manager.configure(None, rover.node.context)
    made: list[Output] = []
    for i, output in enumerate(of(rover.outputs, "odometry")[:40]):
        sample = Sample("visual_odometry", output.t1_ns, i, output.value, quality=output.quality)
        made += manager.step(sample)
    last = [o for o in made if o.port == "pose"][-1]
    first = rover.truth[min(rover.truth)]
    moved = se3.inverse(first) @ rover.truth[last.t1_ns]
    assert (last.frame, last.child) == ("site", "mana/base")
    assert "source:vo" in last.quality.reasons
    assert abs(np.linalg.norm(last.value.transform.matrix[:3, 3]) - np.linalg.norm(moved[:3, 3])) < 0.2


@pytest.mark.req("CDFF-CORE-076")
def test_a_plain_is_said_to_hold_nothing_and_the_wheels_hold_instead() -> None:
    rover = Rover(plain)
    made = rover.drive([standing(plain, 0.4 * i, 0.0, 0.0) for i in range(14)], wheels=True)
    late = of(made, "pose")[8:]
    assert all(o.quality.status is Status.DEGRADED for o in late)
    reasons = {r for o in late for r in o.quality.reasons}
    assert "held_by:odometry" in reasons
    assert {"degenerate:translation_x", "degenerate:translation_y"} <= reasons
    assert rover.error_m(late[-1]) < 0.5


@pytest.mark.req("CDFF-CORE-076")
def test_where_the_wheels_hold_the_sigma_grows_with_the_way_and_not_with_its_root() -> None:
    rover = Rover(plain)
    made = of(rover.drive([standing(plain, 0.5 * i, 0.0, 0.0) for i in range(24)], wheels=True), "odometry")
    sigma_m = np.array([np.sqrt(o.value.transform.covariance[0, 0]) for o in made])
    assert sigma_m[23] > 1.7 * sigma_m[12] > 0.3
    assert 0.06 * 11.5 < sigma_m[23] < 0.12 * 11.5  # wheels are off by 8 %
    up_m = np.sqrt(made[-1].value.transform.covariance[2, 2])
    assert up_m < 0.1 * sigma_m[23]  # that the ground does hold


@pytest.mark.req("CDFF-CORE-077")
def test_a_restart_goes_on_where_it_was(ground: Ground, lapped: tuple[Rover, list[Output]]) -> None:
    before, _ = lapped
    state = decode("LidarMap", encode(before.node.state(), "uper"), "uper")
    rover = Rover(ground, seed=5)
    rover.node.resume(state)
    rover.truth, rover.now_ns = dict(before.truth), before.now_ns
    way = laps(ground, 1.5)[len(before.truth) :]
    made = rover.drive(way)
    poses = of(made, "pose")
    assert poses[0].quality.reasons[0] == "not_localised_in_map"  # one sweep alone may be a decimetre off
    assert poses[1].quality.status is not Status.FAILED
    assert max(rover.error_m(o) for o in poses[1:]) < 0.2
    assert rover.node.export_map().frame == "mana/slam"


def test_a_rover_that_drove_on_while_nobody_mapped_is_found_on_the_map_without_a_guess(
    ground: Ground, lapped: tuple[Rover, list[Output]]
) -> None:
    before, _ = lapped
    rover = Rover(ground, seed=6, report_keyframes=True)
    rover.node.resume(before.node.export_map())
    rover.truth, rover.now_ns = dict(before.truth), before.now_ns
    way = laps(ground, 0.85)[round(0.4 * len(laps(ground, 1.0))) :]
    poses = of(rover.drive([way[0]] * 3 + way), "pose")
    known = [o for o in poses if o.value is not None]
    assert all(o.quality.reasons[0] == "not_localised_in_map" for o in poses if o.value is None)
    assert len(known) > 0.8 * len(poses)
    assert max(rover.error_m(o) for o in known) < 0.3


def test_where_the_map_is_not_found_again_no_place_in_it_is_claimed(lapped: tuple[Rover, list[Output]]) -> None:
    before, _ = lapped
    rover = Rover(hills(77), seed=6, report_keyframes=True)
    state = before.node.export_map()
    rover.node.resume(state)
    rover.now_ns = before.now_ns
    made = rover.drive(laps(rover.ground, 0.2))
    assert {o.quality.reasons[0] for o in of(made, "pose")} == {"not_localised_in_map"}
    assert of(made, "trajectory") == []
    graphs = of(made, "graph")
    assert graphs
    assert {tuple(g.value.vertices.stamps_ns) for g in graphs} == {tuple(state.graph.vertices.stamps_ns)}
    kept = rover.node.export_map()
    assert kept.last_position is not None  # where it is to be sought next time
    stamp_of = dict(zip(kept.graph.vertices.ids.tolist(), kept.graph.vertices.stamps_ns.tolist(), strict=True))
    assert stamp_of[kept.last_position[0]] in set(state.graph.vertices.stamps_ns.tolist())


def test_a_young_map_is_worth_keeping_anew_each_time_its_sweeps_have_doubled(ground: Ground) -> None:
    rover, revisions = Rover(ground), list[int]()
    for T in [laps(ground, 0.1)[0]] * 9:  # at rest
        rover.drive([T])
        revisions.append(rover.node.state_revision)
    news = [i + 1 for i in range(1, 9) if revisions[i] > revisions[i - 1]]
    assert news == [2, 4, 8]


def test_the_begin_of_a_map_is_a_state_worth_keeping(ground: Ground) -> None:
    rover = Rover(ground)
    revision = rover.node.state_revision
    rover.drive(laps(ground, 0.1)[:1])
    assert rover.node.state_revision > revision
    again = Rover(ground, seed=3)
    again.node.resume(decode("LidarMap", encode(rover.node.state(), "uper"), "uper"))
    again.truth, again.now_ns = dict(rover.truth), rover.now_ns
    poses = of(again.drive(laps(ground, 0.2)[8:], wheels=True), "pose")
    assert poses[-1].value is not None
    assert again.error_m(poses[-1]) < 0.3


def test_the_map_of_another_rover_is_merged_when_a_place_is_known_again(ground: Ground) -> None:
    way = laps(ground, 1.0)
    half = len(way) // 2
    first, second = Rover(ground, seed=7), Rover(ground, seed=8)
    first.drive(way[: half + 8])
    second.drive([way[half - 8]] * 3 + way[half - 8 :])
    for rover in (first, second):
        list(rover.node.finish())
    keys = len(first.node.places)
    made = list(first.node.step(Sample("map", first.now_ns, 0, second.node.export_map())))
    places = first.node.places
    assert places.part(places.root) == set(places.frames)
    assert len(places) > keys
    assert not any(r.startswith("keyframes_not_linked") for r in of(made, "graph")[0].quality.reasons)
    cloud = first.node.get_map(0.5)
    assert isinstance(cloud, Pointcloud)
    site = se3.transform_points(first.truth[min(first.truth)], cloud.points_m)
    assert np.median(np.abs(site[:, 2] - ground(site[:, 0], site[:, 1]))) < 0.1


def test_a_map_of_elsewhere_stays_apart_and_is_named(ground: Ground) -> None:
    here, there = Rover(ground, seed=9), Rover(hills(77), seed=10)
    here.drive(laps(ground, 0.3))
    there.drive(laps(hills(77), 0.3))
    list(there.node.finish())
    made = list(here.node.step(Sample("map", here.now_ns, 0, there.node.export_map())))
    assert of(made, "graph")[0].quality.reasons[-1].startswith("keyframes_not_linked:")


def test_a_map_is_taken_over_where_there_is_none(ground: Ground, lapped: tuple[Rover, list[Output]]) -> None:
    rover = Rover(ground)
    assert list(rover.node.step(Sample("map", 0, 0, lapped[0].node.export_map()))) == []
    assert len(rover.node.places) == len(lapped[0].node.places)


def test_before_the_first_sweep_nothing_is_answered() -> None:
    rover = Rover(plain)
    assert rover.node.state() is None
    assert list(rover.node.finish()) == []
    for ask in (rover.node.export_map, lambda: rover.node.get_map(0.0), lambda: rover.node.get_trajectory(-1, -1)):
        with pytest.raises(ProductNotFoundError):
            ask()
    for item in rover.node.store.items:
        with pytest.raises(ProductNotFoundError):
            rover.node.store.get(item)


def test_the_store_holds_what_the_description_promises(lapped: tuple[Rover, list[Output]]) -> None:
    node = lapped[0].node
    assert set(node.store.items) == {m.item for m in node.description.product_management}
    assert isinstance(node.store.get("map"), LidarMap)


def test_a_state_of_another_type_is_refused() -> None:
    with pytest.raises(InputError, match="LidarMap"):
        Rover(plain).node.resume("nonsense")


def test_forgetting_begins_anew(ground: Ground) -> None:
    rover = Rover(ground)
    rover.drive(laps(ground, 0.1))
    rover.node.forget()
    assert len(rover.node.places) == 0
    rover.drive(laps(ground, 0.1))
    assert of(rover.outputs, "pose")[-1].quality.status is not Status.FAILED


def test_an_empty_sweep_does_not_end_it(ground: Ground) -> None:
    rover = Rover(ground)
    rover.drive(laps(ground, 0.1))
    rover.now_ns += PERIOD_NS
    empty = scan(ground, np.eye(4), np.eye(4), rover.now_ns, rover.rng)
    empty = type(empty).from_arrays(
        np.zeros((0, 3), np.float32), np.zeros(0, np.uint32), frame="mana/lidar", t0_ns=empty.t0_ns, t1_ns=empty.t1_ns
    )
    made = list(rover.node.step(Sample("scan", rover.now_ns, 99, empty)))
    assert {o.quality.status for o in made} == {Status.FAILED}
    assert {o.quality.reasons[0] for o in made} == {"lost"}
