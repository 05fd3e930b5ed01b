# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The driver kit on a real router: headers, modes, clocks, liveliness; and each template as a process."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import pack
from cdff_common.cli import EXIT_ERROR, main
from cdff_common.client import ActiveMode, Sensor
from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError, ConflictError, InputError, UnavailableError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Header, Status
from cdff_common.types import IMUSensors, LidarScan
from cdff_dev.new.commands import DRIVERS
from services.dfpc_host.inputs import decode_sample
from tests.integration.conftest import Eventually, Spawn, wait_until

ROOT = Path(__file__).resolve().parents[2]
MS = 1_000_000


@pytest.fixture
def router(endpoint: str) -> Iterator[Bus]:
    with Bus.open_router(endpoint) as bus:
        yield bus


@pytest.fixture
def consumer(router: Bus, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="consumer") as bus:
        yield bus


def subscribed(bus: Bus, sensor: str, stream: str) -> list[Message]:
    messages: list[Message] = []
    bus.subscribe(keys.sensor("mana", sensor, stream), messages.append, depth=1000)
    return messages


def reading() -> IMUSensors:
    return IMUSensors(acc=np.array([0, 0, 9.81]), gyro=np.zeros(3))


def imu_of(message: Message) -> Sample:
    return decode_sample(message, "imu", "IMUSensors")


def test_samples_arrive_numbered_with_frame_stamp_and_value(
    consumer: Bus, endpoint: str, eventually: Eventually
) -> None:
    messages = subscribed(consumer, "imu", "sample")
    t0_ns = wall_ns()
    with Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint) as imu:
        token = keys.alive("mana", "sensor_imu_sample")
        wait_until(lambda: consumer.alive(token), 10.0, "the token of the sensor has passed the router")
        for i in range(5):
            assert imu.publish(reading(), t0_ns + 10 * MS * i + 999)
    eventually(lambda: len(messages) == 5)
    samples = [imu_of(message) for message in messages]
    assert [s.seq for s in samples] == [0, 1, 2, 3, 4]
    assert [s.stamp_ns for s in samples] == [t0_ns + 10 * MS * i for i in range(5)]
    assert [s.value.stamp_ns for s in samples] == [s.stamp_ns for s in samples]
    assert {s.frame for s in samples} == {"mana/imu"}
    assert len({s.id for s in samples}) == 5
    eventually(lambda: not consumer.alive(keys.alive("mana", "sensor_imu_sample")))


def test_a_sweep_has_the_start_and_end_of_its_capture(
    consumer: Bus, endpoint: str, eventually: Eventually
) -> None:
    messages = subscribed(consumer, "lidar", "scan")
    t1_ns = wall_ns()
    scan = LidarScan.from_arrays(
        np.ones((4, 3)), np.arange(4), frame="mana/lidar", t0_ns=t1_ns - 100 * MS, t1_ns=t1_ns
    )
    with Sensor("lidar/scan", LidarScan, frame="mana/lidar", connect=endpoint) as lidar:
        lidar.publish(scan)
    eventually(lambda: messages)
    header = Header.from_attachment(messages[0].attachment)
    assert (header.t0_ns, header.t1_ns) == (t1_ns - 100 * MS, t1_ns)
    assert decode_sample(messages[0], "scan", "LidarScan").value == scan


def test_samples_that_contradict_the_sensor_are_refused(router: Bus, endpoint: str) -> None:
    now_ns = wall_ns()
    with Sensor("lidar/scan", LidarScan, frame="mana/lidar", connect=endpoint) as lidar:
        other = LidarScan.from_arrays(np.ones((1, 3)), [0], frame="mana/base", t0_ns=now_ns, t1_ns=now_ns)
        with pytest.raises(InputError, match="frame 'mana/base' in the value, expected 'mana/lidar'"):
            lidar.publish(other)
        with pytest.raises(InputError, match="got a IMUSensors, expected LidarScan"):
            lidar.publish(reading(), now_ns)
        scan = LidarScan.from_arrays(np.ones((1, 3)), [0], frame="mana/lidar", t0_ns=now_ns, t1_ns=now_ns)
        with pytest.raises(InputError, match=r"1\.000000 s later"):
            lidar.publish(scan, now_ns - 1000 * MS)
        with pytest.raises(InputError, match="no stamp"):
            lidar.publish(LidarScan.from_arrays(np.ones((1, 3)), [0], frame="mana/lidar", t0_ns=0, t1_ns=0))
        with pytest.raises(InputError, match="its time is 0"):
            lidar.publish(
                LidarScan.from_arrays(np.ones((1, 3)), [0], frame="mana/lidar", t0_ns=0, t1_ns=0), now_ns
            )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"stream": "lidar", "frame": "mana/lidar"}, "expected sensor/stream"),
        ({"stream": "Lidar/scan", "frame": "mana/lidar"}, "a key chunk contains"),
        ({"stream": "lidar/scan", "frame": "/mana/lidar"}, "frame"),
        ({"stream": "lidar/scan", "frame": "mana/lidar", "queue": 0}, "queue=0"),
        ({"stream": "lidar/scan", "frame": "mana/lidar", "on_clock_fault": "ignore"}, "on_clock_fault"),
    ],
)
def test_a_sensor_with_a_wrong_argument_is_refused_before_it_connects(
    arguments: dict[str, object], message: str
) -> None:
    stream = arguments.pop("stream")
    with pytest.raises(InputError, match=message):
        Sensor(stream, LidarScan, connect="tcp/127.0.0.1:1", **arguments)  # type: ignore[arg-type]


