# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folders of images are read as logs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log

CAMERA = "px: 60\npy: 60\nu0: 32\nv0: 24\n"


def write_images(folder: Path, *names: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((48, 64), i, np.uint8))


def test_images_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    write_images(tmp_path, "img1.png", "img2.png", "img10.png")
    samples = list(open_log(tmp_path).samples())
    assert [(s.stream, s.stamp_ns // 10**6, s.value.image[0, 0]) for s in samples] == [
        ("/robot/camera.frame", 100, 0),
        ("/robot/camera.frame", 200, 1),
        ("/robot/camera.frame", 1000, 2),
    ]


def test_sub_folders_are_cameras_with_the_calibration_named_like_their_images(tmp_path: Path) -> None:
    write_images(tmp_path / "left", "a1.png")
    write_images(tmp_path / "right", "b1.png")
    (tmp_path / "a.yaml").write_text(CAMERA, encoding="utf-8")
    (tmp_path / "b.yaml").write_text(CAMERA.replace("px: 60", "px: 70"), encoding="utf-8")
    focal = {s.stream: s.value.camera_matrix[0, 0] for s in open_log(tmp_path).samples()}
    assert focal == {"/robot/left.frame": 60.0, "/robot/right.frame": 70.0}


def test_a_calibration_of_another_camera_is_listed_and_if_named_refused(tmp_path: Path) -> None:
    write_images(tmp_path, "1.png")
    (tmp_path / "camera.yaml").write_text(CAMERA.replace("u0: 32", "u0: 320"), encoding="utf-8")
    log = open_log(tmp_path)
    assert "another camera" in log.unconverted["camera.yaml"].reason
    with pytest.raises(InputError, match="another camera"):
        open_log(tmp_path, tmp_path / "camera.yaml")


def test_poses_of_a_camera_and_files_that_are_not_used(tmp_path: Path) -> None:
    write_images(tmp_path / "images", "1.png", "2.png")
    (tmp_path / "truth.csv").write_text(
        "frame,qw,qx,qy,qz,tx_km,ty_km,tz_km\n2,1,0,0,0,0.001,0,0\n9,1,0,0,0,0,0,0\n", encoding="utf-8"
    )
    (tmp_path / "notes.doc").write_text("", encoding="utf-8")
    log = open_log(tmp_path)
    (pose,) = log.samples(["/robot/truth.pose"])
    assert pose.stamp_ns == 200_000_000
    assert pose.value.transform.matrix[0, 3] == pytest.approx(1.0)
    assert {name: item.count for name, item in log.unconverted.items()} == {"truth.csv": 1, "notes.doc": 1}


@pytest.mark.parametrize("text", ["frame,qw\n1,1\n", "image,T00\n", "frame,T00\nx,1\n"])
def test_a_table_of_poses_with_other_columns_is_refused(tmp_path: Path, text: str) -> None:
    write_images(tmp_path, "1.png")
    (tmp_path / "truth.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"truth\.csv"):
        open_log(tmp_path)


@pytest.mark.parametrize(
    ("name", "streams"),
    [
        ("speedplus_lightbox", {"camera.frame": 25, "truth.target": 25}),
        ("rosetta_67p", {"camera.frame": 60, "truth.target": 60}),
        ("star_images", {"camera.frame": 4, "truth.attitude": 4}),
        ("visp_castle", {"gray.frame": 20, "depth.frame": 20, "truth.target": 20}),
        ("visp_rbt_rgbd", {"color.frame": 24, "depth.depth": 24, "truth.board": 24}),
        ("m3t_pair", {"body.frame": 1, "color_camera_image.frame": 2, "depth_camera_image.depth": 2}),
    ],
)
def test_the_shared_sets_open_by_their_path(
    real_data: Callable[[str], Path], name: str, streams: dict[str, int]
) -> None:
    log = open_log(real_data(name))
    assert {stream.removeprefix("/robot/"): info.count for stream, info in log.streams.items()} == streams
    assert all(s.value is not None for s in log.samples(list(log.streams)[:1]))


@pytest.mark.parametrize(("half_px", "shift_px"), [(0.0, -0.5), (1.0, 0.0)])
def test_a_principal_point_in_the_middle_of_rendered_images_is_from_their_corner(
    tmp_path: Path, half_px: float, shift_px: float
) -> None:
    write_images(tmp_path, "1.png")
    (frame,) = open_log(tmp_path).samples()
    rows, cols = frame.value.image.shape[:2]
    u0, v0 = cols / 2 + half_px, rows / 2
    camera = f"<camera><px>50</px><py>50</py><u0>{u0}</u0><v0>{v0}</v0></camera>"
    text = f"<?xml version='1.0'?><conf>{camera}</conf>"
    (tmp_path / "scene.xml").write_text(text, encoding="utf-8")
    (frame,) = open_log(tmp_path).samples()
    np.testing.assert_allclose(frame.value.camera_matrix[:2, 2], [u0 + shift_px, v0 + shift_px])


def test_dates_in_names_are_times(real_data: Callable[[str], Path]) -> None:
    log = open_log(real_data("rosetta_67p"))
    assert log.streams["/robot/camera.frame"].t0_ns == 1_407_269_239_000_000_000


def test_a_folder_with_one_log_is_that_log_and_with_several_they_are_named(tmp_path: Path) -> None:
    write_images(tmp_path / "outer" / "inner" / "images", "1.png")
    assert list(open_log(tmp_path / "outer").streams) == ["/robot/camera.frame"]
    write_images(tmp_path / "outer" / "second" / "images", "1.png")
    with pytest.raises(InputError, match=r"several logs: name one of .*inner.*second"):
        open_log(tmp_path / "outer")


def test_a_table_named_after_two_frames_has_the_poses_of_one_in_the_other(tmp_path: Path) -> None:
    write_images(tmp_path, "1.png", "2.png")
    (tmp_path / "camera_from_board.csv").write_text(
        "frame,qw,qx,qy,qz,tx_m,ty_m,tz_m,weather\n1,1,0,0,0,0.5,0,2,dry\n2,1,0,0,0,0.6,0,2,dry\n",
        encoding="utf-8",
    )
    log = open_log(tmp_path)
    poses = list(log.samples(["/robot/truth.board"]))
    assert [(p.header.frame, p.header.child) for p in poses if p.header] == [
        ("robot/camera", "robot/board")
    ] * 2
    assert poses[1].value.transform.matrix[:3, 3] == pytest.approx([0.6, 0.0, 2.0])
    assert log.unconverted["camera_from_board.csv: weather"].count == 2


def test_attitudes_of_star_images_are_those_of_their_stars(real_data: Callable[[str], Path]) -> None:
    folder = real_data("star_images")
    solved = json.loads((folder / "truth.json").read_bytes())
    log = open_log(folder)
    for image, pose in zip(sorted(solved), log.samples(["/robot/truth.attitude"]), strict=True):
        stars_deg = np.radians(np.array(solved[image]["matched_stars"])[:, :2])
        ra, dec = stars_deg.T
        directions = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
        in_camera = directions @ pose.value.transform.matrix[:3, :3]
        focal_px = 512.0 / np.tan(np.radians(solved[image]["FOV"]) / 2)
        pixels = in_camera[:, :2] / in_camera[:, 2:] * focal_px + (512.0, 384.0)
        centroids = np.array(solved[image]["matched_centroids"])[:, ::-1]
        assert np.abs(pixels - centroids).max() < 2.0
    assert "matched_stars" in next(iter(log.unconverted))


def test_depths_without_a_unit_remain_images_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "depth").mkdir()
    cv2.imwrite(str(tmp_path / "depth" / "1.png"), np.full((48, 64), 900, np.uint16))
    (tmp_path / "camera.yaml").write_text(CAMERA, encoding="utf-8")
    log = open_log(tmp_path)
    (stream,) = log.streams
    assert log.streams[stream].type_name == "Frame"
    (item,) = log.unconverted.values()
    assert "no depthScale in camera.yaml" in item.reason
    (tmp_path / "camera.yaml").write_text(CAMERA + "depthScale: 0.001\n", encoding="utf-8")
    (sample,) = open_log(tmp_path).samples()
    assert sample.value.data[0] == pytest.approx(0.9)


def test_a_time_before_the_number_of_a_camera_is_the_stamp(tmp_path: Path) -> None:
    write_images(tmp_path, "1403715273262142976_0.png", "1403715273262142976_1.png")
    for camera in (0, 1):
        log = open_log(tmp_path / f"1403715273262142976_{camera}.png")
        assert log.streams["/robot/camera.frame"].t0_ns == 1_403_715_273_262_143_000


def test_a_depth_image_alone_is_named_after_its_file(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((48, 64), 900, np.uint16))
    log = open_log(tmp_path / "depth.png")
    assert list(log.streams) == ["/robot/depth.frame"]
    assert "depthScale" in log.unconverted["distances of depth"].reason


def test_a_table_of_true_poses_alone_has_the_names_that_it_has_in_its_folder(tmp_path: Path) -> None:
    write_images(tmp_path, "1.png", "2.png")
    rows = "frame,qw,qx,qy,qz,tx_m,ty_m,tz_m\n1,1,0,0,0,0.5,0,2\n2,1,0,0,0,0.6,0,2\n"
    (tmp_path / "truth.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "target.obj").write_text("v 0 0 0\n", encoding="utf-8")
    for path in (tmp_path, tmp_path / "truth.csv"):
        (pose, *_) = open_log(path).samples(["/robot/truth.target"])
        assert (pose.value.parent_frame, pose.value.child_frame) == ("robot/camera", "robot/target")
