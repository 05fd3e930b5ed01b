# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff new profile`` from questions, with a URDF and camera calibrations, and the picture of the frames."""

from __future__ import annotations

import builtins
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from cdff_common.cli import EXIT_ERROR, main
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import Robot, load_profile
from cdff_common.types import LidarScan, TransformWithCovariance
from cdff_dev.logs import LogWriter
from cdff_dev.new.mounts import camera_mounts
from tests.support.rover_frames import PICTURE, picture

ANSWERS = """\
Pico
pico
moon
lidar top 5
0.1 0 0.8 0 12
0.1 0 0.8 0 12 0
stereo nav 4
0.4 0.06 0.9 0 20 0
imu xsens 100

wheels drive 20
lidar top 5
radar r 5

18




0.7
""".splitlines()

T_CN_CNM1 = se3.transform(np.eye(3), [-0.12, 0.0, 0.0])
T_CAM_IMU = se3.transform(se3.matrix_from_quaternion_xyzw([0.5, -0.5, 0.5, 0.5]), [0.01, 0.02, 0.03])


def kalibr(tmp_path: Path, *, with_imu: bool) -> Path:
    def camera(T: np.ndarray) -> dict[str, object]:
        return {
            "camera_model": "pinhole",
            "intrinsics": [400.0, 400.0, 320.0, 240.0],
            "distortion_model": "radtan",
            "distortion_coeffs": [0.0, 0.0, 0.0, 0.0],
            "resolution": [640, 480],
        } | ({"T_cam_imu": T.tolist()} if with_imu else {})

    chain = {"cam0": camera(T_CAM_IMU), "cam1": camera(T_CN_CNM1 @ T_CAM_IMU)}
    chain["cam1"]["T_cn_cnm1"] = T_CN_CNM1.tolist()
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump(chain))
    return path


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> None:
    next_answers: Iterator[str] = iter(ANSWERS)
    monkeypatch.setattr(builtins, "input", lambda _question: next(next_answers))


def written(tmp_path: Path, *options: str) -> Robot:
    out = tmp_path / "pico.yaml"
    assert main(["new", "profile", "--interactive", "--out", str(out), *options]) == 0
    return load_profile(out).robot("pico")


