# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Real pocolog files open by their path, with the values that the tests of pocolog2msgpack assert."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_dev.logs import open_log
from cdff_dev.logs.formats.pocolog.blocks import read_blocks
from cdff_dev.logs.formats.pocolog.decoding import decode_sample
from cdff_dev.logs.formats.pocolog.registry import Registry

DATA = Path(os.environ.get("CDFF_DATA", "../shared/data")) / "pocolog"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no shared data at {DATA}")


def test_body_states_become_transforms_and_states() -> None:
    with closing(open_log(DATA / "rigid_body_state.0.log")) as log:
        samples = {s.stream: s for s in log.samples()}
    pose = samples["/robot/message_producer.messages"]
    assert (pose.value.parent_frame, pose.value.child_frame) == ("robot/target", "robot/source")
    np.testing.assert_allclose(pose.value.data.translation, [1.23, 2.52, 2.13])
    np.testing.assert_allclose(pose.value.data.orientation, [1.0, 5.0, -2.0, 2.0])
    np.testing.assert_allclose(pose.value.data.cov[:3, :3], np.eye(3))
    assert np.isnan(pose.value.data.cov[3:, 3:]).all()
    state = samples["/robot/message_producer.messages_state"].value
    np.testing.assert_array_equal(state.cov_position, np.eye(3))
    assert pose.stamp_ns == 1501072873034141000  # its own time is not set: the logical time


def test_laser_scans_become_points_with_the_time_of_the_scan() -> None:
    with closing(open_log(DATA / "laser_scan.0.log")) as log:
        sample = next(log.samples())
    assert sample.stamp_ns == sample.value.t0_ns == 1501161448845619000
    angles = np.array([0.0, 0.1])
    expected = np.stack([np.cos(angles), np.sin(angles), [0, 0]], axis=1) * [[0.030], [0.031]]
    np.testing.assert_allclose(sample.value.points_m, expected, atol=1e-6)
    np.testing.assert_allclose(np.diff(sample.value.time_offset_us), 1e6, atol=1)


def test_an_image_of_a_32_bit_computer_is_read() -> None:
    with closing(open_log(DATA / "camera32bit.0.log")) as log:
        sample = next(log.samples())
    assert sample.stream == "/robot/camera_a.frame"
    assert sample.value.image.shape == (360, 640, 3)
    assert {a.name: a.data for a in sample.value.metadata.attributes}["CameraTimeStamp"] == "1984805933319"


@pytest.mark.parametrize(("name", "value", "count"), [("integers", 1337, 5), ("strings", "1337", 6)])
def test_ports_without_a_counterpart_are_listed_and_their_values_are_decoded(
    name: str, value: object, count: int
) -> None:
    path = DATA / f"{name}.0.log"
    with closing(open_log(path)) as log:
        assert log.streams == {}
        assert log.unconverted["/messages.messages"].count == count
    messages = next(s for s in read_blocks(path).streams if s.name == "/messages.messages")
    kind = Registry(messages.registry, "<").build(messages.type_name)
    data = path.read_bytes()
    values = [
        decode_sample(kind, data[start : start + size], "<")
        for start, size in zip(messages.starts, messages.sizes, strict=True)
    ]
    assert values == [value] * count


def test_the_folder_opens_as_one_log() -> None:
    with closing(open_log(DATA)) as log:
        assert {name: info.count for name, info in log.streams.items()} == {
            "/robot/camera_a.frame": 1,
            "/robot/laser_scan_message_producer.messages": 2,
            "/robot/rigid_body_state_message_producer.messages": 2,
            "/robot/rigid_body_state_message_producer.messages_state": 2,
        }
        assert sum(item.count for item in log.unconverted.values()) == 23
        assert len(list(log.samples())) == 7
