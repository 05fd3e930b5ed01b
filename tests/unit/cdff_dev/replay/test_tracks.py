# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_dev.logs.opened import opened
from tests.support.star_scene import CAMERA, T0_NS, StarScene
from tests.unit.cdff_core.dfpcs.far_range_object_tracking.test_compound import direction, images

HEADER = "stamp_ns,id,u_px,v_px,sigma_u_px,sigma_v_px,azimuth_rad,elevation_rad,range_m,sigma_range_m,status"


def folder_of(path: Path, count: int = 10) -> StarScene:
    """Write a folder of images with camera, times and attitudes."""
    scene = StarScene(seed=11)
    lines = ["stamp_s,qx,qy,qz,qw"]
    for k, (sample, _) in enumerate(images(scene, count)):
        cv2.imwrite(str(path / f"frame_{k:03d}.png"), sample.value.image)
        q = se3.quaternion_xyzw_from_matrix(scene.rotation(k))
        lines.append(",".join([f"{T0_NS * 1e-9 + k:.6f}", *[f"{x:.12f}" for x in q]]))
    (path / "attitude.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (path / "times.txt").write_text(
        "".join(f"{T0_NS * 1e-9 + k:.6f}\n" for k in range(count)), encoding="utf-8"
    )
    camera = {"cameraMatrix": CAMERA.matrix.tolist(), "distCoeffs": [0.0] * 5}
    (path / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    return scene


def test_a_folder_of_images_with_attitudes_gives_a_table_of_tracks(tmp_path: Path) -> None:
    from cdff_dev.replay import commands

    source, out = tmp_path / "images", tmp_path / "out"
    source.mkdir()
    scene = folder_of(source)
    arguments = commands_parser().parse_args(
        ["replay", str(source), "--dfpc", "far_range_object_tracking", "--out", str(out)]
    )
    assert commands.run(arguments) == 0
    text = (out / "tracks.csv").read_text(encoding="utf-8")
    assert text.splitlines()[0] == HEADER
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) >= 3
    assert {row["id"] for row in rows} == {"1"}
    for row in rows:
        k = round((int(row["stamp_ns"]) - T0_NS) * 1e-9)
        u = direction(scene, k)
        assert float(row["azimuth_rad"]) == pytest.approx(np.arctan2(u[1], u[0]) % (2 * np.pi), abs=4e-4)
        assert float(row["elevation_rad"]) == pytest.approx(np.arcsin(u[2]), abs=4e-4)
        assert row["range_m"] == row["sigma_range_m"] == ""
        assert [float(row["u_px"]), float(row["v_px"])] == pytest.approx(scene.pixel(u, k).tolist(), abs=0.8)
        assert row["status"] in ("confirmed", "coasting")


def test_a_wrong_table_of_attitudes_is_refused_with_its_name(tmp_path: Path) -> None:
    folder_of(tmp_path, 2)
    (tmp_path / "attitude.csv").write_text("stamp_s,qx,qy,qz\n1,0,0,0\n", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"attitude.csv: KeyError 'qw'; expected the columns stamp_s,qx,qy,qz,qw"
    ):
        opened(str(tmp_path)).__enter__()
    (tmp_path / "attitude.csv").write_text("stamp_s,qx,qy,qz,qw\n1,0,0,0,0.5\n", encoding="utf-8")
    with pytest.raises(InputError, match="unit quaternions"):
        opened(str(tmp_path)).__enter__()
    (tmp_path / "attitude.csv").write_text("stamp_s,qx,qy,qz,qw\n2,0,0,0,1\n1,0,0,0,1\n", encoding="utf-8")
    with pytest.raises(InputError, match="ascending times"):
        opened(str(tmp_path)).__enter__()


def commands_parser():
    """Return a parser with the command replay only."""
    import argparse

    from cdff_dev.replay import commands

    parser = argparse.ArgumentParser()
    commands.register(parser.add_subparsers())
    return parser
