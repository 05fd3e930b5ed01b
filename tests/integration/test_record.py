# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff record`` writes every message on the bus to a log that can be read and played again."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.codecs import encode_payload
from cdff_common.types import IMUSensors, Pointcloud, Time
from cdff_dev.logs import open_log
from cdff_dev.logs.source import recorded_header
from tests.integration.conftest import ROOT

pytestmark = pytest.mark.integration

COUNT = 300
IMU, CLOUD = "/mana/imu.sample", "/mana/dem.cloud"


@contextmanager
def recording(endpoint: str, out: Path, *options: str) -> Iterator[Callable[[], str]]:
    """Record until the returned function is called, which returns the summary."""
    command = [sys.executable, "-m", "cdff_common.cli", "record", "--out", str(out), "--connect", endpoint]
    process = subprocess.Popen(
        [*command, *options], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("recording")

    def end() -> str:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors
        return output

    try:
        yield end
    finally:
        process.kill()
        process.wait()


def publish(bus: Bus, count: int = COUNT) -> dict[str, list[object]]:
    """Publish inertial samples and clouds; return the values by stream."""
    rng = np.random.default_rng(0)
    sent: dict[str, list[object]] = {IMU: [], CLOUD: []}
    for seq in range(count):
        t_ns = 1_000_000_000 + seq * 10_000_000
        values = {IMU: IMUSensors(Time.from_ns(t_ns), rng.normal(size=3), rng.normal(size=3), np.zeros(3))}
        if seq % 10 == 0:
            points = rng.normal(size=(5000, 3))
            values[CLOUD] = Pointcloud.from_points(points, frame="site", stamp_ns=t_ns)
        for stream, value in values.items():
            robot, sensor, port = re.split("[/.]", stream[1:])
            key = keys.sensor(robot, sensor, port) if stream == IMU else keys.product(robot, sensor, port)
            payload, encoding = encode_payload(value)
            header = recorded_header(stream, seq, t_ns, frame="site")
            bus.publish(key, payload, encoding=encoding, attachment=header.to_attachment())
            sent[stream].append(value)
    return sent


@pytest.mark.parametrize("name", ["run.msg", "run.mcap"])
def test_every_message_is_recorded_from_the_first_to_the_last(
    router: subprocess.Popen[bytes], endpoint: str, tmp_path: Path, name: str
) -> None:
    with (
        Bus.open(endpoint, name="publisher", wait_s=10) as bus,
        recording(endpoint, tmp_path / name) as end,
    ):
        sent = publish(bus)
        summary = end()
    assert f"{COUNT + COUNT // 10} samples" in summary
    assert "0 dropped, 0 refused" in summary
    with open_log(tmp_path / name) as log:
        assert {stream: info.count for stream, info in log.streams.items()} == {
            stream: len(values) for stream, values in sent.items()
        }
        for stream, values in sent.items():
            assert [sample.value for sample in log.samples([stream])] == values


def test_a_recording_is_split_by_size_and_none_is_replaced(
    router: subprocess.Popen[bytes], endpoint: str, tmp_path: Path
) -> None:
    with (
        Bus.open(endpoint, name="publisher", wait_s=10) as bus,
        recording(endpoint, tmp_path / "run.mcap", "--split-mb", "1") as end,
    ):
        sent = publish(bus)
        end()
    files = sorted(tmp_path.glob("run_*.mcap"))
    assert len(files) > 2
    read = 0
    for file in files:
        with open_log(file) as log:
            read += log.streams[IMU].count if IMU in log.streams else 0
    assert read == len(sent[IMU])
    command = [sys.executable, "-m", "cdff_common.cli", "record", "--out", str(files[0])]
    again = subprocess.run(
        [*command, "--connect", endpoint], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert again.returncode != 0
    assert "exists: name another file" in again.stderr


def test_messages_that_are_no_samples_are_counted(
    router: subprocess.Popen[bytes], endpoint: str, tmp_path: Path
) -> None:
    with (
        Bus.open(endpoint, name="publisher", wait_s=10) as bus,
        recording(endpoint, tmp_path / "run.msg", "cdff/@v1/**") as end,
    ):
        publish(bus, 10)
        bus.publish(keys.sensor("mana", "imu", "sample"), b"junk", encoding="text/plain")
        bus.publish_map(keys.event("mana", "alarm"), {})
        summary = end()
    assert "11 samples" in summary
    assert "0 dropped, 2 refused" in summary
