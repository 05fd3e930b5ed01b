# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two replays of navigation mapping give equal bytes and the recorded classes."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_dev.logs import LogWriter, open_log
from evaluation.scenes.orbital import Ground, PatchRun

pytestmark = pytest.mark.golden

#: Number of unknown, safe, caution and hazard cells of the last map; library versions may change a few.
REFERENCE_CELLS = (16635, 2193, 3448, 224)


@pytest.mark.req("CDFF-CORE-073")
def test_patches_give_repeatable_maps_with_the_recorded_classes(tmp_path: Path) -> None:
    ground = Ground.make(2, 12.0)
    drive = PatchRun.make(ground, 2, 20.0)
    with LogWriter(tmp_path / "patches.msg") as log:
        for sample in drive.samples(ground, 2):
            if sample.port == "dem":
                log.write("/mana/digital_elevation_mapping.map", sample.value, sample.stamp_ns)
    wiring = ["--map", "dem=/mana/digital_elevation_mapping.map"]
    for out in ("a", "b"):
        command = ["replay", str(tmp_path / "patches.msg"), "--dfpc", "navigation_mapping", *wiring]
        assert main([*command, "--out", str(tmp_path / out)]) == 0
    assert (tmp_path / "a" / "outputs.msg").read_bytes() == (tmp_path / "b" / "outputs.msg").read_bytes()
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as log:
        maps = [sample.value for sample in log.samples()]
    assert len(maps) == len(drive.true_poses)
    cells = np.bincount(maps[-1].layer("class").ravel(), minlength=4)
    np.testing.assert_allclose(cells, REFERENCE_CELLS, atol=20)
