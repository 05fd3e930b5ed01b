# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay`` writes the documented outputs, with equal bytes in two runs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.formats.tum import read_tum
from cdff_dev.logs import open_log

pytestmark = pytest.mark.golden

SUMMARY_KEYS = {
    "samples",
    "outputs",
    "dropped",
    "degraded",
    "failed",
    "wall_s",
    "cpu_s",
    "peak_rss_mb",
    "config_hash",
}


def replay(log: Path, out: Path, *options: str) -> dict[str, object]:
    assert main(["replay", str(log), "--dfpc", "visual_odometry_sparse", "--out", str(out), *options]) == 0
    summary: dict[str, object] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return summary


@pytest.fixture(scope="module")
def replayed(real_data: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the outputs of a replay of a recorded drive."""
    out = tmp_path_factory.mktemp("replay")
    summary = replay(real_data("kitti_stereo/KITTI_sequence_1"), out)
    assert set(summary) >= SUMMARY_KEYS
    assert summary["samples"] == 51
    return out


@pytest.mark.slow
@pytest.mark.req("CDFF-DEV-022")
def test_a_replay_of_a_recorded_drive_is_repeatable(
    real_data: Callable[[str], Path], replayed: Path, tmp_path: Path
) -> None:
    second = replay(real_data("kitti_stereo/KITTI_sequence_1"), tmp_path)
    for name in ("outputs.msg", "pose.tum"):
        assert (replayed / name).read_bytes() == (tmp_path / name).read_bytes()
    first = json.loads((replayed / "summary.json").read_text(encoding="utf-8"))
    assert first["config_hash"] == second["config_hash"]


def test_the_trajectory_starts_at_identity_and_the_output_log_can_be_read(replayed: Path) -> None:
    stamps_ns, T = read_tum(replayed / "pose.tum")
    assert np.array_equal(T[0], np.eye(4))
    assert np.allclose(np.diff(stamps_ns), 100_000_000)
    with closing(open_log(replayed / "outputs.msg")) as log:
        outputs = list(log.samples())
    assert len(outputs) == len(stamps_ns)
    assert outputs[-1].stream == "/kitti/visual_odometry_sparse.pose"
    assert outputs[-1].header is not None
    assert np.allclose(outputs[-1].value.transform.matrix, T[-1], atol=1e-8)


@pytest.mark.slow
def test_another_seed_changes_the_configuration_hash(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    drive, log = real_data("kitti_stereo/KITTI_sequence_1"), tmp_path / "log"
    shutil.copytree(drive, log, ignore=shutil.ignore_patterns("*[1-9].png"))
    hashes = {replay(log, tmp_path / seed, "--seed", seed)["config_hash"] for seed in ("1", "2")}
    assert len(hashes) == 2


def test_an_unconnected_port_is_refused_with_the_streams_of_the_log(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = real_data("kitti_stereo/KITTI_sequence_1")
    assert main(["replay", str(log), "--dfpc", "navigation_mapping"]) == 1
    message = capsys.readouterr().err
    assert "dem (ElevationMap)" in message
    assert "/kitti/navcam.pair (FramePair)" in message
