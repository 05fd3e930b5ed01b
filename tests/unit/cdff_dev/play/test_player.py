# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The streams of a log that the player publishes."""

from __future__ import annotations

from pathlib import Path

import msgpack
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log
from cdff_dev.play.start import playable


def test_a_stream_without_samples_is_not_played_and_does_not_set_the_start(tmp_path: Path) -> None:
    log = {
        "/mana/imu.sample.meta": {"type": "Time", "timestamps": [5_000_000]},
        "/mana/imu.sample": [{"microseconds": 5_000_000}],
        "/mana/lidar.scan.meta": {"type": "Time", "timestamps": []},
        "/mana/lidar.scan": [],
    }
    (tmp_path / "a.msg").write_bytes(msgpack.packb(log))
    assert playable(open_log(tmp_path / "a.msg")) == ["/mana/imu.sample"]
    del log["/mana/imu.sample.meta"], log["/mana/imu.sample"]
    (tmp_path / "b.msg").write_bytes(msgpack.packb(log))
    with pytest.raises(InputError, match="no sensor streams to play"):
        playable(open_log(tmp_path / "b.msg"))
