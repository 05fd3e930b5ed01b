# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Both viewers take every drawing, at its mission time."""

from __future__ import annotations

import typing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, EXIT_ERROR, main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_dev.logs import LogWriter
from cdff_dev.view import drawings
from cdff_dev.view.drawings import Layer
from cdff_dev.view.feed import Contents, Feed
from cdff_dev.view.panels import panels_of
from tests.unit.cdff_dev.view.test_feed import RecordingScene

S = 1_000_000_000
T = 1_700_000_000 * S

COLOURS = np.full((3, 3), 100, np.uint8)
DRAWINGS = (
    drawings.Transform("site", "mana/base", np.eye(4)),
    drawings.Points(np.eye(3, dtype=np.float32), COLOURS),
    drawings.Lines((np.eye(3), np.zeros((2, 3))), drawings.RED),
    drawings.Lines((), drawings.RED),
    drawings.Surface(np.eye(3), np.array([[0, 1, 2]], np.uint32), COLOURS),
    drawings.Picture(np.zeros((4, 6), np.uint8), np.diag([5.0, 5.0, 1.0])),
    drawings.Picture(np.zeros((4, 6, 3), np.uint8)),
    drawings.Marks(np.array([[1.0, 2.0]])),
    drawings.Ellipsoid(np.zeros(3), np.ones(3), np.eye(3)),
    drawings.Boxes(np.eye(4)[None], np.ones((1, 3)), ("rock",)),
    drawings.Number(3.5),
    drawings.Note("WARN", "DEGRADED: few_inliers"),
    drawings.Marks(np.array([[1.0, 2.0]]), np.array([[2.0, 2.0]]), "/mana/test/5"),
    drawings.Rectangles(np.array([[1.0, 1.0, 3.0, 2.0]]), ("rock",), "/mana/test/5"),
    drawings.Picture(np.zeros((4, 6, 3), np.uint8), picture="/mana/test/5"),
)


def layers() -> list[Layer]:
    return [Layer(f"/mana/test/{i}", "site", drawing) for i, drawing in enumerate(DRAWINGS)]


def test_the_drawings_of_this_test_are_all_there_are() -> None:
    assert {type(drawing) for drawing in DRAWINGS} == set(typing.get_args(drawings.Drawing))


