# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of two topics of a bag become stereo pairs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_dev.logs import open_log
from tests.unit.cdff_dev.logs.formats.ros.test_log import (
    PERIOD_NS,
    ROS1,
    ROS2,
    START_NS,
    Message,
    StoragePlugin,
    header,
    vector,
    write_ros1,
    write_ros2,
)

ROWS, COLS, FOCAL_PX, BASELINE_M = 24, 32, 30.0, 0.25
PAIR = "/rover/front.pair"


def image(store: Any, side: str, stamp_ns: int, value: int, encoding: str = "mono8") -> Any:
    channels = 1 if encoding == "mono8" else 3
    return store.types["sensor_msgs/msg/Image"](
        header=header(store, stamp_ns, f"camera_{side}"),
        height=ROWS,
        width=COLS,
        encoding=encoding,
        is_bigendian=0,
        step=COLS * channels,
        data=np.full(ROWS * COLS * channels, value, np.uint8),
    )


def camera_info(
    store: Any, side: str, *, baseline_m: float = BASELINE_M, model: str = "plumb_bob", d: float = 0.0
) -> Any:
    K = np.array([[FOCAL_PX, 0.0, COLS / 2], [0.0, FOCAL_PX, ROWS / 2], [0.0, 0.0, 1.0]])
    offset = -FOCAL_PX * baseline_m if side == "right" else 0.0
    P = np.column_stack([K, [offset, 0.0, 0.0]])
    names = ("D", "K", "R", "P") if store is ROS1 else ("d", "k", "r", "p")
    values = np.array([d, 0.0, 0.0, 0.0]), K.ravel(), np.eye(3).ravel(), P.ravel()
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return store.types["sensor_msgs/msg/CameraInfo"](
        header=header(store, START_NS, f"camera_{side}"),
        height=ROWS,
        width=COLS,
        distortion_model=model,
        binning_x=0,
        binning_y=0,
        roi=roi,
        **dict(zip(names, values, strict=True)),
    )


def drive(
    store: Any, name: str = "image_rect", *, encoding: str = "mono8", **calibration: Any
) -> list[Message]:
    """Three images of each camera, the right ones 1 ms later and recorded first, and a fourth left image."""
    messages: list[Message] = []
    for side in ("left", "right"):
        info = camera_info(store, side, **calibration)
        messages.append((f"/front/{side}/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, info))
    for k in range(4):
        for side, delay_ns in (("right", 1_000_000), ("left", 0)):
            stamp_ns = START_NS + k * PERIOD_NS + delay_ns
            if (side, k) != ("right", 3):
                message = image(store, side, stamp_ns, 10 * k + (side == "left"), encoding)
                topic = f"/front/{side}/{name}"
                messages.append((topic, "sensor_msgs/msg/Image", stamp_ns - 2 * delay_ns, message))
    return messages


@pytest.fixture(params=["ros1", "sqlite3", "mcap"])
def recorded(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    def write(**options: Any) -> Path:
        if request.param == "ros1":
            return write_ros1(tmp_path / "rover", drive(ROS1, **options))
        plugin = StoragePlugin.SQLITE3 if request.param == "sqlite3" else StoragePlugin.MCAP
        return write_ros2(tmp_path / "rover", drive(ROS2, **options), plugin)

    return write


def test_rectified_grey_images_become_pairs_with_the_stamp_of_the_left_image(recorded: Any) -> None:
    with open_log(recorded()) as log:
        assert list(log.streams) == [PAIR]
        assert log.unconverted["single images of /front/left/image_rect"].count == 1
        samples = list(log.samples())
    assert [s.stamp_ns for s in samples] == [START_NS + k * PERIOD_NS for k in range(3)]
    for k, sample in enumerate(samples):
        pair = sample.value
        assert (int(pair.left.image[0, 0]), int(pair.right.image[0, 0])) == (10 * k + 1, 10 * k)
        assert pair.baseline == pytest.approx(BASELINE_M)
        assert pair.left.camera_matrix[0, 0] == FOCAL_PX
        assert sample.header is not None
        assert sample.header.frame == "rover/camera_left"


def test_colour_images_keep_their_own_streams(recorded: Any) -> None:
    with open_log(recorded(encoding="rgb8")) as log:
        frames = ["/rover/front_left_image_rect.frame", "/rover/front_right_image_rect.frame"]
        assert list(log.streams) == [PAIR, *frames]
        assert [log.streams[name].count for name in (PAIR, *frames)] == [3, 4, 3]
        samples = list(log.samples())
        assert [s.seq for s in samples if s.stream == PAIR] == [0, 1, 2]
        assert next(log.samples([PAIR])).value.left.image.ndim == 2
        assert len(list(log.samples([PAIR, frames[1]]))) == 6


def test_images_with_distortion_are_rectified(recorded: Any) -> None:
    with open_log(recorded(name="image_raw", d=-0.2)) as log:
        assert PAIR in log.streams
        pair = next(log.samples([PAIR])).value
        assert pair.baseline == pytest.approx(BASELINE_M)
        assert not np.any(pair.left.intrinsic.dist_coeffs)


def test_cameras_without_a_baseline_are_listed_with_the_reason(recorded: Any) -> None:
    with open_log(recorded(baseline_m=0.0)) as log:
        assert PAIR not in log.streams
        reason = log.unconverted["pairs of /front/left/image_rect"].reason
    assert "no baseline" in reason
    assert "camera_right" in reason


def test_the_baseline_is_that_of_the_frame_tree_if_the_calibration_has_none(tmp_path: Path) -> None:
    types = ROS2.types

    def transform(child: str, y: float) -> Any:
        q = types["geometry_msgs/msg/Quaternion"](-0.5, 0.5, -0.5, 0.5)
        T = types["geometry_msgs/msg/Transform"](vector(ROS2, 0.1, y, 0.0), q)
        return types["geometry_msgs/msg/TransformStamped"](header(ROS2, START_NS, "base"), child, T)

    tree = types["tf2_msgs/msg/TFMessage"]([transform("camera_left", 0.06), transform("camera_right", -0.06)])
    messages = [("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, tree), *drive(ROS2, baseline_m=0.0)]
    with open_log(write_ros2(tmp_path / "rover", messages, StoragePlugin.MCAP)) as log:
        assert next(log.samples([PAIR])).value.baseline == pytest.approx(0.12)


def test_compressed_images_use_the_calibration_of_their_camera(tmp_path: Path) -> None:
    compressed = ROS2.types["sensor_msgs/msg/CompressedImage"]
    messages = [
        (
            f"{topic}/compressed",
            "sensor_msgs/msg/CompressedImage",
            recorded_ns,
            compressed(
                message.header, "png", cv2.imencode(".png", message.data.reshape(ROWS, COLS))[1].ravel()
            ),
        )
        if kind.endswith("Image")
        else (topic, kind, recorded_ns, message)
        for topic, kind, recorded_ns, message in drive(ROS2)
    ]
    with open_log(write_ros2(tmp_path / "rover", messages, StoragePlugin.MCAP)) as log:
        assert log.streams[PAIR].count == 3
        assert next(log.samples()).value.baseline == pytest.approx(BASELINE_M)
