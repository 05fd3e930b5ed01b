# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual maps of two robots are merged through the DPM."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.types import PoseGraph, VisualMap
from cdff_common.types.visual_map_ext import KeyframePoints
from services.dpm.bus.service import serve
from services.dpm.operations.dpm import Dpm
from services.map_merging.archive import MapArchive
from services.map_merging.merging_rounds import MergingRounds
from tests.support import textured_walls as walls
from tests.support.dpm_products import put_arguments
from tests.unit.services.dpm.conftest import clock, dpm, empty_store
from tests.unit.services.map_merging.test_archive import LocalBus

__all__ = ["clock", "dpm", "empty_store"]

#: True poses of the map frames, and the assumed pose of the second: wrong by 0.9 m and 6 degrees.
T_SITE_MAP = {"mana": np.eye(4), "minnie": se3.transform(se3.exp_so3([0.0, -0.05, 0.0]), [0.25, 0.02, 0.0])}
SURVEY_ERROR = se3.exp_se3([0.8, 0.3, -0.3, 0.0, 0.1, 0.0])
STEP = se3.transform(np.eye(3), [0.15, 0.0, 0.0])


def visual_map(robot: str) -> VisualMap:
    """Return a map of two keyframes, the first of which is its origin."""
    poses = [T_SITE_MAP[robot], T_SITE_MAP[robot] @ STEP]
    wall_map = walls.wall_map(poses)
    graph = PoseGraph.from_arrays(
        np.arange(2),
        np.array([1, 2]) * 10**9,
        np.array([np.eye(4), STEP]),
        np.array([[0, 1]]),
        STEP[None],
        np.diag([1e6] * 6)[None],
        [0],
        frame=f"{robot}/visual_slam",
        fixed=np.array([True, False]),
    )
    return replace(wall_map, graph=graph)


def surveyed(dpm: Dpm) -> MapArchive:
    """Return the archive of a DPM that holds both maps."""
    bus: Any = LocalBus()
    serve(bus, dpm, ("mana", "minnie"))
    for robot, T_site_map in T_SITE_MAP.items():
        error, sigma = (SURVEY_ERROR, 1.0) if robot == "minnie" else (np.eye(4), 1e-3)
        survey = UncertainTransform(T_site_map @ error, np.diag([sigma**2] * 3 + [(0.1 * sigma) ** 2] * 3))
        frame = f"{robot}/visual_slam"
        dpm.store.frames.set(frame, "site", survey, producer="profile/test")
        dpm.writer.put(*put_arguments(visual_map(robot), "visual_map", robot=robot, frame=frame))
    return MapArchive(bus, MergingConfig(maps="visual"))


def test_the_map_with_the_uncertain_anchor_is_moved_to_its_place(dpm: Dpm) -> None:
    archive = surveyed(dpm)
    rounds = MergingRounds(archive, MergingConfig(maps="visual"), ("mana", "minnie"))
    while rounds.run():
        pass
    merged = archive.robot_map("minnie")
    assert merged is not None
    error = se3.inverse(T_SITE_MAP["minnie"]) @ merged.anchor.matrix
    assert np.linalg.norm(error[:3, 3]) < 0.03  # 0.9 m before
    assert np.degrees(se3.rotation_angle(error[:3, :3])) < 0.5  # 6 degrees before
    graph = archive.merged_graph()
    assert graph is not None
    assert len(graph.vertices.ids) == 4


def test_the_points_of_a_visual_map_survive_the_dpm(dpm: Dpm) -> None:
    archive = surveyed(dpm)
    robot_map = archive.robot_map("mana")
    assert robot_map is not None
    keyframe = next(iter(robot_map.keyframes))
    stored: KeyframePoints = archive.local_points(robot_map, keyframe)
    np.testing.assert_array_equal(stored.descriptors, visual_map("mana").keyframes[0].descriptors)
