# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_dev.replay import commands
from tests.support.distant_scene import CAMERA, PERIOD_NS, T0_NS, Body, DistantScene
from tests.unit.cdff_dev.replay.test_tracks import HEADER


def test_a_folder_of_images_gives_a_table_of_the_tracks_on_the_ground(tmp_path: Path) -> None:
    scene, count = DistantScene([Body((50.0, 80.0), (2.3, 0.4))]), 25
    source, out = tmp_path / "images", tmp_path / "out"
    source.mkdir()
    for k in range(count):
        cv2.imwrite(str(source / f"frame_{k:03d}.png"), scene.image(k))
    times = [(T0_NS + k * PERIOD_NS) * 1e-9 for k in range(count)]
    (source / "times.txt").write_text("".join(f"{t:.6f}\n" for t in times), encoding="utf-8")
    (source / "camera.json").write_text(
        json.dumps({"cameraMatrix": CAMERA.matrix.tolist(), "distCoeffs": [0.0] * 5}), encoding="utf-8"
    )
    parser = argparse.ArgumentParser()
    commands.register(parser.add_subparsers())
    arguments = parser.parse_args(["replay", str(source), "--dfpc", "far_range_tracking", "--out", str(out)])
    assert commands.run(arguments) == 0
    text = (out / "tracks.csv").read_text(encoding="utf-8")
    assert text.splitlines()[0] == HEADER
    rows = list(csv.DictReader(text.splitlines()))
    assert {row["id"] for row in rows} == {"1"}
    assert len(rows) >= 12
    for row in rows[10:]:
        k = round((int(row["stamp_ns"]) - T0_NS) / PERIOD_NS)
        place = scene.bodies[0].place(k)
        assert [float(row["u_px"]), float(row["v_px"])] == pytest.approx(place.tolist(), abs=0.8)
        assert float(row["azimuth_rad"]) == pytest.approx(
            np.arctan((place[0] - CAMERA.cx) / CAMERA.fx), abs=3e-3
        )
        assert row["range_m"] == row["sigma_range_m"] == ""