def test_a_second_driver_of_a_stream_is_refused_and_a_restarted_one_is_not(
    router: Bus, endpoint: str
) -> None:
    with (
        Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint),
        pytest.raises(ConflictError, match="another process publishes imu/sample"),
    ):
        Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint)
    Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint).close()


def test_stamps_that_run_backwards_or_ahead_are_refused_and_counted(
    consumer: Bus, endpoint: str, eventually: Eventually, caplog: pytest.LogCaptureFixture
) -> None:
    messages = subscribed(consumer, "imu", "sample")
    now_ns = wall_ns()
    with Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint) as imu:
        assert imu.publish(reading(), now_ns)
        assert not imu.publish(reading(), now_ns - 500 * MS)
        assert not imu.publish(reading(), now_ns + 60_000 * MS)
        assert imu.publish(reading(), now_ns + MS)
        assert imu.status.clock_faults == 2
        assert imu.status.last_fault is not None
        assert imu.status.last_fault.code == "stamp_ahead"
    assert "mana/imu/sample: the stamp is 0.500 s before the previous one" in caplog.text
    eventually(lambda: len(messages) == 2)
    assert [imu_of(message).seq for message in messages] == [0, 1]


def test_a_reported_stamp_is_sent_degraded_with_the_reason(
    consumer: Bus, endpoint: str, eventually: Eventually
) -> None:
    messages = subscribed(consumer, "imu", "sample")
    with Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint, on_clock_fault="report") as imu:
        assert imu.publish(reading(), wall_ns() + 1000 * MS)
    eventually(lambda: messages)
    quality = imu_of(messages[0]).quality
    assert quality.status is Status.DEGRADED
    assert quality.reasons[0].startswith(("stamp_ahead:1.0", "stamp_ahead:0.9"))


def test_the_mission_clock_is_the_reference_of_the_stamps(consumer: Bus, endpoint: str) -> None:
    stop, mission_ns = threading.Event(), 1_000_000_000 * 1_000_000_000

    def tick() -> None:
        while not stop.wait(0.05):
            consumer.publish_map(keys.CLOCK, {"now_ns": mission_ns, "rate": 0.0})

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        with Sensor("imu/sample", IMUSensors, frame="mana/imu", connect=endpoint) as imu:
            assert imu.now_ns() == mission_ns
            assert imu.publish(reading(), mission_ns)
            assert not imu.publish(reading(), wall_ns())
    finally:
        stop.set()
        thread.join()


MODES_PROFILE = """
name: drivers
robots:
  - id: mana
    frames: [{parent: site, child: mana/odom}, {parent: mana/base, child: mana/lidar}]
    sensors:
      lidar:
        kind: lidar
        frame: mana/lidar
        streams: {scan: LidarScan}
        modes: {"off": {on: false}, slow: {rate_hz: 1.0}, nominal: {rate_hz: 10.0}}
        initial_mode: "off"
        switch_s: 0.05
"""


def test_modes_of_the_instrument_control_unit_reach_the_device(
    consumer: Bus, endpoint: str, spawn: Spawn, tmp_path: Path, eventually: Eventually
) -> None:
    profile = tmp_path / "profile.yaml"
    profile.write_text(MODES_PROFILE)
    modes: list[ActiveMode] = []
    recovered = threading.Event()

    def set_mode(mode: ActiveMode) -> None:
        modes.append(mode)
        if mode.name == "slow":
            if not mode.on:  # lost: the error comes after the recovery and must not be reported
                recovered.wait(10.0)
            raise RuntimeError("the motor is blocked")

    def state() -> dict[str, object]:
        body = consumer.call(keys.icu_rpc("mana", "modes")).body()
        sensors: dict[str, dict[str, object]] = body["sensors"]
        return sensors["lidar"]

    def publish(lidar: Sensor) -> bool:
        now_ns = lidar.now_ns()
        return lidar.publish(
            LidarScan.from_arrays(np.ones((1, 3)), [0], frame="mana/lidar", t0_ns=now_ns, t1_ns=now_ns)
        )

    with Sensor("lidar/scan", LidarScan, frame="mana/lidar", connect=endpoint, on_mode=set_mode) as lidar:
        assert publish(lidar)  # without a unit the sensor is on
        spawn("services.icu", "--profile", str(profile))
        eventually(lambda: modes and not modes[-1].on, timeout_s=30)
        assert not publish(lidar)
        assert lidar.status.withheld == 1
        consumer.call(keys.icu_rpc("mana", "set_mode"), {"sensor": "lidar", "mode": "nominal"})
        eventually(lambda: modes[-1] == ActiveMode("nominal", True, 10.0))
        assert publish(lidar)
        with suppress(UnavailableError):  # the reason, if the device refuses before the unit answers
            consumer.call(keys.icu_rpc("mana", "set_mode"), {"sensor": "lidar", "mode": "slow"})
        eventually(lambda: state()["reason"] == "mode slow: RuntimeError the motor is blocked")
        eventually(lambda: not lidar.mode.on)
        lidar.report_recovered()
        recovered.set()
        eventually(lambda: modes[-1].name != "slow")
        assert state()["reason"] == ""


