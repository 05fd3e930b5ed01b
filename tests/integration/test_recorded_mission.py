# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A recording of a played mission is replayed with the same answers to its requests as the original log."""

from __future__ import annotations

import json
import subprocess
import threading
from contextlib import closing
from pathlib import Path

import pytest

from cdff_common.bus import Bus
from cdff_dev.logs import open_log
from cdff_dev.logs.differences import EXACT
from cdff_dev.logs.log_comparison import log_differences
from cdff_dev.play.player import Player
from cdff_dev.record.files import RecordingFiles
from cdff_dev.record.recorder import Recorder

from .test_replay_of_a_mission import folder, replay

__all__ = ["folder"]
pytestmark = [pytest.mark.integration, pytest.mark.slow]


def test_a_recorded_mission_replays_to_the_same_answers(
    router: subprocess.Popen[bytes], endpoint: str, folder: Path, tmp_path: Path
) -> None:
    recording = tmp_path / "log_recorded.msg"
    with (
        Bus.open(endpoint, name="player", wait_s=20) as player_bus,
        Bus.open(endpoint, name="recorder", wait_s=20) as recorder_bus,
        closing(open_log(folder / "log.msg")) as log,
    ):
        recorder = Recorder(recorder_bus, ["cdff/@v1/*/sensor/**"], RecordingFiles(recording))
        progress = Player(player_bus, log, speed=10.0).run(threading.Event(), stay=False)
        recorder.close()
        assert (progress.published, progress.dropped) == (80, 0)
    with closing(open_log(folder / "log.msg")) as first, closing(open_log(recording)) as second:
        assert log_differences(first, second, EXACT) == []
    for name in ("profile.yaml", "requests.yaml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    original, recorded = replay(folder, "original"), replay(tmp_path, "recorded")
    answers = [json.loads((out / "answers.json").read_text()) for out in (original, recorded)]
    assert answers[0] == answers[1]
    assert len(answers[0]) == 4
    assert (original / "outputs.msg").read_bytes() == (recorded / "outputs.msg").read_bytes()