def test_answers_become_a_valid_profile_and_wrong_ones_are_asked_again(
    answers: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = written(tmp_path)
    printed = capsys.readouterr().out
    assert "'Pico': expected a name" in printed
    assert "5 numbers, expected six" in printed
    assert "'top': another sensor has this name" in printed
    assert "'radar r 5': expected KIND NAME RATE_HZ" in printed
    assert list(robot.sensors) == ["top", "nav", "xsens", "drive"]
    assert robot.limits["max_slope_deg"] == 18.0
    assert robot.limits["height_m"] == 0.7
    graph = robot.frame_graph()
    lidar = graph.lookup("pico/base", "pico/top", 0).matrix
    assert (lidar[:3, :3] @ [1, 0, 0])[2] == pytest.approx(-np.sin(np.deg2rad(12)), abs=1e-6)
    camera = graph.lookup("pico/base", "pico/nav_left", 0).matrix
    assert camera[:3, :3] @ [0, 0, 1] == pytest.approx([np.cos(0.349066), 0, -np.sin(0.349066)], abs=1e-5)
    assert next(entry.name for entry in robot.dfpcs) == "lidar_slam"


def test_a_kalibr_chain_with_imu_places_both_cameras(answers: None, tmp_path: Path) -> None:
    graph = written(tmp_path, "--calibration", str(kalibr(tmp_path, with_imu=True))).frame_graph()
    np.testing.assert_allclose(
        graph.lookup("pico/xsens", "pico/nav_left", 0).matrix, se3.inverse(T_CAM_IMU), atol=1e-4
    )
    right = graph.lookup("pico/nav_left", "pico/nav_right", 0).matrix
    np.testing.assert_allclose(right[:3, 3], [0.12, 0, 0], atol=1e-6)


def test_without_an_imu_the_chain_places_the_right_camera_only(answers: None, tmp_path: Path) -> None:
    mounts = camera_mounts(kalibr(tmp_path, with_imu=False))
    assert not mounts.by_imu
    robot = written(tmp_path, "--calibration", str(kalibr(tmp_path, with_imu=False)))
    assert robot.frame_graph().parent_of("pico/nav_left") == "pico/base"
    assert robot.frame_graph().parent_of("pico/nav_right") == "pico/nav_left"


def test_the_links_of_a_urdf_are_the_frames_of_the_sensors(answers: None, tmp_path: Path) -> None:
    urdf = tmp_path / "model" / "pico.urdf"
    urdf.parent.mkdir()
    urdf.write_text(
        '<robot name="pico"><link name="base_link"/><link name="top"/>'
        '<joint name="j" type="fixed"><parent link="base_link"/><child link="top"/>'
        '<origin xyz="0.2 0 0.7" rpy="0 0.2 0"/></joint></robot>'
    )
    robot = written(tmp_path, "--urdf", str(urdf))
    assert (tmp_path / "pico.urdf").exists()
    assert "pico/top" not in {edge.child for edge in robot.frames}
    T_base_top = robot.frame_graph().lookup("pico/base", "pico/top", 0).matrix
    assert T_base_top[:3, 3] == pytest.approx([0.2, 0.0, 0.7])


def test_the_picture_shows_every_frame_below_the_base(answers: None, tmp_path: Path) -> None:
    picture = tmp_path / "frames.svg"
    written(tmp_path, "--picture", str(picture))
    root = ElementTree.parse(picture).getroot()
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    for frame in ("base", "top", "nav_left", "xsens"):
        assert texts.count(frame) == 2, frame  # from above and from the right
    # The base looks to the right in both panels: its x axis is a red line of positive dx.
    red = [e for e in root.iter("{http://www.w3.org/2000/svg}line") if e.get("stroke") == "#d62728"]
    assert float(red[0].get("x2", 0)) > float(red[0].get("x1", 0))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected a LOG, or --interactive"),
        (["some.msg", "--interactive"], "expected a LOG, or --interactive"),
        (["--interactive", "--urdf", "nowhere.urdf"], "nowhere.urdf"),
        (["--interactive", "--calibration", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_unusable_arguments_are_refused(
    arguments: list[str], message: str, answers: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "x.yaml")]
    assert main(["new", "profile", *arguments, *out]) == EXIT_ERROR
    assert message in capsys.readouterr().err
    assert not (tmp_path / "x.yaml").exists()


def test_the_picture_of_the_page_is_the_one_of_this_code() -> None:
    assert PICTURE.read_text(encoding="utf-8") == picture()


def test_the_places_of_sensors_in_a_recording_are_their_mounts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    T = se3.transform(se3.exp_so3(np.array([0.0, 0.3, 0.0])), np.array([0.1, 0.2, 0.3]))
    with LogWriter(tmp_path / "run.msg") as log:
        scan = LidarScan.from_arrays(
            np.ones((3, 3), np.float32), np.zeros(3, np.uint32), frame="mana/lidar", t0_ns=0, t1_ns=0
        )
        for stamp_ns in (1_000_000, 101_000_000):
            log.write("/mana/lidar.scan", scan, stamp_ns)
        place = TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="mana/base", child="mana/lidar", stamp_ns=1_000_000
        )
        log.write("/mana/lidar.mount", place, 1_000_000)
    assert main(["new", "profile", str(tmp_path / "run.msg"), "--out", str(tmp_path / "p.yaml")]) == 0
    profile = yaml.safe_load((tmp_path / "p.yaml").read_text(encoding="utf-8"))
    (robot,) = profile["robots"]
    edge = next(edge for edge in robot["frames"] if edge["child"] == "mana/lidar")
    assert edge["parent"] == "mana/base"
    assert edge["translation_m"] == pytest.approx([0.1, 0.2, 0.3])
    assert edge["quaternion_xyzw"] == pytest.approx([0.0, np.sin(0.15), 0.0, np.cos(0.15)], abs=1e-6)
    assert robot["sensors"]["lidar"]["streams"] == {"scan": "LidarScan"}
    check = ["check", "--profile", str(tmp_path / "p.yaml"), "--log", str(tmp_path / "run.msg")]
    capsys.readouterr()
    assert main(check) == 0
    assert "its place" not in capsys.readouterr().out
    text = (tmp_path / "p.yaml").read_text(encoding="utf-8")
    (tmp_path / "p.yaml").write_text(text.replace("[0.10000, ", "[0.50000, "), encoding="utf-8")
    assert main(check) == 0
    assert "warning: /mana/lidar: its place in mana/base differs from that of the log by 0.400 m" in (
        capsys.readouterr().out
    )