TYPES = {
    "lidar": ("lidar", "scan", "LidarScan"),
    "stereo": ("navcam", "pair", "FramePair"),
    "imu": ("imu", "sample", "IMUSensors"),
    "wheels": ("wheels", "odometry", "TransformWithCovariance"),
    "joints": ("mast", "joints", "Joints"),
    "gnss": ("gnss", "fix", "TransformWithCovariance"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", DRIVERS)
def test_each_template_runs_and_publishes_what_the_hosts_accept(
    kind: str, consumer: Bus, endpoint: str, tmp_path: Path
) -> None:
    sensor, stream, type_name = TYPES[kind]
    messages = subscribed(consumer, sensor, stream)
    path = tmp_path / "driver.py"
    assert main(["new", "driver", kind, "--robot", "mana", "--out", str(path)]) == 0
    assert len(path.read_text().splitlines()) <= 60
    process = subprocess.Popen(
        [sys.executable, str(path)],
        env={"CDFF_CONNECT": endpoint, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "PATH": ""},
    )
    try:
        wait_until(lambda: len(messages) >= 3, timeout_s=30, what="three samples")
    finally:
        process.terminate()
        process.wait(10)
    samples = [decode_sample(message, "port", type_name) for message in messages]
    assert [s.seq for s in samples] == list(range(len(samples)))
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(samples))
    assert all(s.quality.status is Status.OK for s in samples)
    assert abs(wall_ns() - samples[-1].stamp_ns) < 10_000 * MS


def test_the_command_names_robot_and_sensor_and_keeps_existing_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "imu.py"
    assert main(["new", "driver", "imu", "--robot", "minnie", "--sensor", "xsens", "--out", str(out)]) == 0
    text = out.read_text()
    assert 'ROBOT = "minnie"\nSENSOR = "xsens"\n' in text
    assert "SPDX" not in text
    assert main(["new", "driver", "imu", "--out", str(out)]) == EXIT_ERROR
    assert "exists: name another file" in capsys.readouterr().err
    assert main(["new", "driver", "imu", "--robot", "Mana", "--out", str(tmp_path / "b.py")]) == EXIT_ERROR
    assert "robot 'Mana': expected a name of a profile" in capsys.readouterr().err


def test_a_driver_takes_frame_and_stream_of_its_sensor_from_the_profile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = str(ROOT / "deploy" / "profiles" / "rover_traverse.yaml")

    def new(kind: str, *arguments: str) -> int:
        out = tmp_path / f"{kind}.py"
        return main(["new", "driver", kind, "--profile", profile, "--out", str(out), *arguments])

    assert new("stereo", "--robot", "minnie") == 0
    text = (tmp_path / "stereo.py").read_text()
    assert 'ROBOT = "minnie"\nSENSOR = "navcam"\nFRAME = "minnie/navcam_left"  #' in text
    assert 'Sensor(f"{SENSOR}/pair"' in text
    assert new("wheels", "--robot", "mana", "--sensor", "wheels") == 0
    assert 'PARENT, CHILD = f"{ROBOT}/{SENSOR}", "mana/base"  #' in (tmp_path / "wheels.py").read_text()
    assert new("imu") == EXIT_ERROR
    assert "--robot: expected one of mana, minnie" in capsys.readouterr().err
    assert new("imu", "--robot", "mana", "--sensor", "lidar") == EXIT_ERROR
    assert "--sensor lidar: expected one sensor of mana with a stream of type IMUSensors" in (
        capsys.readouterr().err
    )


def test_a_foreign_attachment_is_refused_by_the_hosts() -> None:
    message = Message("key", b"", "application/vnd.cdff+uper;IMUSensors/1", pack({"v": 1}))
    with pytest.raises((CodecError, InputError)):
        imu_of(message)
