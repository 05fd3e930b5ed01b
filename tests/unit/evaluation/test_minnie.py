# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The metadata of the rover Minnie's images are read, and the covariance is transferred to the camera's
step.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from evaluation.data_sets.minnie import read_record, recorded_step, split_numbers

RECORDS = {
    "Left": ("-7.52624-1.10862-4.27392", "-0.00173265-0.0115965-0.3220390.946654"),
    "LeftNext": ("-7.41466-1.21867-4.27527", "-0.00142314-0.0098489-0.3223070.946583"),
}
MOUNT = ("0.2959220.1245421.66978", "-0.6316660.623851-0.3182270.332476")


def block(name: str, translation: str, orientation: str, variances: list[float]) -> str:
    rows = [" ".join(f"{v:.6f}" for v in row) for row in np.diag(variances)]
    arrays = "".join(f"\t\t\t.arr[{i}]: {row} \n" for i, row in enumerate(rows))
    return f"\t.{name}.data:\n\t\t.cov:\n{arrays}\t\t.orientation: {orientation}\n\t\t.translation: {translation}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, (translation, orientation) in RECORDS.items():
        text = ".intrinsic:\n\t.cameraMatrix: \n      1018.6            0      956.501\n      1018.6      617.314\n"
        text += block("pose_fixedFrame_robotFrame", translation, orientation, [1e-4] * 3 + [4e-6] * 3)
        text += block("pose_robotFrame_sensorFrame", *MOUNT, [1e-4] * 3 + [9e-6] * 3)
        (tmp_path / f"MinnieRect{name}.meta").write_text(text, encoding="utf-8")
    return tmp_path


def test_numbers_without_separator_are_split_by_their_six_digits() -> None:
    np.testing.assert_array_equal(split_numbers(MOUNT[0], 3, "t"), [0.295922, 0.124542, 1.66978])
    np.testing.assert_array_equal(
        split_numbers("-75.2624-11.0862-4.27392", 3, "t"), [-75.2624, -11.0862, -4.27392]
    )


@pytest.mark.parametrize("text", ["0.125.25", "0.1250.25", "1.5,2.5", ""])
def test_ambiguous_and_unreadable_numbers_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected one"):
        split_numbers(text, 2, "t")


def test_a_record_without_its_covariance_is_refused_by_name(folder: Path) -> None:
    path = folder / "MinnieRectLeft.meta"
    path.write_text(path.read_text(encoding="utf-8").replace("arr[5]", "row"), encoding="utf-8")
    with pytest.raises(InputError, match=r"MinnieRectLeft.meta: pose_fixedFrame_robotFrame covariance"):
        read_record(path)


def test_a_camera_matrix_with_missing_zeros_is_read(folder: Path) -> None:
    K = read_record(folder / "MinnieRectLeft.meta").camera_matrix
    np.testing.assert_array_equal(K, [[1018.6, 0.0, 956.501], [0.0, 1018.6, 617.314], [0.0, 0.0, 1.0]])


@pytest.mark.slow
def test_the_uncertainty_of_a_motion_agrees_with_sampled_poses_and_a_common_mount(
    folder: Path, rng: np.random.Generator
) -> None:
    recorded = recorded_step(folder)
    first, second = (read_record(folder / f"MinnieRect{name}.meta") for name in RECORDS)

    def random_pose(T: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        error = rng.multivariate_normal(np.zeros(6), covariance)
        return se3.transform(se3.exp_so3(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])

    errors = []
    for _ in range(4000):
        mount = random_pose(first.mount.matrix, first.mount.covariance)
        left = [random_pose(r.robot.matrix, r.robot.covariance) @ mount for r in (first, second)]
        errors.append(cov.pose_error(se3.inverse(left[0]) @ left[1], recorded.matrix))
    largest = float(np.abs(recorded.covariance).max())
    np.testing.assert_allclose(np.cov(np.array(errors).T), recorded.covariance, atol=0.08 * largest)