def test_an_mcap_file_has_a_topic_for_each_layer_at_its_time(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    from mcap.reader import make_reader

    from cdff_dev.view.foxglove_scene import mcap_scene

    scene = mcap_scene(tmp_path / "scene.mcap")
    for layer in layers():
        scene.put(T, layer)
    scene.close()
    with (tmp_path / "scene.mcap").open("rb") as file:
        messages = [(channel.topic, schema.name, message.log_time)
                    for schema, channel, message in make_reader(file).iter_messages()]  # fmt: skip
    assert {stamp_ns for _, _, stamp_ns in messages} == {T}
    schema_of = {topic: name for topic, name, _ in messages}
    assert schema_of["/tf"] == "foxglove.FrameTransform"
    assert schema_of["/mana/test/1"] == "foxglove.PointCloud"
    assert schema_of["/mana/test/4"] == "foxglove.SceneUpdate"
    assert schema_of["/mana/test/5/calibration"] == "foxglove.CameraCalibration"
    assert schema_of["/mana/test/13"] == "foxglove.ImageAnnotations"
    assert {f"/mana/test/{i}" for i in range(1, len(DRAWINGS))} <= set(schema_of)


def test_the_foxglove_server_listens_on_this_machine_only() -> None:
    pytest.importorskip("foxglove")
    import socket

    from cdff_dev.ports import free_port
    from cdff_dev.view.foxglove_scene import server_scene

    port = free_port()
    scene = server_scene("127.0.0.1", port)
    try:
        for layer in layers():
            scene.put(T, layer)
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as client:
            client.sendall(
                b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
                b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
            )
            assert client.recv(1024).startswith(b"HTTP/1.1 101")
    finally:
        scene.close()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A rover with a lidar that moves 2 m."""
    path = tmp_path / "drive.msg"
    with LogWriter(path) as writer:
        for second in range(3):
            pose = UncertainTransform(se3.transform(np.eye(3), [second, 0.0, 0.0]), np.eye(6) * 0.01)
            stamp_ns = T + second * S
            value = TransformWithCovariance.from_transform(
                pose, parent="site", child="mana/base", stamp_ns=stamp_ns
            )
            writer.write("/mana/vo.pose", value, stamp_ns)
            cloud = Pointcloud.from_points(np.eye(3), frame="mana/base", stamp_ns=stamp_ns)
            writer.write("/mana/lidar.cloud", cloud, stamp_ns)
    return path


@pytest.mark.parametrize("name", ["scene.rrd", "scene.mcap"])
def test_a_log_is_saved_for_either_viewer(
    log: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun" if name.endswith("rrd") else "foxglove")
    out = tmp_path / name
    assert main(["view", str(log), "--save", str(out)]) == EXIT_DONE
    assert "6 samples, 4 layers in 1 spaces, 0 images" in capsys.readouterr().out
    assert out.read_bytes()[:4] == {"rrd": b"RRF2", "mcap": b"\x89MCA"}[out.suffix[1:]]


def test_the_layout_has_a_space_for_each_root_and_a_tab_for_each_robot(log: Path) -> None:
    pytest.importorskip("rerun")
    from cdff_dev.logs import open_log
    from cdff_dev.view.blueprint import blueprint

    feed = Feed(RecordingScene())
    with open_log(log) as source:
        for sample in source.samples():
            feed.add(sample)
    (tab,) = blueprint(feed.contents).root_container.contents
    assert tab.name == "mana"
    space, side = tab.contents
    assert space.name == "site"
    assert "/mana/lidar/cloud" in space.contents
    assert len(side.contents) == 1  # the plots


def contents_of_images() -> Contents:
    """An image of a camera with features, boxes and a disparity, and features without an image."""
    feed = Feed(RecordingScene())
    image = drawings.Picture(np.zeros((4, 6), np.uint8), np.diag([5.0, 5.0, 1.0]))
    disparity = drawings.Picture(np.zeros((4, 6, 3), np.uint8))
    marks = drawings.Marks(np.array([[1.0, 2.0]]))
    boxes = drawings.Rectangles(np.array([[1.0, 1.0, 3.0, 2.0]]), ("rock",))
    for path, frame, drawing in (
        ("/mana/a/features", "mana/camera", marks),  # waits for the image
        ("/mana/b/image", "mana/camera", image),
        ("/mana/b/disparity", "mana/camera", disparity),
        ("/mana/c/boxes", "mana/camera", boxes),
        ("/mana/d/features", "mana/other", marks),
    ):
        feed.add_layer(T, Layer(path, frame, drawing))
    feed.close()
    return feed.contents


def test_features_boxes_and_disparities_are_over_the_image_of_their_camera() -> None:
    (panels,) = panels_of(contents_of_images())
    assert [(image.path, image.marks, image.pictures) for image in panels.images] == [
        ("/mana/b/image", ("/mana/a/features", "/mana/c/boxes"), ("/mana/b/disparity",)),
        ("/mana/b/disparity", (), ()),
        ("/mana/d/features", (), ()),
    ]


def test_an_image_of_another_size_is_not_over_that_of_its_camera() -> None:
    feed = Feed(RecordingScene())
    for path, cols in (("/mana/b/image", 6), ("/mana/b/small", 3)):
        pixels = np.zeros((4, cols), np.uint8)
        feed.add_layer(T, Layer(path, "mana/camera", drawings.Picture(pixels)))
    (panels,) = panels_of(feed.contents)
    assert [image.pictures for image in panels.images] == [(), ()]


def test_both_layouts_have_the_same_panels() -> None:
    pytest.importorskip("rerun")
    pytest.importorskip("foxglove")
    import json

    from cdff_dev.view.blueprint import blueprint
    from cdff_dev.view.foxglove_layout import layout_of

    contents = contents_of_images()
    (tab,) = blueprint(contents).root_container.contents
    (side,) = tab.contents
    (images,) = side.contents
    assert [view.name for view in images.contents] == ["b/image", "b/disparity", "d/features"]
    assert "/mana/a/features/lines" in images.contents[0].contents
    assert "/mana/b/disparity" in images.contents[0].contents
    (robot,) = json.loads(layout_of(contents).to_json())["content"]["tabs"]
    (column,) = robot["content"]["items"]
    (row,) = column["content"]["items"]
    mode = row["content"]["tabs"][0]["content"]["config"]["imageMode"]
    assert robot["title"] == "mana"
    assert mode["imageTopic"] == "/mana/b/image"
    assert set(mode["annotations"]) == {"/mana/a/features", "/mana/c/boxes"}
    assert [overlay["topic"] for overlay in mode["overlayTopics"]] == ["/mana/b/disparity"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "name logs or folders of runs"),
        (["LOG", "--live"], "name logs or folders of runs"),
        (["LOG", "--save", "scene.txt"], "expected one of .rrd, .mcap"),
        (["LOG", "--port", "9"], "only with --foxglove"),
        (["LOG", "--layout", "layout.json", "--save", "scene.rrd"], "only with --foxglove or --save"),
        (["LOG", "--stream", "/a/b.c", "--save", "OUT"], "the logs have /mana/lidar.cloud, /mana/vo.pose"),
        (["LOG", "--t0", "2030-01-01T00:00:00Z", "--save", "OUT"], "no sample between"),
    ],
)
def test_wrong_arguments_are_reported(
    log: Path, tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if "OUT" in arguments:  # the output is opened before the logs are read
        pytest.importorskip("foxglove")
    named = {"LOG": str(log), "OUT": str(tmp_path / "out.mcap")}
    assert main(["view", *(named.get(word, word) for word in arguments)]) == EXIT_ERROR
    assert message in capsys.readouterr().err


def test_without_the_viewer_one_line_names_the_extra(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["view", str(log), "--save", str(tmp_path / "out.rrd")]) == EXIT_ERROR
    assert "rerun is not installed: pip install 'cdff[view]'" in capsys.readouterr().err
