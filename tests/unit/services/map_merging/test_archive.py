# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access of map merging to a DPM: survey and anchor of a map, atomic writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Reply, Request
from cdff_common.errors import ConflictError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_core.map_merging.joint_pose_graph import MapMerger, MergedMaps
from services.dpm.bus.service import serve
from services.dpm.operations.dpm import Dpm
from services.map_merging.archive import MapArchive
from tests.support.dpm_products import put_arguments
from tests.support.robot_maps import ROBOTS, closure, maps
from tests.unit.services.dpm.conftest import clock, dpm, empty_store

__all__ = ["clock", "dpm", "empty_store"]


class LocalBus:
    """A bus within this process."""

    def __init__(self) -> None:
        self._served: dict[str, Callable[[Request], Reply | Iterator[Reply]]] = {}

    def serve(self, key: str, answer: Callable[[Request], Reply | Iterator[Reply]], **_: object) -> None:
        self._served[key] = answer

    def declare_alive(self, *_: object) -> None: ...

    def publish_map(self, *_: object, **__: object) -> None: ...

    def call(
        self, key: str, parameters: Mapping[str, object] | None = None, payload: bytes = b"", **_: object
    ) -> Reply:
        request = Request(key, {k: str(v) for k, v in (parameters or {}).items()}, payload, "", b"")
        answer = self._served[key](request)
        (reply,) = [answer] if isinstance(answer, Reply) else answer
        return reply


@pytest.fixture
def archive(dpm: Dpm) -> MapArchive:
    """Archive on a DPM that holds both maps; the pose of each map frame is that of the profile."""
    bus: Any = LocalBus()
    serve(bus, dpm, ROBOTS)
    for m in maps():
        dpm.store.frames.set(m.graph.frame, "site", m.survey, producer="profile/test")
        dpm.writer.put(*put_arguments(m.graph, "pose_graph", robot=m.robot, frame=m.graph.frame))
    return MapArchive(bus, MergingConfig())


def merge(archive: MapArchive) -> tuple[MergedMaps, list[Any]]:
    maps_read = [archive.robot_map(robot) for robot in ROBOTS]
    assert None not in maps_read
    return MapMerger(MergingConfig(), ROBOTS).merge(maps_read, [closure(2, 3)]), maps_read  # type: ignore[arg-type]


def test_a_written_anchor_is_read_back_and_the_survey_is_unchanged(archive: MapArchive) -> None:
    result, maps_read = merge(archive)
    archive.write(result, maps_read, ["minnie"], {"closures": 1.0})
    for m, T in zip(maps(), (maps()[0].anchor, result.anchors["minnie"]), strict=True):
        read_back = archive.robot_map(m.robot)
        assert read_back is not None
        np.testing.assert_allclose(read_back.survey.matrix, m.survey.matrix, atol=1e-9)
        np.testing.assert_allclose(read_back.anchor.matrix, T.matrix, atol=1e-9)


def test_a_frame_pose_set_over_http_is_a_new_survey(archive: MapArchive, dpm: Dpm) -> None:
    result, maps_read = merge(archive)
    archive.write(result, maps_read, ["minnie"], {})
    T_site_map = UncertainTransform(se3.exp_se3([7.0, 1.0, 0.0, 0.0, 0.0, 1.0]), np.eye(6))
    dpm.store.frames.set("minnie/slam", "site", T_site_map, producer="http")
    read_back = archive.robot_map("minnie")
    assert read_back is not None
    np.testing.assert_allclose(read_back.survey.matrix, T_site_map.matrix, atol=1e-9)


def test_a_revision_by_another_client_prevents_the_write(archive: MapArchive, dpm: Dpm) -> None:
    result, maps_read = merge(archive)
    dpm.store.frames.set("minnie/slam", "site", maps_read[1].anchor, producer="http")
    with pytest.raises(ConflictError):
        archive.write(result, maps_read, ["minnie"], {})
    assert archive.merged_graph() is None


def test_the_same_graph_with_other_metrics_is_another_product(archive: MapArchive) -> None:
    result, maps_read = merge(archive)
    ids = [archive.write(result, maps_read, [], {"rejected": n}) for n in (1.0, 0.0, 0.0)]
    assert ids[0] != ids[1] == ids[2]


@pytest.mark.parametrize(
    ("parent", "covariance", "message"), [("body", np.eye(6), "parent"), ("site", None, "cov")]
)
def test_a_frame_that_is_not_surveyed_in_the_site_is_refused(
    archive: MapArchive,
    dpm: Dpm,
    parent: str,
    covariance: Any,
    message: str,
) -> None:
    dpm.store.frames.set("minnie/slam", parent, UncertainTransform(np.eye(4), covariance), producer="http")
    with pytest.raises(InputError, match=message):
        archive.robot_map("minnie")
    assert archive.robot_map("mana") is not None
