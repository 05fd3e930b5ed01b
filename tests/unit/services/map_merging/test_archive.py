# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the merging reads from a DPM and writes there: survey and anchor of a map, all or nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Reply, Request
from cdff_common.errors import ConflictError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.merging import MergingConfig
from cdff_core.map_merging.solving import MapMerger, Merged
from services.dpm.operations import Dpm
from services.dpm.service import serve
from services.map_merging.archive import Archive
from tests.unit.cdff_core.map_merging.test_solving import ROBOTS, closure, maps
from tests.unit.services.dpm.conftest import clock, dpm, empty, parcel

__all__ = ["clock", "dpm", "empty"]


class LocalBus:
    """Calls what is served in this process."""

    def __init__(self) -> None:
        self._served: dict[str, Callable[[Request], Reply]] = {}

    def serve(self, key: str, answer: Callable[[Request], Reply], **_: object) -> None:
        self._served[key] = answer

    def declare_alive(self, *_: object) -> None: ...

    def publish_map(self, *_: object, **__: object) -> None: ...

    def call(self, key: str, asked: Mapping[str, object] | None = None, payload: bytes = b"", **_: object) -> Reply:
        return self._served[key](Request(key, {k: str(v) for k, v in (asked or {}).items()}, payload, "", b""))


@pytest.fixture
def archive(dpm: Dpm) -> Archive:
    """Of a DPM that has both maps, each frame as the profile has it."""
    bus: Any = LocalBus()
    serve(bus, dpm, ROBOTS)
    for m in maps():
        dpm.store.frames.set(m.graph.frame, "site", m.surveyed, producer="profile/test")
        dpm.put(*parcel(m.graph, "pose_graph", robot=m.robot, frame=m.graph.frame))
    return Archive(bus, MergingConfig())


def merged(archive: Archive) -> tuple[Merged, list[Any]]:
    there = [archive.map_of(robot) for robot in ROBOTS]
    assert None not in there
    return MapMerger(MergingConfig(), ROBOTS).merged(there, [closure(2, 3)]), there  # type: ignore[arg-type]


def test_what_was_written_is_the_anchor_and_the_survey_stays(archive: Archive) -> None:
    found, there = merged(archive)
    archive.write(found, there, ["minnie"], {"closures": 1.0})
    for m, T in zip(maps(), (maps()[0].anchor, found.anchors["minnie"]), strict=True):
        again = archive.map_of(m.robot)
        assert again is not None
        np.testing.assert_allclose(again.surveyed.matrix, m.surveyed.matrix, atol=1e-9)
        np.testing.assert_allclose(again.anchor.matrix, T.matrix, atol=1e-9)


def test_a_frame_that_is_set_by_hand_is_surveyed_anew(archive: Archive, dpm: Dpm) -> None:
    found, there = merged(archive)
    archive.write(found, there, ["minnie"], {})
    by_hand = UncertainTransform(se3.exp_se3([7.0, 1.0, 0.0, 0.0, 0.0, 1.0]), np.eye(6))
    dpm.store.frames.set("minnie/slam", "site", by_hand, producer="http")
    again = archive.map_of("minnie")
    assert again is not None
    np.testing.assert_allclose(again.surveyed.matrix, by_hand.matrix, atol=1e-9)


def test_nothing_is_written_where_somebody_else_revised_a_frame(archive: Archive, dpm: Dpm) -> None:
    found, there = merged(archive)
    dpm.store.frames.set("minnie/slam", "site", there[1].anchor, producer="http")
    with pytest.raises(ConflictError):
        archive.write(found, there, ["minnie"], {})
    assert archive.merged_graph() is None


def test_the_same_graph_with_other_figures_is_another_product(archive: Archive) -> None:
    found, there = merged(archive)
    ids = [archive.write(found, there, [], {"rejected": n}) for n in (1.0, 0.0, 0.0)]
    assert ids[0] != ids[1] == ids[2]


@pytest.mark.parametrize(("parent", "covariance", "message"), [("body", np.eye(6), "hangs on"), ("site", None, "cov")])
def test_a_frame_that_is_not_surveyed_in_the_site_is_refused(
    archive: Archive,
    dpm: Dpm,
    parent: str,
    covariance: Any,
    message: str,
) -> None:
    dpm.store.frames.set("minnie/slam", parent, UncertainTransform(np.eye(4), covariance), producer="http")
    with pytest.raises(InputError, match=message):
        archive.map_of("minnie")
    assert archive.map_of("mana") is not None
