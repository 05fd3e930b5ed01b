# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags that were not completed, or whose end or pages are missing."""

from __future__ import annotations

import logging
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from cdff_common.errors import CodecError
from cdff_dev.logs import open_log
from cdff_dev.logs.source import LogSource, Unconverted
from tests.unit.cdff_dev.logs.formats.ros.test_log import PERIOD_NS, ROS1, ROS2, START_NS, imu, write_ros2

_COUNT = 60
_IMU = "/rover/imu.imu"
_INDEX_POS = b"index_pos="


def _messages(store: Any) -> list[tuple[str, str, int, Any]]:
    return [
        ("/imu", "sensor_msgs/msg/Imu", START_NS + k * PERIOD_NS, imu(store, START_NS + k * PERIOD_NS))
        for k in range(_COUNT)
    ]


def _bag1(path: Path, compression: str | None) -> Path:
    """A bag with chunks of about nine messages."""
    bag = Writer1(path)
    bag.chunk_threshold = 4000
    if compression:
        bag.set_compression(Writer1.CompressionFormat[compression])
    with bag as writer:
        connection = None
        for topic, kind, stamp_ns, message in _messages(ROS1):
            connection = connection or writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(connection, stamp_ns, ROS1.serialize_ros1(message, kind))
    return path


def _bag2(folder: Path) -> Path:
    return write_ros2(folder, _messages(ROS2), StoragePlugin.SQLITE3) / f"{folder.name}.db3"


def _index_position(content: bytes | bytearray) -> int:
    at = content.index(_INDEX_POS) + len(_INDEX_POS)
    return int.from_bytes(content[at : at + 8], "little")


def _damage(log: LogSource) -> dict[str, Unconverted]:
    """Return the listed losses except the fields of inertial samples that CDFF lacks."""
    return {name: item for name, item in log.unconverted.items() if not name.startswith("/imu: ")}


def _stamps(log: LogSource) -> list[int]:
    """The stamps of the samples, which are those that the index states."""
    stamps = [sample.stamp_ns for sample in log.samples()]
    assert len(stamps) == log.streams[_IMU].count
    return stamps


def _expected(count: int) -> list[int]:
    return [START_NS + k * PERIOD_NS for k in range(count)]


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
@pytest.mark.parametrize("fraction", [0.4, 0.7])
def test_a_truncated_ros_1_bag_is_read_up_to_its_end(
    compression: str | None, fraction: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = _bag1(tmp_path / "rover.bag", compression)
    content = path.read_bytes()
    first, index_at = content.index(b"compression="), _index_position(content)
    path.write_bytes(content[: first + int((index_at - first) * fraction)])
    caplog.set_level(logging.WARNING, "cdff_dev.logs")
    with open_log(path) as log:
        stamps = _stamps(log)
        assert stamps == _expected(len(stamps))
        assert 0.5 * fraction * _COUNT < len(stamps) < _COUNT
        assert [item.type_name for item in _damage(log).values()] == ["damaged part"]
    assert len(caplog.records) == 1
    assert "rover.bag: byte" in caplog.text
    assert "the file ends" in caplog.text


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_a_ros_1_bag_without_its_index_is_read_whole(compression: str | None, tmp_path: Path) -> None:
    path = _bag1(tmp_path / "rover.bag", compression)
    content = bytearray(path.read_bytes())
    index_at = _index_position(content)
    at = content.index(_INDEX_POS) + len(_INDEX_POS)
    content[at : at + 8] = bytes(8)
    path.write_bytes(content[:index_at])
    with open_log(path) as log:
        assert _stamps(log) == _expected(_COUNT)
        (end,) = _damage(log).items()
    assert end[0] == f"byte {index_at}"
    assert "the recording was not completed" in end[1].reason


def test_a_damaged_part_of_a_ros_1_bag_is_left_out(tmp_path: Path) -> None:
    path = _bag1(tmp_path / "rover.bag", None)
    content = path.read_bytes()
    at = len(content) // 2
    path.write_bytes(content[:at] + content[at + 10 :])
    with open_log(path) as log:
        stamps = _stamps(log)
        assert set(stamps) < set(_expected(_COUNT))
        assert (stamps[0], stamps[-1]) == (START_NS, _expected(_COUNT)[-1])
        assert any(name.startswith("byte") for name in log.unconverted)


def test_a_file_that_is_no_bag_is_named_with_what_was_expected(tmp_path: Path) -> None:
    path = tmp_path / "rover.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")
    with open_log(path) as log:
        assert not log.streams
        assert "the recording was not completed" in log.unconverted["byte 13"].reason
    path.write_bytes(b"#ROSBAG V1.2\n")
    with pytest.raises(CodecError, match=r"rover\.bag: byte 0: .*expected the start of a ROS 1 bag"):
        open_log(path)


