# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The position manager on the shipped traverse: end errors per path length are within those of its page."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.runtime import Runner
from cdff_dev.logs import LogSample, open_log
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.store import SIDECAR, describe, simulated_log
from cdff_dev.simulate.traverse import levelled, proprioceptive_entries
from cdff_dev.simulate.world import World, make_world
from evaluation.runs.traverse import EXACT_MOUNTS, SIMULATED_CAMERA

ROBOTS = ("mana", "minnie")


def context(description: dict[str, object], robot: str) -> DfpcContext:
    graph = FrameGraph()
    for edge in description["robots"][robot]["frames"]:  # type: ignore[index]
        T = se3.transform_from_quaternion_xyzw(edge["translation_m"], edge["quaternion_xyzw"])
        graph.set_static(edge["parent"], edge["child"], UncertainTransform.exact(T))
    return DfpcContext(robot, graph)


def run(dfpc_context: DfpcContext, samples: list[Sample]) -> list[Output]:
    dfpc = Registry.default().make_dfpc("position_manager")
    dfpc.configure(EXACT_MOUNTS, dfpc_context)
    out = [o for s in sorted(samples, key=lambda s: (s.stamp_ns, s.port)) for o in dfpc.step(s)]
    return [o for o in out if o.port == "pose"]


def end_error(outputs: list[Output], truth: dict[int, np.ndarray]) -> tuple[float, float]:
    """Return the error of the last pose per path length, and its normalised squared error (6 degrees of
    freedom).
    """
    stamps = sorted(truth)
    path_length_m = sum(
        np.linalg.norm(truth[b][:3, 3] - truth[a][:3, 3]) for a, b in itertools.pairwise(stamps)
    )
    last = outputs[-1]
    nearest = min(stamps, key=lambda t: abs(t - last.t1_ns))
    error = pose_error(truth[nearest], last.value.transform.matrix)
    nees = float(error @ np.linalg.solve(last.value.transform.covariance, error))
    return float(np.linalg.norm(error[:3]) / path_length_m), nees


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The shipped scenario on a coarser grid, since no image is rendered."""
    full = load_scenario("rover_traverse").model_dump()
    full["terrain"] |= {"resolution_m": 0.1, "fine_half_width_m": 16.0, "far_half_width_m": 60.0}
    full["terrain"]["surface"] |= {"texel_m": 0.2}
    full["terrain"]["rocks"] |= {"count": 0}
    return Scenario.model_validate(full)


@pytest.fixture(scope="module")
def world(scenario: Scenario) -> World:
    return make_world(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_wheels_and_imu_alone_have_an_error_below_four_percent_within_their_covariance(
    scenario: Scenario, world: World, robot: str
) -> None:
    ports = {f"/{robot}/wheels.odometry": "odometry", f"/{robot}/imu.sample": "imu"}
    entries = list(proprioceptive_entries(world, robot))
    samples = [
        Sample(ports[e.stream], e.stamp_ns, e.header.seq, e.value) for e in entries if e.stream in ports
    ]
    truth = {e.stamp_ns: e.value.transform.matrix for e in entries if e.stream == f"/{robot}/truth.pose"}
    dfpc_context = context(
        describe(scenario, {r: levelled(world.motions[r].poses(np.zeros(1))[0]) for r in ROBOTS}), robot
    )
    outputs = run(dfpc_context, samples)
    relative_error, nees = end_error(outputs, truth)
    assert relative_error < 0.04
    assert nees < 16.8  # 99 % quantile of χ² with 6 degrees of freedom
    assert {o.quality.status for o in outputs} == {Status.DEGRADED}


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_with_visual_odometry_the_error_is_below_half_a_percent(robot: str) -> None:
    folder: Path = simulated_log(load_scenario("rover_traverse"))
    dfpc_context = context(json.loads((folder / SIDECAR).read_text(encoding="utf-8")), robot)
    log = open_log(folder)
    try:
        measured = list(
            log.samples([f"/{robot}/wheels.odometry", f"/{robot}/imu.sample", f"/{robot}/truth.pose"])
        )
        visual = visual_odometry(dfpc_context, log.samples([f"/{robot}/navcam.pair"]))
    finally:
        log.close()
    ports = {f"/{robot}/wheels.odometry": "odometry", f"/{robot}/imu.sample": "imu"}
    truth = {s.stamp_ns: s.value.transform.matrix for s in measured if s.stream not in ports}
    samples = [Sample(ports[s.stream], s.stamp_ns, s.seq, s.value) for s in measured if s.stream in ports]
    outputs = run(dfpc_context, [*samples, *visual])
    relative_error, nees = end_error(outputs, truth)
    assert relative_error < 0.005
    assert nees < 16.8
    assert outputs[-1].quality.status is Status.OK


def visual_odometry(dfpc_context: DfpcContext, pairs: object) -> list[Sample]:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(SIMULATED_CAMERA, dfpc_context)
    runner = Runner(dfpc)
    results: list[Sample] = []
    for pair in pairs:  # type: ignore[attr-defined]
        assert isinstance(pair, LogSample)
        runner.push(Sample("stereo", pair.stamp_ns, pair.seq, pair.value))
        for product in runner.step_one():
            if product.port == "pose":
                value: TransformWithCovariance = product.value
                results.append(
                    Sample(
                        "visual_odometry",
                        product.header.t1_ns,
                        product.header.seq,
                        value,
                        quality=product.header.quality,
                    )
                )
    return results
