# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A converted recording gives the same trajectory as the original one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cdff_common.cli import EXIT_REFUSED, main
from cdff_common.formats.ply import read_ply
from cdff_dev.logs import open_log
from cdff_dev.logs.conversion import TimeSpan, convert_log
from evaluation.log_conversion import RECORDINGS, Recording, compare_formats, table

#: Length of the recordings of the tests, seconds: 3 sweeps, 6 pairs.
DURATION_S = 0.55


@pytest.mark.slow
@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda recording: recording.folder)
def test_each_format_of_a_recording_gives_the_trajectory_of_the_compound_on_its_own(
    recording: Recording, real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    part = tmp_path / "part.msg"
    with open_log(real_data(recording.folder)) as log:
        convert_log(log, part, span=TimeSpan(0.0, DURATION_S))
    rows = compare_formats(recording, part, tmp_path)
    assert len(rows) == 1 + len(recording.formats)
    for row in rows.values():
        assert row["poses"] == {"slam": 3, "vo": 6}[recording.command]
        assert row["statuses"] == {"OK": row["poses"]}
        assert row["largest_difference_m"] == row["largest_difference_deg"] == 0.0
        assert row["path_length_m"] > 0.1
    assert len({(row["rmse_m"], row["rmse_deg"]) for row in rows.values()}) == 1
    maps = [read_ply(path).points_m for path in tmp_path.glob(f"{recording.folder}_*/map.ply")]
    assert len(maps) == len(rows)
    assert len({len(points_m) for points_m in maps}) == 1
    text = table(dict.fromkeys((r.folder for r in RECORDINGS), rows))
    assert text.count("| none |") == 2 * len(rows)


@pytest.mark.slow
def test_visual_odometry_refuses_pairs_that_are_too_far_apart(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["vo", str(real_data("euroc_v101_pairs/query")), "--out", str(out)]) == EXIT_REFUSED
    assert "s apart: visual_odometry_sparse needs pairs that overlap" in capsys.readouterr().err
    assert not out.exists()
