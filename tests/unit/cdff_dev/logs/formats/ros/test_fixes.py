# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Positions of satellite navigation are positions in a local frame whose location is stated, and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from cdff_common import types
from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform
from cdff_dev.logs import open_log
from cdff_dev.logs.conversion import TimeSpan, convert_log
from cdff_dev.logs.differences import ROUNDING
from cdff_dev.logs.formats.ros.writer import create_ros_log
from cdff_dev.logs.log_comparison import log_differences
from cdff_dev.logs.mapping import LogMap, StreamTarget, read_map
from cdff_dev.new.profile import robots_of_log
from tests.unit.cdff_dev.logs.formats.ros.test_log import (
    PERIOD_NS,
    ROS1,
    ROS2,
    START_NS,
    header,
    write_ros1,
    write_ros2,
)

FIX = "sensor_msgs/msg/NavSatFix"
LON_DEG, LAT_DEG, HEIGHT_M = 1.4806, 43.5606, 150.0
#: Covariance of each position: east, north, up.
COVARIANCE_M2 = np.array([[0.8, 0.1, 0.0], [0.1, 0.5, 0.05], [0.0, 0.05, 3.0]])


def fix(store: Any, k: int, **fields: Any) -> Any:
    """Return the position after k steps of some metres to the north-east and up."""
    values = {
        "status": store.types["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
        "latitude": LAT_DEG + 1e-4 * k,
        "longitude": LON_DEG + 2e-4 * k,
        "altitude": HEIGHT_M + 0.5 * k,
        "position_covariance": COVARIANCE_M2.ravel(),
        "position_covariance_type": 3,
    }
    stamp_ns = START_NS + k * PERIOD_NS
    return store.types[FIX](header=header(store, stamp_ns, "/Antenna"), **(values | fields))


def bag_of(path: Path, store: Any, fixes: list[Any]) -> Path:
    content = [("/gps/fix", FIX, START_NS + k * PERIOD_NS, message) for k, message in enumerate(fixes)]
    return write_ros1(path, content) if store is ROS1 else write_ros2(path, content, StoragePlugin.MCAP)


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
def test_positions_are_those_of_a_local_frame_at_the_first_one(tmp_path: Path, store: Any) -> None:
    with open_log(bag_of(tmp_path / "rover", store, [fix(store, k) for k in range(20)])) as log:
        (fields,) = log.unconverted.items()
        assert fields[0] == "/gps/fix: status, position_covariance_type"
        assert (fields[1].type_name, fields[1].count) == (FIX, 20)
        assert list(log.streams) == ["/rover/gps_fix.anchor", "/rover/gps_fix.fix"]
        anchors, fixes = (list(log.samples([name])) for name in log.streams)
    # an independent conversion: PROJ's topocentric coordinates
    to_enu = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={LON_DEG} +lat_0={LAT_DEG} +h_0={HEIGHT_M}"
    )
    for k, sample in enumerate(fixes):
        expected = to_enu.transform(LON_DEG + 2e-4 * k, LAT_DEG + 1e-4 * k, HEIGHT_M + 0.5 * k)
        np.testing.assert_allclose(sample.value.data.translation, expected, atol=1e-6)
        assert sample.stamp_ns == START_NS + k * PERIOD_NS
    value = fixes[0].value
    assert (value.parent_frame, value.child_frame) == ("rover/enu", "rover/antenna")
    np.testing.assert_allclose(value.transform.covariance[:3, :3], COVARIANCE_M2, atol=1e-12)
    np.testing.assert_allclose(np.diag(value.transform.covariance)[3:], np.pi**2)
    assert list(value.metadata.data_estimated) == [True] * 3 + [False] * 4
    anchor = anchors[7].value
    assert (anchor.parent_frame, anchor.child_frame) == ("earth", "rover/enu")
    location = Anchor.from_transform(body("earth"), anchor.transform.matrix)
    position = (location.lon_deg, location.lat_deg, location.height_m)
    np.testing.assert_allclose(position, (LON_DEG, LAT_DEG, HEIGHT_M), atol=1e-8)


