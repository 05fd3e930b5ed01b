# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff slam``, ``cdff vo`` and ``cdff dem`` go from a path to trajectory, map and pictures."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from cdff_common.cli import EXIT_ERROR, EXIT_REFUSED, main
from cdff_common.formats.geotiff import read_map
from cdff_common.formats.ply import read_ply
from cdff_common.formats.pose_graph import read_pose_graph
from cdff_common.formats.tum import read_tum
from cdff_common.formats.visual_map import read_visual_map
from cdff_dev.logs import LogWriter, open_log
from cdff_dev.slam.estimation import sensor_stream, too_many_failed
from cdff_dev.slam.methods import RGBD_SLAM, method_for

PNG = b"\x89PNG"
PAIRS = 8


@pytest.fixture
def drive(real_data: Callable[[str], Path], tmp_path: Path) -> Path:
    """The first pairs of a KITTI sequence with calibration and true poses."""
    source, folder = real_data("kitti_stereo/KITTI_sequence_1"), tmp_path / "drive"
    for side in ("image_l_kitti", "image_r_kitti"):
        (folder / side).mkdir(parents=True)
        for image in sorted((source / side).iterdir())[:PAIRS]:
            shutil.copy(image, folder / side)
    for name in ("calib.txt", "calib_kitti.txt", "poses.txt"):
        if (source / name).is_file():
            shutil.copy(source / name, folder)
    return folder


