# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The viewer draws without a display."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, main
from cdff_common.types import Pointcloud
from cdff_dev.logs import LogWriter
from scripts.viewer_picture import software_vulkan, take_picture


@pytest.mark.slow
def test_the_viewer_draws_a_cloud_without_a_display(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra view is not installed: no picture of the viewer")
    from cdff_common.formats.image import read_image

    driver = software_vulkan(tmp_path)
    if driver is None:
        pytest.skip("NO PICTURE OF THE VIEWER: no software Vulkan; apt-get install mesa-vulkan-drivers")
    with LogWriter(tmp_path / "cloud.msg") as writer:
        grid = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
        points_m = np.column_stack([grid, grid[:, 0]])
        cloud = Pointcloud.from_points(points_m, frame="mana/lidar", stamp_ns=0)
        writer.write("/mana/lidar.cloud", cloud, 0)
    recording = tmp_path / "cloud.rrd"
    assert main(["view", str(tmp_path / "cloud.msg"), "--save", str(recording)]) == EXIT_DONE
    pixels = read_image(take_picture(recording, "400x260", driver)).astype(int)
    # The user interface is grey, with a little red; points are coloured by height, with green in the middle.
    is_green = (pixels[..., 1] > pixels[..., 0] + 40) & (pixels[..., 1] > 90)
    assert is_green.sum() > 50
