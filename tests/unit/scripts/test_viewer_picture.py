# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The viewer draws without a display."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_DONE, main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, Frame, TransformWithCovariance, VisualPointFeatureVector2D
from cdff_dev.logs import LogWriter
from cdff_dev.logs.source import recorded_header
from scripts.viewer_picture import software_vulkan, take_picture

#: Pictures are kept, so that they can be looked at.
BUILD = Path(__file__).resolve().parents[3] / "build"


def write_scene(path: Path) -> None:
    """Write a log with an elevation map in the frame of the robot, its pose, an image and features."""
    rng = np.random.default_rng(0)
    with LogWriter(path) as writer:
        x, y = np.meshgrid(np.linspace(-4.0, 4.0, 80), np.linspace(-4.0, 4.0, 80))
        heights_m = (0.6 * np.sin(x) * np.cos(y)).astype(np.float32)
        geometry = GridGeometry("site", 0.1, -4.0, 4.0, 80, 80)
        dem = ElevationMap.from_layers(geometry, {"mean": heights_m}, t0_ns=0, t1_ns=0)
        writer.write("/mana/dem.map", dem, 0)
        T = UncertainTransform(se3.transform(np.eye(3), [0.0, 0.0, 1.0]), np.eye(6) * 0.01)
        pose = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=0)
        writer.write("/mana/vo.pose", pose, 0)
        image = Frame.from_image(np.full((120, 160), 90, np.uint8), stamp_ns=0, sensor="mana/camera")
        writer.write("/mana/camera.image", image, 0)
        features = VisualPointFeatureVector2D.from_arrays(rng.uniform(5.0, 110.0, (60, 2)))
        header = recorded_header("/mana/camera.features", 0, 0, frame="mana/camera")
        writer.write("/mana/camera.features", features, 0, header)


@pytest.mark.slow
def test_the_viewer_draws_a_map_and_features_over_their_image_without_a_display(tmp_path: Path) -> None:
    pytest.importorskip(
        "rerun", reason="NO PICTURE OF THE VIEWER: the extra view is not installed; make peers"
    )
    from cdff_common.formats.image import read_image

    driver = software_vulkan(tmp_path)
    if driver is None:
        pytest.skip("NO PICTURE OF THE VIEWER: no software Vulkan; apt-get install mesa-vulkan-drivers")
    write_scene(tmp_path / "scene.msg")
    recording = tmp_path / "scene.rrd"
    assert main(["view", str(tmp_path / "scene.msg"), "--save", str(recording)]) == EXIT_DONE
    png = take_picture(recording, "800x480", driver)
    BUILD.mkdir(exist_ok=True)
    (BUILD / "viewer.png").write_bytes(png)
    pixels = read_image(png).astype(int)
    red, green, blue = np.moveaxis(pixels, -1, 0)
    # The user interface is grey. The highest cells are yellow, in the left half; features are green, in the right.
    is_yellow = (red > blue + 60) & (green > blue + 60)
    is_green = (green > red + 60) & (green > blue + 60)
    half = pixels.shape[1] // 2
    assert is_yellow[:, :half].sum() > 500
    assert is_green[:, half:].sum() > 200
    # Features are on the grey of the image.
    rows, cols = np.nonzero(is_green[:, half:])
    around = pixels[rows.min() : rows.max(), half + cols.min() : half + cols.max()]
    assert (np.abs(around - 90).max(axis=-1) < 8).mean() > 0.3