def test_a_truncated_database_is_read_as_far_as_its_pages(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = _bag2(tmp_path / "rover")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 8 // 10])
    caplog.set_level(logging.WARNING, "cdff_dev.logs")
    with open_log(path.parent) as log:
        stamps = _stamps(log)
        assert set(stamps) < set(_expected(_COUNT))
        assert len(stamps) > _COUNT // 3
        ((name, end),) = _damage(log).items()
    assert name == f"byte {len(content) * 8 // 10}"
    assert f"of {len(content)} bytes" in end.reason
    assert f"rover.db3: {name}" in caplog.text
    assert len(caplog.records) == 1


def test_rows_after_a_damaged_page_of_a_database_are_read(tmp_path: Path) -> None:
    path = _bag2(tmp_path / "rover")
    content = path.read_bytes()
    page = content.index(b"Imu_Link", len(content) // 2) // 4096 * 4096
    path.write_bytes(content[:page] + b"\xff" * 64 + content[page + 64 :])
    with open_log(path) as log:
        stamps = _stamps(log)
        assert set(stamps) < set(_expected(_COUNT))
        assert len(stamps) > _COUNT // 2
        assert "damaged page" in log.unconverted


def test_a_database_whose_recorder_was_ended_is_read_without_its_metadata(tmp_path: Path) -> None:
    path = _bag2(tmp_path / "rover")
    (path.parent / "metadata.yaml").unlink()
    (path.parent / "rover.db3-wal").write_bytes(b"rest")
    with open_log(path.parent) as log:
        assert _stamps(log) == _expected(_COUNT)
        assert "4 bytes of the end of the recording" in log.unconverted["rover.db3-wal"].reason
        assert "metadata.yaml" in log.unconverted


def test_messages_of_a_bag_without_definitions_have_the_standard_types(tmp_path: Path) -> None:
    path = _bag2(tmp_path / "rover")
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("INSERT INTO topics VALUES (9, '/own', 'own_msgs/msg/Own', 'cdr', '', '')")
    with open_log(path) as log:
        assert _stamps(log) == _expected(_COUNT)
        assert "does not define own_msgs/msg/Own" in log.unconverted["/own"].reason


def test_a_recorder_without_definitions_writes_messages_of_standard_types(tmp_path: Path) -> None:
    path = _bag2(tmp_path / "rover")
    with sqlite3.connect(path) as database:
        database.execute(
            "UPDATE message_definitions SET encoding = 'unknown', encoded_message_definition = ''"
        )
    with open_log(path) as log:
        assert _stamps(log) == _expected(_COUNT)


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_compressed_bags_of_ros_2_are_read_and_named_by_their_file(mode: str, tmp_path: Path) -> None:
    bag = Writer2(tmp_path / "rover", version=9, storage_plugin=StoragePlugin.SQLITE3)
    bag.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with bag as writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=ROS2)
        for _, kind, stamp_ns, message in _messages(ROS2):
            writer.write(connection, stamp_ns, ROS2.serialize_cdr(message, kind))
    with open_log(tmp_path / "rover") as log:
        assert _stamps(log) == _expected(_COUNT)
    for path in (tmp_path / "rover").glob("rover.db3*"):
        path.write_bytes(b"damaged")
        with pytest.raises(CodecError, match=path.name):
            open_log(tmp_path / "rover")