def test_messages_without_position_or_covariance_are_listed_with_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    no_fix = ROS1.types["sensor_msgs/msg/NavSatStatus"](status=-1, service=1)
    fixes = [
        fix(ROS1, 0, status=no_fix, latitude=0.0, longitude=0.0, altitude=0.0),
        fix(ROS1, 1, altitude=np.nan),
        fix(ROS1, 2, latitude=np.nan),
        fix(ROS1, 3, latitude=91.0),
        fix(ROS1, 4, position_covariance_type=0, position_covariance=np.zeros(9)),
        fix(ROS1, 5),
        fix(ROS1, 6, position_covariance=-np.ones(9)),
    ]
    bag = bag_of(tmp_path / "rover", ROS1, fixes)
    with open_log(bag) as log:
        for _ in range(2):  # reading does not count again
            samples = list(log.samples(["/rover/gps_fix.fix"]))
        counts = {name: item.count for name, item in log.unconverted.items()}
    assert [sample.stamp_ns for sample in samples] == [START_NS + k * PERIOD_NS for k in (4, 5, 6)]
    assert [sample.value.transform.covariance is None for sample in samples] == [True, False, True]
    np.testing.assert_array_equal(samples[0].value.data.translation, 0.0)
    assert counts == {
        "messages of /gps/fix without a fix": 1,
        "messages of /gps/fix without an altitude": 1,
        "messages of /gps/fix without a longitude and latitude": 2,
        "messages of /gps/fix without a covariance": 2,
        "/gps/fix: status, position_covariance_type": 7,
    }
    assert main(["log", "convert", str(bag), str(tmp_path / "out.mcap"), "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["unconverted"]["messages of /gps/fix without a fix"]["type"] == FIX
    assert "not converted: messages of /gps/fix without a covariance: " in output.err


def test_a_recording_without_any_position_has_no_stream_of_positions(tmp_path: Path) -> None:
    no_fix = ROS1.types["sensor_msgs/msg/NavSatStatus"](status=-1, service=1)
    with open_log(bag_of(tmp_path / "rover", ROS1, [fix(ROS1, k, status=no_fix) for k in range(3)])) as log:
        assert log.streams == {}
        assert log.unconverted["messages of /gps/fix without a fix"].count == 3


@pytest.mark.parametrize("target", ["out.bag", "out.mcap", "out"])
def test_converted_positions_are_equal(tmp_path: Path, target: str) -> None:
    unknown = {"position_covariance_type": 0, "position_covariance": np.zeros(9)}
    fixes = [fix(ROS1, k, **(unknown if k == 3 else {})) for k in range(12)]
    bag = bag_of(tmp_path / "rover", ROS1, fixes)
    with open_log(bag) as log:
        convert_log(log, tmp_path / "part.msg", span=TimeSpan(start_s=0.25))
    with open_log(tmp_path / "part.msg") as part:
        report = convert_log(part, tmp_path / target)
        assert report.losses == {}
        with open_log(tmp_path / target) as new:
            assert log_differences(part, new, ROUNDING) == []
    with AnyReader([tmp_path / target]) as reader:
        connections = [c for c in reader.connections if c.msgtype == FIX]
        assert [c.topic for c in connections] == ["/gps_fix"]
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    assert len(messages) == 9
    for message, original in zip(messages, fixes[3:], strict=True):
        # the resolution is that of positions: 1e-7 m
        assert message.latitude == pytest.approx(original.latitude, abs=2e-12)
        assert message.longitude == pytest.approx(original.longitude, abs=2e-12)
        assert message.altitude == pytest.approx(original.altitude, abs=1e-7)
        np.testing.assert_allclose(message.position_covariance, original.position_covariance, atol=1e-12)
        assert message.position_covariance_type == original.position_covariance_type
        assert message.header.frame_id == "antenna"


def _driver_fix(k: int) -> types.TransformWithCovariance:
    """Return a position in the site, as a driver of a receiver publishes it."""
    T = UncertainTransform.from_quaternion([3.0 * k, 4.0, 0.5], xyzw=[0, 0, 0, 1], covariance=np.eye(6) * 0.1)
    return types.TransformWithCovariance.from_transform(
        T, parent="site", child="mana/gnss", stamp_ns=START_NS + k * PERIOD_NS
    )


def test_positions_in_a_site_are_written_with_its_location_in_the_map(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(
        f"streams:\n  /mana/gnss.fix: {{to: /fix, message: {FIX}}}\nanchors:\n"
        f"  site: {{lon_deg: {LON_DEG}, lat_deg: {LAT_DEG}, height_m: {HEIGHT_M}, azimuth_deg: 90.0}}\n",
        encoding="utf-8",
    )
    with create_ros_log(tmp_path / "run.bag", read_map(path)) as writer:
        for k in range(3):
            writer.write("/mana/gnss.fix", _driver_fix(k), START_NS + k * PERIOD_NS)
    assert {loss for _, loss in writer.losses} == {
        "metadata.producer_id",
        "metadata.data_estimated",
        "data.cov",
    }
    with AnyReader([tmp_path / "run.bag"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/fix"]
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    # x of the site is south, y is east
    assert messages[2].latitude < messages[0].latitude < LAT_DEG + 1e-9
    assert all(message.longitude > LON_DEG for message in messages)
    with open_log(tmp_path / "run.bag") as log:
        samples = list(log.samples(["/mana/gnss.fix"]))
    np.testing.assert_allclose(
        [s.value.data.translation for s in samples], [[0, 4, 0.5], [3, 4, 0.5], [6, 4, 0.5]]
    )
    assert samples[0].value.parent_frame == "site"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("anchors: {site: {lon_deg: 1.0}}", "anchor of site: .* expected lon_deg and lat_deg"),
        ("anchors: {site: {lon_deg: 1.0, lat_deg: north}}", "expected numbers"),
        ("anchors: {site: {lon_deg: 1.0, lat_deg: 100.0}}", "latitude within 90"),
    ],
)
def test_wrong_locations_in_a_map_are_refused(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "map.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=expected):
        read_map(tmp_path / "map.yaml")


def test_positions_in_a_frame_of_unknown_location_are_refused(tmp_path: Path) -> None:
    mapping = LogMap({"/mana/gnss.fix": StreamTarget("/fix", FIX)})
    with (
        pytest.raises(InputError, match=r"location of its frame 'site' is not known; .* anchors"),
        create_ros_log(tmp_path / "run.bag", mapping) as writer,
    ):
        writer.write("/mana/gnss.fix", _driver_fix(0), START_NS)


def test_locations_of_foxglove_are_positions(tmp_path: Path) -> None:
    """The JSON of the schema; test_mcap.py has the one in protobuf."""
    fields = {
        "timestamp": {"sec": START_NS // 1_000_000_000, "nsec": START_NS % 1_000_000_000},
        "frame_id": "antenna",
        "latitude": LAT_DEG,
        "longitude": LON_DEG,
        "altitude": HEIGHT_M,
        "position_covariance": COVARIANCE_M2.ravel().tolist(),
        "position_covariance_type": 3,
    }
    path = tmp_path / "rover.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
        channel = writer.register_channel("/fix", "json", schema)
        writer.add_message(channel, START_NS, json.dumps(fields).encode(), START_NS)
        writer.finish()
    with open_log(path) as log:
        (sample,) = log.samples(["/rover/fix.fix"])
    assert sample.stamp_ns == START_NS
    np.testing.assert_allclose(sample.value.transform.covariance[:3, :3], COVARIANCE_M2, atol=1e-12)


def test_a_receiver_is_a_sensor_of_a_new_profile_and_no_wheel_odometry(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "rover", ROS1, [fix(ROS1, k) for k in range(3)])
    with open_log(bag) as log:
        (robot,) = robots_of_log(log, str(bag))
    (sensor,) = robot.sensors
    assert (sensor.name, sensor.kind, sensor.frame) == ("gps_fix", "other", "rover/antenna")
    assert sensor.streams == {"fix": "TransformWithCovariance"}
