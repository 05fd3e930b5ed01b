# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read the two stereo pairs of the rover Minnie and their ``.meta`` files (recorded by the original CDFF)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import FramePair

FOLDER = "cdff_upstream/MinnieStereo"
#: Suffixes of the file names of the first and second pair, and the time between the pairs, nanoseconds.
_ENDINGS, _STEP_NS = ("", "Next"), 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Metadata of an image in a ``.meta`` file.

    Attributes
    ----------
    robot, mount : UncertainTransform
        ``T_terrain_robot`` and ``T_robot_camera``, each with its covariance.
    camera_matrix : array, shape (3, 3)
        Of the rectified image, pixels.
    """

    robot: UncertainTransform
    mount: UncertainTransform
    camera_matrix: FloatArray


def read_record(path: Path) -> Record:
    """Read a ``.meta`` file; raises InputError naming the missing or ambiguous entry."""
    text = path.read_text(encoding="utf-8")
    parts = re.split(r"\.pose_(\w+)\.data:", text)
    blocks = dict(zip(parts[1::2], parts[2::2], strict=True))
    robot, mount = (
        _pose(blocks.get(name, ""), f"{path.name}: pose_{name}")
        for name in ("fixedFrame_robotFrame", "robotFrame_sensorFrame")
    )
    matrix = _match(
        r"\.cameraMatrix:\s+([-+.\de]+(?:\s+[-+.\de]+){4})", text, f"{path.name}: cameraMatrix"
    ).split()
    # The file omits the zeros below the diagonal.
    fx, _, cx, fy, cy = (float(word) for word in matrix)
    return Record(robot, mount, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))


def pairs(folder: Path, scale: float = 1.0) -> list[FramePair]:
    """Return both pairs with the recorded camera and baseline; the images are scaled."""
    results = []
    for i, ending in enumerate(_ENDINGS):
        records = [read_record(folder / f"MinnieRect{side}{ending}.meta") for side in ("Left", "Right")]
        images = [cv2.imread(str(folder / f"MinnieRect{side}{ending}.png")) for side in ("Left", "Right")]
        left, right = (cv2.resize(m, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) for m in images)
        K = np.diag([scale, scale, 1.0]) @ records[0].camera_matrix
        K[:2, 2] += 0.5 * (scale - 1.0)  # pixel centres, not corners, are at whole coordinates
        baseline_m = float(np.linalg.norm((records[0].mount.inverse() @ records[1].mount).matrix[:3, 3]))
        results.append(
            FramePair.from_images(
                left, right, baseline_m=baseline_m, camera_matrix=K, stamp_ns=i * _STEP_NS, mode="BGR"
            )
        )
    return results


def recorded_step(folder: Path) -> UncertainTransform:
    """Return the recorded ``T_left1_left2`` with its covariance.

    The errors of the two rover poses are treated as independent; the mount and its error are common to both.
    """
    first_record, second_record = (
        read_record(folder / f"MinnieRectLeft{ending}.meta") for ending in _ENDINGS
    )
    rover_step = first_record.robot.inverse() @ second_record.robot
    mount, inverse_mount = first_record.mount, first_record.mount.inverse()
    T = inverse_mount.matrix @ rover_step.matrix @ mount.matrix
    # Jacobians of the camera motion by the errors of the rover motion and of the mount, which occurs twice.
    J_inverse_mount, J_product = cov.compose_jacobians(inverse_mount.matrix, rover_step.matrix @ mount.matrix)
    J_step, J_mount = cov.compose_jacobians(rover_step.matrix, mount.matrix)
    J_of_step = J_product @ J_step
    J_of_mount = J_inverse_mount @ cov.inverse_jacobian(mount.matrix) + J_product @ J_mount
    covariance = J_of_step @ rover_step.covariance @ J_of_step.T
    covariance = covariance + J_of_mount @ mount.covariance @ J_of_mount.T
    return UncertainTransform(T, 0.5 * (covariance + covariance.T))


def _match(pattern: str, text: str, entry: str) -> str:
    match = re.search(pattern, text)
    if match is None:
        raise InputError(f"{entry}: missing; expected a .meta file of the original CDFF")
    return match[1]


def _pose(text: str, entry: str) -> UncertainTransform:
    rows = [_match(rf"\.arr\[{i}\]: (.*)", text, f"{entry} covariance").split() for i in range(6)]
    t, q = (
        split_numbers(_match(rf"\.{name}: (\S+)", text, f"{entry} {name}"), count, f"{entry} {name}")
        for name, count in (("translation", 3), ("orientation", 4))
    )
    T = se3.transform_from_quaternion_xyzw(t, q / np.linalg.norm(q))
    return UncertainTransform(T, np.array(rows, np.float64))


def split_numbers(text: str, count: int, entry: str) -> FloatArray:
    """Split numbers of six digits that were written without separators: ``0.295922-1.54.12``.

    Raises
    ------
    InputError
        If the text can be split into this many numbers in the format of C++ (``%g``) in no or several ways.
    """

    def splits(remaining_text: str, remaining_count: int) -> list[list[str]]:
        if remaining_count == 0:
            return [[]] if not remaining_text else []
        heads = [remaining_text[:k] for k in range(1, len(remaining_text) + 1)]
        numbers = [
            head
            for head in heads
            if re.fullmatch(r"-?\d+(\.\d+)?(e-?\d+)?", head) and f"{float(head):g}" == head
        ]
        return [
            [head, *others]
            for head in numbers
            for others in splits(remaining_text[len(head) :], remaining_count - 1)
        ]

    results = splits(text, count)
    if len(results) != 1:
        raise InputError(f"{entry}: {text!r} reads as {count} numbers in {len(results)} ways, expected one")
    return np.array(results[0], np.float64)
