# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A recording of the demonstration, played again, gives answers to the same requests."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from cdff_common.bus import Bus
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.demonstration import script_of
from cdff_dev.missions.requests import Outcome, run_requests, wait_for_clock
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.record.files import RecordingFiles
from cdff_dev.record.recorder import Recorder

pytestmark = [pytest.mark.e2e, pytest.mark.soak, pytest.mark.timeout(900)]

NAME = "rover_traverse"


def demonstrate(log: Path, before: Callable[[Bus], Callable[[], object]]) -> list[Outcome]:
    """Play a log on a new system and send it the requests; ``before`` returns a function for the end."""
    script, path = script_of(NAME), deploy_folder() / "profiles" / f"{NAME}.yaml"
    connect, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        stage = stack.enter_context(Stage(load_profile(path), path, connect, http))
        bus = stack.enter_context(Bus.open(connect, name="test", wait_s=20))
        stage.wait_ready(bus)
        stack.callback(before(bus))
        stage.play(str(log), script.rate)
        clock, start_ns = wait_for_clock(bus, stage.check_running)
        return run_requests(script.requests, clock, start_ns, connect, http, lambda _outcome: None)


def test_a_recording_of_the_demonstration_answers_the_same_requests(traverse: Path, tmp_path: Path) -> None:
    recording = tmp_path / "demo.msg"
    files = RecordingFiles(recording)

    def record(bus: Bus) -> Callable[[], object]:
        recorder = Recorder(bus, ["cdff/@v1/*/sensor/**"], files)
        return recorder.close

    def nothing(_: Bus) -> Callable[[], object]:
        return lambda: None

    for log, before in ((traverse, record), (recording, nothing)):
        outcomes = demonstrate(log, before)
        assert len(outcomes) == 8
        assert [outcome.faults for outcome in outcomes] == [()] * 8, log
