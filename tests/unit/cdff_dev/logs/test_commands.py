# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff log``: info, cat, cut and merge."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import InputError
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.logs.commands import register


def _run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(["log", *words])
    return int(args.run(args))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "run.msg"
    with LogWriter(path) as writer:
        for i in range(5):
            state = types.RigidBodyState(types.Time(i), "a", "b", np.array([i, np.nan, np.inf]))
            writer.write("/mana/arm.state", state, i * 1_000_000_000)
            writer.write("/mana/imu.sample", types.IMUSensors(types.Time(i)), i * 1_000_000_000)
    return path


def test_info_lists_the_streams(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run("info", str(log)) == 0
    out = capsys.readouterr().out
    assert "/mana/arm.state" in out
    assert "1.00 Hz" in out
    assert _run("info", str(log), "--json") == 0
    streams = json.loads(capsys.readouterr().out)["streams"]
    expected = {"type": "IMUSensors", "count": 5, "t0_ns": "0", "t1_ns": "4000000000"}
    assert expected.items() <= streams["/mana/imu.sample"].items()


def test_cat_prints_samples_as_valid_json(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        _run("cat", str(log), "--stream", "/mana/arm.state", "--t0", "2000000000", "--limit", "2", "--json")
        == 0
    )
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["stamp_ns"] for line in lines] == ["2000000000", "3000000000"]
    assert lines[0]["value"]["pos"] == [2.0, None, "inf"]
    assert _run("cat", str(log), "--limit", "1") == 0
    assert capsys.readouterr().out.startswith(
        "1970-01-01T00:00:00.000000Z /mana/arm.state #0 RigidBodyState("
    )


def test_cut_and_merge_restore_the_log(log: Path, tmp_path: Path) -> None:
    parts = []
    for stream in ("/mana/imu.sample", "/mana/arm.state"):
        parts.append(tmp_path / f"{stream[-5:]}.msg")
        assert _run("cut", str(log), "--out", str(parts[-1]), "--stream", stream) == 0
    assert _run("merge", *map(str, parts), "--out", str(tmp_path / "merged.msg")) == 0
    assert (tmp_path / "merged.msg").read_bytes() == log.read_bytes()
    assert (
        _run(
            "cut",
            str(log),
            "--out",
            str(tmp_path / "span"),
            "--t0",
            "1970-01-01T00:00:02Z",
            "--t1",
            "3000000000",
        )
        == 0
    )
    with open_log(tmp_path / "span") as cut:
        assert cut.streams["/mana/imu.sample"].count == 2


def test_a_part_is_cut_by_seconds_after_the_first_sample(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "part.msg")
    assert _run("cut", str(log), "--out", out, "--start", "1", "--duration", "2") == 0
    assert capsys.readouterr().out.startswith(f"{out}: ")
    with open_log(log) as whole_log, open_log(out) as part:
        first_ns = min(info.t0_ns for info in whole_log.streams.values())
        stamps_ns = [sample.stamp_ns for sample in part.samples()]
        expected = [s.stamp_ns for s in whole_log.samples() if 10**9 <= s.stamp_ns - first_ns < 3 * 10**9]
    assert stamps_ns == expected
    with pytest.raises(InputError, match="'/no/such'"):
        _run("cut", str(log), "--out", out, "--start", "1", "--stream", "/no/such")


def test_logs_with_a_common_stream_are_not_merged(log: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is in .* and in"):
        _run("merge", str(log), str(log), "--out", str(tmp_path / "out.msg"))


def test_a_log_is_not_overwritten_while_it_is_read(log: Path) -> None:
    with pytest.raises(InputError, match="would replace the log"):
        _run("cut", str(log), "--out", str(log))
    with open_log(log) as unchanged:
        assert unchanged.streams["/mana/imu.sample"].count == 5


def test_the_output_may_have_a_name_with_which_the_input_starts(log: Path, tmp_path: Path) -> None:
    full = log.rename(tmp_path / "run_full.msg")
    assert _run("cut", str(full), "--out", str(tmp_path / "run.msg")) == 0
    assert (tmp_path / "run.msg").read_bytes() == full.read_bytes()
