# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_common.formats.visual_map import read_visual_map
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import DistanceImage, Frame, TransformWithCovariance
from cdff_dev.map_building.build import MapOptions, build_map
from tests.support import textured_walls as walls

#: The body of the recording: displaced from the left camera.
T_BODY_LEFT = se3.transform(np.eye(3), [0.1, 0.0, 0.05])
STEPS_M = (-0.3, 0.0, 0.3)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with ``map`` and ``query`` pairs, ``calibration.yaml`` and ``truth_map.csv``."""
    root = tmp_path_factory.mktemp("pairs")
    lines = ["timestamp_ns,tx_m,ty_m,tz_m,qx,qy,qz,qw"]
    for folder, steps in (("map", STEPS_M), ("query", (0.1,))):
        (root / folder).mkdir()
        for i, x in enumerate(steps):
            stamp_ns = 1_403_715_273_000_000_000 + 1_000_000_000 * i
            pair = walls.pair(se3.transform(np.eye(3), [x, 0.0, 0.0]))
            for camera, frame in enumerate((pair.left, pair.right)):
                cv2.imwrite(str(root / folder / f"{stamp_ns}_{camera}.png"), np.array(frame.image))
            t = (se3.transform(np.eye(3), [x, 0.0, 0.0]) @ se3.inverse(T_BODY_LEFT))[:3, 3]
            if folder == "map":
                lines.append(f"{stamp_ns},{t[0]},{t[1]},{t[2]},0,0,0,1")
    (root / "truth_map.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    document = ["%YAML:1.0"]
    for camera in (0, 1):
        T = T_BODY_LEFT @ se3.transform(np.eye(3), [camera * walls.BASELINE_M, 0.0, 0.0])
        document += [
            f"cam{camera}:",
            f"  T_imu_cam: {T.tolist()}",
            "  camera_model: pinhole",
            "  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]",
            "  distortion_model: radtan",
            f"  intrinsics: [{walls.K[0, 0]}, {walls.K[1, 1]}, {walls.K[0, 2]}, {walls.K[1, 2]}]",
            f"  resolution: [{walls.SIZE[0]}, {walls.SIZE[1]}]",
        ]
    (root / "calibration.yaml").write_text("\n".join(document) + "\n", encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def map_file(recording: Path) -> Path:
    path = recording / "walls.npz"
    assert main(["map", "build", str(recording / "map"), "--out", str(path), "--sigma-m", "0.01"]) == 0
    return path


def test_the_map_has_the_poses_of_the_cameras_and_their_accuracy(map_file: Path) -> None:
    value = read_visual_map(map_file)
    assert value.frame == "euroc/world"
    poses = value.graph.vertices.matrices
    np.testing.assert_allclose(poses[:, :3, 3], [[x, 0.0, 0.0] for x in STEPS_M], atol=1e-9)
    assert value.graph.edges.information_matrices[0][0, 0] == pytest.approx(0.01**-2)
    assert (np.abs(value.points_m[:, 2, None] - [4.0, 2.5]).min(axis=1) < 0.2).mean() > 0.9


def test_run_locates_an_image_file_with_its_calibration_file(
    recording: Path, map_file: Path, tmp_path: Path
) -> None:
    image = f"image={recording / 'query' / '1403715273000000000_0.png'},{recording / 'calibration.yaml'}"
    command = ["run", "visual_localisation", f"map={map_file}", image, "--out", str(tmp_path)]
    assert main(command) == 0
    pose = json.loads((tmp_path / "outputs.json").read_text())["outputs"]["pose"]["value"]
    np.testing.assert_allclose(np.array(pose["T"])[:3, 3], [0.1, 0.0, 0.0], atol=0.02)
    assert (pose["parent"], pose["covariance_kind"]) == ("euroc/world", "formal")


def test_replay_takes_the_file_of_a_map_and_writes_absolute_poses(
    recording: Path, map_file: Path, tmp_path: Path
) -> None:
    command = ["replay", str(recording / "query"), "--dfpc", "visual_localisation", "--map", str(map_file)]
    assert main([*command, "--out", str(tmp_path)]) == 0
    row = np.loadtxt(tmp_path / "pose.tum")
    np.testing.assert_allclose(row[1:4], [0.1, 0.0, 0.0], atol=0.02)


@dataclass
class Info:
    type_name: str
    count: int = 1


@dataclass
class Entry:
    stamp_ns: int
    value: Any


class Recording:
    """Log of colour and depth images, and poses of the depth camera."""

    def __init__(self, *types: str) -> None:
        x = 0.05
        frame = Frame.from_image(
            walls.view(se3.transform(np.eye(3), [x, 0.0, 0.0])), stamp_ns=0, camera_matrix=walls.K
        )
        depth = DistanceImage(
            width=320,
            height=240,
            scale_x=1 / 240.0,
            scale_y=1 / 240.0,
            center_x=-160 / 240.0,
            center_y=-120 / 240.0,
            data=np.full(320 * 240, 4.0),
        )
        pose = TransformWithCovariance.from_transform(
            UncertainTransform.exact(np.eye(4)), parent="site", child="rover/depth", stamp_ns=0
        )
        values = {"Frame": frame, "DistanceImage": depth, "TransformWithCovariance": pose}
        self._values = {f"/rover/{t}": Entry(0, values[t]) for t in types}
        self.streams = {f"/rover/{t}": Info(t) for t in types}

    def samples(self, names: list[str]) -> list[Entry]:
        return [self._values[name] for name in names]


def test_the_pose_of_a_colour_camera_follows_from_that_of_the_depth_camera() -> None:
    log = Recording("Frame", "DistanceImage", "TransformWithCovariance")
    value = build_map(log, MapOptions(depth_offset_m=(-0.05, 0.0, 0.0)))  # type: ignore[arg-type]
    np.testing.assert_allclose(value.graph.vertices.matrices[0][:3, 3], [0.05, 0.0, 0.0], atol=1e-9)
    assert len(value.points_m) > 100


@pytest.mark.parametrize(
    ("types", "options", "message"),
    [
        (("Frame", "DistanceImage"), MapOptions(), "no poses"),
        (("Frame", "TransformWithCovariance"), MapOptions(), "expected stereo pairs"),
        (("Frame", "DistanceImage", "TransformWithCovariance"), MapOptions(sigma_m=0.0), "above 0"),
        (("Frame", "DistanceImage", "TransformWithCovariance"), MapOptions(first_s=1.0), "no image"),
    ],
)
def test_a_log_without_the_data_of_a_map_is_refused(
    types: tuple[str, ...], options: MapOptions, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        build_map(Recording(*types), options)  # type: ignore[arg-type]