def test_vo_writes_trajectory_map_graph_pictures_and_errors(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["vo", str(drive), "--out", str(out)]) == 0
    stamps_ns, T = read_tum(out / "trajectory.tum")
    assert len(stamps_ns) == PAIRS
    np.testing.assert_allclose(T[0], np.eye(4), atol=1e-9)
    rows = np.loadtxt(out / "trajectory_kitti.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(rows, T[:, :3], atol=1e-6)
    assert (out / "trajectory.png").read_bytes().startswith(PNG)
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert run["statuses"] == {"OK": PAIRS}
    assert run["versions"]["numpy"] == np.__version__
    assert run["truth"]["ate"]["translation_m"]["rmse"] < 0.01 * run["path_length_m"]
    points_m = read_ply(out / "map.ply").points_m
    assert len(points_m) == run["map"]["points"] > 10_000
    ahead = (np.abs(points_m[:, 0]) < 2.0) & (np.abs(points_m[:, 2] - 9.0) < 2.0)
    assert np.median(points_m[ahead, 1]) == pytest.approx(1.65, abs=0.2)  # the road, y is down
    assert (out / "map.png").read_bytes().startswith(PNG)
    graph = read_pose_graph(out / "graph.g2o", frame="kitti/vo")
    np.testing.assert_allclose(graph.vertices.matrices, T, atol=1e-6)
    assert len(graph.edges.ends) == PAIRS - 1
    report = (out / "report.html").read_text(encoding="utf-8")
    assert report.count("data:image/png;base64,") == 4  # trajectory, map, errors, timing
    for text in ("Errors after alignment", "aligned by rotation and translation", "Drift over 5 to"):
        assert text in report
    assert "http" not in report  # no external resources
    with open_log(out) as outputs:
        info = outputs.streams["/kitti/visual_odometry_sparse.pose"]
        assert (info.type_name, info.count) == ("TransformWithCovariance", PAIRS)
        assert outputs.streams["/kitti/visual_odometry_sparse.cloud"].type_name == "Pointcloud"


def test_stamps_that_go_backwards_are_named(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_log(real_data("kitti_velodyne")) as log, LogWriter(tmp_path / "jump.msg") as writer:
        for sample in islice(log.samples(), 3):
            stamp_ns = 10**13 + sample.stamp_ns - (150_000_000 if sample.seq == 2 else 0)
            writer.write(sample.stream, sample.value, stamp_ns)
    assert main(["slam", str(tmp_path / "jump.msg"), "--out", str(tmp_path / "out")]) == 0
    assert "the stamps go backwards 1 times" in capsys.readouterr().out


def test_slam_writes_map_graph_and_pictures(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans, out = tmp_path / "scans", tmp_path / "out"
    scans.mkdir()
    for n in range(2):
        shutil.copy(real_data(f"kitti_velodyne/{n:06d}.bin"), scans)
    assert main(["slam", str(scans), "--out", str(out)]) == 0
    assert "no comparison: no true poses in the log" in capsys.readouterr().out
    assert len(read_ply(out / "map.ply").points_m) > 1000
    assert (out / "map.png").read_bytes().startswith(PNG)
    assert "Map</h2>" in (out / "report.html").read_text(encoding="utf-8")
    with open_log(out) as outputs:
        assert {info.type_name for info in outputs.streams.values()} >= {"PoseGraph", "Pointcloud"}
    assert "VERTEX_SE" in (out / "graph.g2o").read_text(encoding="utf-8")
    # The car moves forward by about 0.9 m between these sweeps.
    _, T = read_tum(out / "trajectory.tum")
    assert 0.5 < np.linalg.norm(T[-1, :3, 3]) < 1.5


def test_slam_uses_the_stereo_camera_of_a_log_without_a_lidar(drive: Path, tmp_path: Path) -> None:
    for side in ("image_l_kitti", "image_r_kitti"):
        for image in sorted((drive / side).iterdir())[4:]:
            image.unlink()
    out = tmp_path / "out"
    assert main(["slam", str(drive), "--out", str(out)]) == 0
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert (run["dfpc"], run["statuses"]) == ("visual_slam", {"OK": 4})
    assert run["truth"]["ate"]["translation_m"]["rmse"] < 0.02 * run["path_length_m"]
    assert len(read_ply(out / "map.ply").points_m) > 1000
    assert read_visual_map((out / "map.npz").read_bytes()).keyframes
    assert "VERTEX_SE" in (out / "graph.g2o").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("command", "stream", "dfpc"),
    [("slam", None, "lidar_slam"), ("slam", "pair", "visual_slam"), ("slam", "image", "visual_slam")],
)
def test_slam_prefers_the_lidar_unless_a_stream_is_named(command: str, stream: str | None, dfpc: str) -> None:
    types = {"scan": "LidarScan", "pair": "FramePair", "image": "Frame", "depth": "DistanceImage"}
    log = SimpleNamespace(streams={n: SimpleNamespace(type_name=t) for n, t in types.items()})
    assert method_for(command, log, stream).dfpc == dfpc  # type: ignore[arg-type]


@pytest.mark.slow
def test_dem_of_a_stereo_drive_has_the_road_below_the_camera(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["dem", str(drive), "--resolution-m", "0.2", "--out", str(out)]) == 0
    elevation = read_map((out / "dem.tif").read_bytes())
    geometry = elevation.geometry
    assert geometry.frame == "kitti/start"
    x_m = np.arange(7.0, 12.0, 0.2)
    row, col, _ = geometry.cells_of(x_m, np.zeros_like(x_m))
    # The cameras are 1.65 m above the road and pitched by about a degree.
    assert np.nanmedian(elevation.layer("mean")[row, col]) == pytest.approx(-1.65, abs=0.2)
    assert (out / "dem.png").read_bytes().startswith(PNG)
    with open_log(out) as outputs:  # for cdff view
        assert outputs.streams["/kitti/digital_elevation_mapping.map"].type_name == "ElevationMap"
        origin = next(outputs.samples(["/kitti/digital_elevation_mapping.origin"])).value
    assert (origin.parent_frame, origin.child_frame) == ("kitti/start", "kitti/vo")
    np.testing.assert_allclose(origin.transform.matrix[:3, :3] @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-9)
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert run["dem"]["observed_cells"] > 1000
    assert run["dem"]["resolution_m"] == 0.2


@pytest.mark.slow
def test_pairs_too_far_apart_are_refused_with_the_reason(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(real_data("euroc_v101_pairs/query"))
    assert main(["vo", folder, "--out", str(tmp_path / "out")]) == EXIT_REFUSED
    message = capsys.readouterr().err
    assert "of the first" in message, "the remainder is not computed"
    assert "pairs were not located" in message
    assert "7.97 s apart" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_pairs_seconds_apart_are_matched_as_keyframes(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    source, pairs = real_data("euroc_v101_pairs"), tmp_path / "drive" / "map"
    pairs.mkdir(parents=True)
    for name in ("calibration.yaml", "truth_map.csv"):
        shutil.copy(source / name, tmp_path / "drive")
    for image in sorted((source / "map").iterdir())[:32]:
        shutil.copy(image, pairs)
    assert main(["slam", str(pairs), "--out", str(tmp_path / "out")]) == 0
    run = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    # Five images share less than a quarter of their area with the map: small_extent.
    assert run["statuses"] == {"OK": 10, "DEGRADED": 5, "FAILED": 1}
    assert run["truth"]["frames"] == {"estimate": "euroc/navcam_left", "truth": "euroc/navcam_left"}
    assert run["truth"]["ate"]["rotation_aligned_deg"]["median"] < 3.0
    assert len(read_tum(tmp_path / "out" / "trajectory.tum")[0]) >= 15


def test_more_than_five_percent_of_failed_poses_are_too_many() -> None:
    assert not too_many_failed({"OK": 90, "DEGRADED": 5, "FAILED": 5})
    assert too_many_failed({"OK": 94, "FAILED": 6})


def test_a_folder_that_cannot_be_written_is_reported_before_the_work(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cdff_dev.logs.opened.open_log", lambda *_: pytest.fail("the log was opened"))
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert main(["vo", str(drive), "--out", str(tmp_path / "file" / "out")]) == EXIT_ERROR
    assert "cannot be written" in capsys.readouterr().err


def test_a_log_without_the_sensor_is_refused_with_what_it_has(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    for n in range(2):
        shutil.copy(real_data(f"kitti_velodyne/{n:06d}.bin"), scans)
    assert main(["vo", str(scans), "--out", str(tmp_path / "out")]) == EXIT_ERROR
    message = capsys.readouterr().err
    assert "(LidarScan)" in message
    assert "use cdff slam" in message


def test_the_images_of_an_rgbd_camera_are_those_with_depth_images(tmp_path: Path) -> None:
    for name, pixels in (("colour", np.uint8), ("depth", np.uint16)):
        (tmp_path / name).mkdir()
        for k in range(3):
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), np.full((48, 64), 90, pixels))
    (tmp_path / "model").mkdir()
    cv2.imwrite(str(tmp_path / "model" / "picture9.png"), np.full((48, 64), 90, np.uint8))
    (tmp_path / "camera.yaml").write_text(
        "px: 60\npy: 60\nu0: 32\nv0: 24\ndepthScale: 0.001\n", encoding="utf-8"
    )
    with open_log(tmp_path) as log:
        assert [name for name in log.streams if name.endswith("frame")] == [
            "/robot/colour.frame",
            "/robot/model.frame",
        ]
        assert method_for("slam", log) is RGBD_SLAM
        assert sensor_stream(RGBD_SLAM, log) == "/robot/colour.frame"


@pytest.mark.parametrize("factor", [1000.0, 0.01])
def test_scans_in_other_units_are_refused_with_their_ranges(
    factor: float, real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    for n in range(2):
        points = np.fromfile(real_data(f"kitti_velodyne/{n:06d}.bin"), "<f4").reshape(-1, 4)
        points[:, :3] *= np.float32(factor)
        points[::20].tofile(scans / f"{n:06d}.bin")
    assert main(["slam", str(scans), "--out", str(tmp_path / "out")]) == EXIT_REFUSED
    assert "only those from 0.5 to 60 m are used: expected metres" in capsys.readouterr().err


def test_a_missing_viewer_is_reported_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["vo", str(tmp_path / "none"), "--out", str(tmp_path / "out"), "--view"]) == 1
    assert "pip install 'cdff[view]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
