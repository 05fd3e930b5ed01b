# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The feed puts samples into a scene with one parent for each frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, Quality, Status
from cdff_common.types import Pointcloud, Time, TransformWithCovariance
from cdff_dev.logs.source import LogSample
from cdff_dev.view.drawings import Layer, Lines, Note, Number, Transform
from cdff_dev.view.feed import Feed, sources_of

S = 1_000_000_000


class RecordingScene:
    """Records its layers."""

    def __init__(self) -> None:
        self.layers: list[tuple[int, Layer]] = []

    def put(self, stamp_ns: int, layer: Layer) -> None:
        self.layers.append((stamp_ns, layer))

    def close(self) -> None:
        pass


def pose(stream: str, second: int, parent: str = "site", child: str = "mana/base") -> LogSample:
    T = UncertainTransform(se3.transform(np.eye(3), [float(second), 0.0, 0.0]))
    value = TransformWithCovariance.from_transform(T, parent=parent, child=child, stamp_ns=second * S)
    return LogSample(stream, "TransformWithCovariance", second * S, second, value)


def edges(scene: RecordingScene) -> set[tuple[str, str]]:
    return {
        (layer.drawing.parent, layer.drawing.child)
        for _, layer in scene.layers
        if isinstance(layer.drawing, Transform)
    }


def test_true_poses_get_a_frame_of_their_own_beside_an_estimate() -> None:
    samples = [pose("/mana/truth.pose", 0), pose("/mana/vo.pose", 0)]
    scene = RecordingScene()
    feed = Feed(scene, sources_of(samples))
    for sample in samples:
        feed.add(sample)
    assert edges(scene) == {("site", "mana/base"), ("site", "mana/base@mana/truth.pose")}
    assert sources_of(samples) == {"mana/base": "/mana/vo.pose"}


def test_the_path_grows_and_ends_with_all_poses() -> None:
    scene = RecordingScene()
    feed = Feed(scene, path_every=2)
    for second in range(5):
        feed.add(pose("/mana/vo.pose", second))
    feed.close()
    paths = [(t, layer.drawing) for t, layer in scene.layers if isinstance(layer.drawing, Lines)]
    assert [(t // S, len(lines.lines_m[0])) for t, lines in paths] == [(1, 2), (3, 4), (4, 5)]


def test_edges_that_contradict_the_tree_are_left_out() -> None:
    scene = RecordingScene()
    feed = Feed(scene)
    feed.add(pose("/mana/vo.pose", 0))
    feed.add(pose("/mana/other.pose", 0, parent="mana/base", child="site"))  # would close a loop
    feed.add(pose("/mana/vo.motion", 0, parent="site", child="site"))
    assert edges(scene) == {("site", "mana/base")}


def test_the_time_between_samples_is_plotted() -> None:
    scene = RecordingScene()
    feed = Feed(scene)
    for second in (0, 2):
        feed.add(pose("/mana/vo.pose", second))
    (period,) = [layer.drawing for _, layer in scene.layers if layer.path == "/mana/vo/pose/timing/period_s"]
    assert period == Number(2.0)


def test_the_contents_name_roots_robots_and_what_is_not_drawn() -> None:
    feed = Feed(RecordingScene())
    feed.add(pose("/mana/vo.pose", 0))
    cloud = Pointcloud.from_points([[0, 0, 0]], frame="mana/base", stamp_ns=0)
    feed.add(LogSample("/mana/lidar.cloud", "Pointcloud", 0, 0, cloud))
    feed.add(LogSample("/minnie/clock.time", "Time", 0, 0, Time()))
    assert feed.contents.roots() == ["site"]
    assert feed.contents.robots() == ["mana"]
    assert feed.contents.not_drawn == {"Time": 1}


def test_fixed_frames_of_a_profile_are_shown(tmp_path: Path) -> None:
    from cdff_common.geometry import FrameGraph

    graph, scene = FrameGraph(), RecordingScene()
    graph.set_static("mana/base", "mana/lidar", UncertainTransform.exact(np.eye(4)))
    Feed(scene).add_fixed(graph, 0)
    assert edges(scene) == {("mana/base", "mana/lidar")}


def product(status: Status, second: int, value: Any) -> LogSample:
    quality = Quality(status, () if status == Status.OK else ("few_inliers",))
    header = Header("0" * 32, second, second * S, second * S, "site", "vo", quality=quality)
    return LogSample("/mana/vo.cloud", "Pointcloud", second * S, second, value, header)


def test_a_product_that_failed_has_a_message_and_one_when_it_is_ok_again() -> None:
    scene = RecordingScene()
    feed = Feed(scene)
    cloud = Pointcloud.from_points(np.eye(3), frame="site", stamp_ns=0)
    feed.add(product(Status.OK, 0, cloud))
    feed.add(product(Status.FAILED, 1, None))
    feed.add(product(Status.OK, 2, cloud))
    feed.add(product(Status.OK, 3, cloud))
    notes = [(stamp_ns // S, layer.drawing.level, layer.drawing.text) for stamp_ns, layer in scene.layers
             if isinstance(layer.drawing, Note)]  # fmt: skip
    assert notes == [(1, "ERROR", "FAILED: few_inliers"), (2, "INFO", "OK again")]
    assert not feed.contents.not_drawn
