# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Five robots drive on one router, four with a mistake of their integrator: each is named while they run.

The same mistakes in replay: ``tests/unit/cdff_core/consistency``. Each robot sends the samples of one drive;
the profile or the clock of all but one is wrong.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import on_map
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Header, product_id
from tests.integration.conftest import Eventually, Spawn
from tests.support.sensor_drive import Drive

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

ROBOT = """
  - id: {robot}
    frames:
      - {{parent: site, child: {robot}/odom}}
      - {{parent: {robot}/base, child: {robot}/imu, rpy_deg: [0, 0, {imu_yaw_deg}]}}
      - {{parent: {robot}/base, child: {robot}/mast, translation_m: [0.1, 0.0, 0.85]}}
      - {{parent: {robot}/mast, child: {robot}/lidar, rpy_deg: [{roll_deg}, 20, 0]}}
      - {{parent: {robot}/base, child: {robot}/navcam_left, quaternion_xyzw: {camera_xyzw}}}
    sensors:
      imu: {{kind: imu, frame: {robot}/imu, streams: {{sample: IMUSensors}}}}
      wheels: {{kind: wheels, frame: {robot}/base, streams: {{odometry: TransformWithCovariance}}}}
      navcam: {{kind: other, frame: {robot}/navcam_left, streams: {{odometry: TransformWithCovariance}}}}
      lidar: {{kind: lidar, frame: {robot}/lidar, streams: {{scan: LidarScan}}}}
      fused: {{kind: other, frame: {robot}/base, streams: {{pose: TransformWithCovariance}}}}
    dfpcs:
"""
POSITION = """      - name: position_manager
        activation: always
        queue: 10000
        inputs:
          imu: sensor/imu/sample
          odometry: sensor/wheels/odometry
          visual_odometry: sensor/navcam/odometry
"""
MAPPING = """      - name: digital_elevation_mapping
        activation: always
        queue: 10000
        implementation: Lidar
        inputs: {scan: sensor/lidar/scan, poses: sensor/fused/pose}
"""
#: Stream and type of the samples of each port.
STREAMS = {
    "imu": ("imu", "sample", "IMUSensors"),
    "odometry": ("wheels", "odometry", "TransformWithCovariance"),
    "visual_odometry": ("navcam", "odometry", "TransformWithCovariance"),
    "scan": ("lidar", "scan", "LidarScan"),
    "poses": ("fused", "pose", "TransformWithCovariance"),
}
PORTS = {
    "position_manager": ("imu", "odometry", "visual_odometry"),
    "digital_elevation_mapping": ("scan", "poses"),
}
TRUE = {"imu_yaw_deg": "90", "roll_deg": "0", "camera_xyzw": "[-0.5, 0.5, -0.5, 0.5]"}


@dataclass(frozen=True)
class Case:
    """A robot, its DFPC, the values of its profile that are wrong, and the alarm that is expected."""

    robot: str
    dfpc: str = "position_manager"
    wrong: tuple[tuple[str, str], ...] = ()
    imu_clock_s: float = 0.0
    alarm: str = ""


CASES = (
    Case("good"),
    Case("turned", wrong=(("imu_yaw_deg", "0"),), alarm="sensor_rotation of turned/imu"),
    Case("axes", wrong=(("camera_xyzw", "[0, 0, 0, 1]"),), alarm="sensor_rotation of axes/navcam"),
    Case("late", imu_clock_s=1.0, alarm="sensor_clock of late/imu"),
    Case(
        "flipped",
        "digital_elevation_mapping",
        (("roll_deg", "180"),),
        alarm="sensor_rotation of flipped/lidar",
    ),
)


@pytest.mark.slow
def test_each_wrong_sensor_is_named_and_its_products_degraded_while_the_good_robot_has_no_alarm(
    endpoint: str, spawn: Spawn, tmp_path: Path, eventually: Eventually
) -> None:
    profile, alarms, statuses = tmp_path / "robots.yaml", set[str](), defaultdict[str, set[str]](set)
    profile.write_text("name: wrong\nrobots:" + "".join(entry_of(case) for case in CASES))
    spawn("services.router")
    for case in CASES:
        spawn("services.dfpc_host", "--profile", str(profile), "--robot", case.robot, "--dfpc", case.dfpc)

    def add_alarms(_: str, body: dict[str, object]) -> None:
        items = body["items"]
        assert isinstance(items, list)
        alarms.update(f"{item['kind']} of {item['source']}" for item in items)

    def add_product(message: Message) -> None:
        quality = Header.from_attachment(message.attachment).quality
        sensor_reasons = {r.split(":")[0] for r in quality.reasons if r.startswith("sensor_")}
        statuses[message.key.split("/")[2]] |= {f"{quality.status} {r}" for r in sensor_reasons}

    with Bus.open(endpoint, name="test", wait_s=60) as bus:
        bus.subscribe(keys.alarms("*", "*"), on_map(add_alarms), depth=1024)
        bus.subscribe("cdff/@v1/*/product/*/*", add_product, depth=10_000)
        for case in CASES:
            eventually(lambda case=case: is_activated(bus, case), timeout_s=120, what=f"{case.robot} active")
        for case in CASES:
            drive = Drive(duration_s=18.0, robot=case.robot, offset_s={"imu": case.imu_clock_s})
            for sample in drive.samples(*PORTS[case.dfpc]):
                send(bus, case.robot, sample)
        expected = {case.alarm for case in CASES if case.alarm}
        eventually(lambda: alarms >= expected, timeout_s=120, what=f"{expected - alarms}")
        for case in CASES:
            kind = case.alarm.partition(" ")[0]
            if kind:
                eventually(
                    lambda robot=case.robot, kind=kind: f"DEGRADED {kind}" in statuses[robot],
                    timeout_s=30,
                    what=f"products of {case.robot} DEGRADED",
                )
        assert alarms == expected
        assert not statuses["good"]


def entry_of(case: Case) -> str:
    """Return the entry of a robot in the profile."""
    dfpc = POSITION if case.dfpc == "position_manager" else MAPPING
    return ROBOT.format(robot=case.robot, **TRUE | dict(case.wrong)) + dfpc


def is_activated(bus: Bus, case: Case) -> bool:
    try:
        bus.call(keys.dfpc_rpc(case.robot, case.dfpc, "activate"), timeout_s=5)
    except CdffError:
        return False
    return True


def send(bus: Bus, robot: str, sample: Sample) -> None:
    """Publish a sample as its driver does."""
    sensor, stream, type_name = STREAMS[sample.port]
    value = sample.value
    frame = getattr(value, "parent_frame", None) or sample.frame
    header = Header(
        id=product_id(robot, sensor, stream, sample.stamp_ns, sample.seq, ""),
        seq=sample.seq,
        t0_ns=sample.stamp_ns,
        t1_ns=sample.stamp_ns,
        frame=frame,
        child=getattr(value, "child_frame", None),
        producer="test/1",
    )
    payload = encode(value, "uper")
    key = keys.sensor(robot, sensor, stream)
    bus.publish(key, payload, encoding=encoding_string(type_name, "uper"), attachment=header.to_attachment())
