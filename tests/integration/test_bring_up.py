# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the page "bring up your own robot" work as printed, on the bag of the page."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.geometry import se3
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT, wait_until

PAGE = ROOT / "docs" / "tutorials" / "bring-up-your-own-robot.md"


def commands(language: str) -> list[str]:
    """Return the lines of the page's blocks in a language."""
    page = PAGE.read_text(encoding="utf-8")
    blocks = re.findall(rf"^```{language}\n(.*?)^```", page, re.M | re.S)
    return [line for block in blocks for line in block.splitlines()]


def argv(line: str) -> list[str]:
    """Return the words of a command with the interpreter of the tests."""
    program, *arguments = shlex.split(line)
    return [sys.executable, *(["-m", "cdff_common.cli"] if program == "cdff" else []), *arguments]


@contextmanager
def running(line: str, folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """Run a command of the page in the background, and end it."""
    with (folder / "background.log").open("ab") as log:
        process = subprocess.Popen(argv(line), cwd=folder, env=environment, stdout=log, stderr=log)
    try:
        yield
        assert process.poll() is None, f"{line} has ended: {(folder / 'background.log').read_text()}"
    finally:
        process.terminate()
        process.wait(30)


@pytest.mark.slow
def test_every_command_of_the_page_succeeds_and_every_sample_is_used(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    page = PAGE.read_text(encoding="utf-8")
    lines = commands("bash")
    assert len(lines) == 5
    printed = ""
    for line in lines:
        expanded = line.replace("$CDFF_DATA", str(real_data("rosbags").parent))
        command = argv(expanded)
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        result = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        # The check of the log finds the mount that the next command calibrates.
        is_check = command[3] == "check"
        assert result.returncode == (1 if is_check else 0), result.stderr
        assert (
            not is_check or "imu_data disagrees with the other sensors by a rotation of 90" in result.stdout
        )
        printed += result.stdout
    for angle_line in re.findall(r"^  (?:roll|pitch|yaw) .*°$", page, re.MULTILINE):
        assert angle_line in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["failed"] == summary["dropped"] == 0
    assert summary["sensor_findings"] == []  # the mounts of the calibration are right
    assert "refused" not in result.stderr
    assert len((tmp_path / "out" / "pose.tum").read_text().splitlines()) > 1400
    assert (tmp_path / "frames.svg").read_text().startswith("<svg")


@pytest.mark.integration
@pytest.mark.slow
def test_the_live_part_of_the_page_works_with_the_templates_of_the_drivers(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    connect, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    environment = os.environ | {
        "CDFF_CONNECT": connect,
        "CDFF_DATA_DIR": str(tmp_path / "data"),
        "PYTHONPATH": str(ROOT),
        "PYTHONUNBUFFERED": "1",
    }

    def run(line: str, codes: tuple[int, ...] = (0,)) -> str:
        result = subprocess.run(
            argv(line), cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert result.returncode in codes, f"{line}: {result.stdout} {result.stderr}"
        return result.stdout

    def streams() -> list[dict[str, object]]:
        listed_streams: list[dict[str, object]] = json.loads(run("cdff top --once --json", (0, 1)))["streams"]
        return [stream for stream in listed_streams if stream.get("count")]

    bag = real_data("rosbags/husky_first_150s.bag")
    run(f"cdff new profile {bag} --out husky.yaml")
    imu, wheels, up, imu_driver, wheels_driver, top, request, record, info = commands("sh")
    run(imu)
    run(wheels)
    with ExitStack() as background:
        background.enter_context(running(f"{up} --connect {connect} --http {http}", tmp_path, environment))
        log = tmp_path / "background.log"
        wait_until(lambda: "ready: 5 services" in log.read_text(), 90, "a ready system")
        for driver in (imu_driver, wheels_driver):
            background.enter_context(running(driver, tmp_path, environment))
        wait_until(lambda: len(streams()) == 2, 30, "two streams")
        time.sleep(3.0)  # rates are measured over some seconds
        assert [stream["frame_known"] for stream in streams()] == [True, True]
        assert "imu_data.imu" in run(top, (0, 1))  # 1 if a rate is low: the machine may be loaded
        assert "husky_first_150s/base in site at" in run(request)
        run(record.replace("120", "5"))
        command = f"cdff calibrate extrinsics {bag} --profile husky.yaml --dpm"
        calibrated = run(f"{command} --valid-from {time.time():.0f}000000000")
        assert "husky_first_150s/imu_link: revision in the DPM, valid from" in calibrated
        with Bus.open(connect, name="test") as bus:
            key, parameters = keys.dpm_rpc(keys.GROUND, "frames"), {"frame": "husky_first_150s/imu_link"}
            first, second = bus.call(key, parameters).body()["revisions"]
    turn = se3.rotation_angle(np.array(second["T"])[:3, :3] @ np.array(first["T"])[:3, :3].T)
    assert np.rad2deg(turn) == pytest.approx(120.0, abs=5.0)  # y up and x to the left
    assert np.sqrt(np.diag(second["covariance"]))[3:].max() < np.deg2rad(3.0)
    recorded = json.loads(run(f"{info} --json"))["streams"]
    assert recorded["/husky_first_150s/imu_data.imu"]["count"] > 50
    assert recorded["/husky_first_150s/position_manager.pose"]["count"] > 10
