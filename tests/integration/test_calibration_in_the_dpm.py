# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff calibrate … --dpm`` with a running DPM: the calibrated frame is stored and valid in its interval."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.cli import main
from cdff_common.geometry import se3
from cdff_dev.ports import free_port
from tests.support.board_folder import T_HAND_CAMERA, TEXT, write_board_folder
from tests.support.board_motion_folder import T_CAMERA_IMU, write_motion_folder

from .conftest import Eventually, Spawn

pytestmark = pytest.mark.integration

S = 1_000_000_000
PROFILE = """
name: arm
robots:
- id: servicer
  frames:
  - {parent: servicer/base, child: servicer/hand, translation_m: [0.0, 0.0, 1.0]}
  - {parent: servicer/hand, child: servicer/camera, translation_m: [0.5, 0.0, 0.0]}
"""
FRAMES = ("servicer/hand", "servicer/camera")


def test_a_calibrated_frame_is_valid_in_its_interval_and_that_of_the_profile_at_other_times(
    spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profile, folder = tmp_path / "profile.yaml", tmp_path / "boards"
    profile.write_text(PROFILE)
    folder.mkdir()
    write_board_folder(folder)
    spawn("services.router")
    spawn("services.dpm", "--profile", str(profile), "--http", f"127.0.0.1:{free_port()}")
    with Bus.open(endpoint, name="test", wait_s=20) as bus:
        eventually(lambda: bus.alive(keys.alive("*", "dpm")), 30, "the DPM's tokens")

        def T_hand_camera(t_ns: int) -> np.ndarray:
            parameters = {"parent": FRAMES[0], "child": FRAMES[1], "t": str(t_ns)}
            return np.array(bus.call(keys.dpm_rpc("ground", "pose"), parameters, timeout_s=5).body()["T"])

        of_profile = T_hand_camera(200 * S)
        command = ["calibrate", "hand-eye", str(folder), "--board", TEXT, "--dpm", "--connect", endpoint]
        command += ["--camera", str(folder / "camera.yaml"), "--valid-from", str(100 * S)]
        command += ["--valid-until", str(300 * S), "--hand-frame", FRAMES[0], "--camera-frame", FRAMES[1]]
        assert main(command) == 0
        assert f"servicer/camera: revision in the DPM, valid from {100 * S} ns" in capsys.readouterr().out

        calibrated = T_hand_camera(200 * S)
        assert np.linalg.norm(calibrated[:3, 3] - T_HAND_CAMERA[:3, 3]) < 0.01
        assert se3.rotation_angle(calibrated[:3, :3].T @ T_HAND_CAMERA[:3, :3]) < np.deg2rad(0.3)
        for other_s in (50, 350):
            np.testing.assert_array_equal(T_hand_camera(other_s * S), of_profile)
        call = bus.call(keys.dpm_rpc("ground", "frames"), {"frame": FRAMES[1]}, timeout_s=5)
        newest = call.body()["revisions"][-1]
        sigma_m = np.sqrt(np.diag(newest["covariance"])[:3])
        assert (np.abs(calibrated[:3, 3] - T_HAND_CAMERA[:3, 3]) < 4.5 * sigma_m + 1e-4).all()
        assert (sigma_m < 0.01).all()

        motion = tmp_path / "motion"
        motion.mkdir()
        write_motion_folder(motion)
        command = ["calibrate", "camera-imu", str(motion), "--board", TEXT, "--dpm", "--connect", endpoint]
        command += ["--camera", str(motion / "camera.yaml"), "--valid-from", str(100 * S)]
        command += ["--camera-frame", FRAMES[1], "--imu-frame", "servicer/imu"]
        assert main(command) == 0
        assert f"servicer/imu: revision in the DPM, valid from {100 * S} ns" in capsys.readouterr().out
        parameters = {"parent": FRAMES[1], "child": "servicer/imu", "t": str(200 * S)}
        T = np.array(bus.call(keys.dpm_rpc("ground", "pose"), parameters, timeout_s=5).body()["T"])
        assert np.linalg.norm(T[:3, 3] - T_CAMERA_IMU[:3, 3]) < 0.02
        assert se3.rotation_angle(T[:3, :3].T @ T_CAMERA_IMU[:3, :3]) < np.deg2rad(0.3)

        # An empty interval is refused before anything is sent.
        assert main([*command, "--valid-until", str(50 * S)]) == 1
        assert "--valid-until" in capsys.readouterr().err
