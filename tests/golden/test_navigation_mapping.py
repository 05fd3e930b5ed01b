# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Navigation mapping replays patches to the same bytes, and to the classes it gave before."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_dev.evaluate._orbital import Drive, Ground
from cdff_dev.logs import LogWriter, open_log

pytestmark = pytest.mark.golden

#: Cells unknown, safe, caution and hazard of the last map; library versions may move a few.
REFERENCE_CELLS = (16635, 2193, 3448, 224)


@pytest.mark.req("CDFF-CORE-073")
def test_patches_repeat_byte_for_byte_and_give_the_classes_they_gave(tmp_path: Path) -> None:
    ground = Ground.make(2, 12.0)
    drive = Drive.make(ground, 2, 20.0)
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
    assert len(maps) == len(drive.true)
    cells = np.bincount(maps[-1].layer("class").ravel(), minlength=4)
    np.testing.assert_allclose(cells, REFERENCE_CELLS, atol=20)
