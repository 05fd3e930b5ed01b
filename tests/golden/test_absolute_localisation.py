# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two replays of absolute localisation give equal bytes and the recorded end position."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_dev.logs import LogWriter, open_log
from evaluation.scenes.orbital import Ground, PatchRun

pytestmark = pytest.mark.golden

#: Offset of the heights of the orbital model.
DATUM_M = 40.0
#: End position of the recorded run, m; library versions may move it by centimetres.
REFERENCE_END_M = (15.415, -25.421, 39.734)


@pytest.mark.req("CDFF-CORE-088")
def test_a_traverse_is_repeatable_and_reproduces_the_recorded_result(tmp_path: Path) -> None:
    ground = Ground.make(2)
    drive = PatchRun.make(ground, 2, 40.0)
    with LogWriter(tmp_path / "traverse.msg") as log:
        log.write("/mana/orbital.map", ground.orbital(2, DATUM_M), 0)
        for sample in drive.samples(ground, 2):
            stream = (
                "/mana/position_manager.pose"
                if sample.port == "poses"
                else "/mana/digital_elevation_mapping.map"
            )
            log.write(stream, sample.value, sample.stamp_ns)
    wiring = {
        "orbital": "/mana/orbital.map",
        "dem": "/mana/digital_elevation_mapping.map",
        "poses": "/mana/position_manager.pose",
    }
    map_arguments = [
        argument for port, stream in wiring.items() for argument in ("--map", f"{port}={stream}")
    ]
    for out in ("a", "b"):
        command = [
            "replay",
            str(tmp_path / "traverse.msg"),
            "--dfpc",
            "absolute_localisation",
            *map_arguments,
        ]
        assert main([*command, "--out", str(tmp_path / out)]) == 0
    assert (tmp_path / "a" / "outputs.msg").read_bytes() == (tmp_path / "b" / "outputs.msg").read_bytes()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["outputs"], summary["failed"], summary["dropped"]) == (1, 0, 0)
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as log:
        pose = next(iter(log.samples())).value
    T_true = drive.true_poses[pose.stamp_ns // 10_000_000_000 - 1]
    assert np.hypot(*(pose.transform.matrix - T_true)[:2, 3]) < 1.0
    np.testing.assert_allclose(pose.transform.matrix[:3, 3], REFERENCE_END_M, atol=0.05)
