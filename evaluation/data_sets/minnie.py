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
    matrix = _matched(
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
    first, second = (read_record(folder / f"MinnieRectLeft{ending}.meta") for ending in _ENDINGS)
    moved, mount, unmount = first.robot.inverse() @ second.robot, first.mount, first.mount.inverse()
    T = unmount.matrix @ moved.matrix @ mount.matrix
    # Jacobians of the camera motion by the errors of the rover motion and of the mount, which occurs twice.
    J_unmount, J_rest = cov.compose_jacobians(unmount.matrix, moved.matrix @ mount.matrix)
    J_moved, J_mount = cov.compose_jacobians(moved.matrix, mount.matrix)
    of_moved = J_rest @ J_moved
    of_mount = J_unmount @ cov.inverse_jacobian(mount.matrix) + J_rest @ J_mount
    covariance = of_moved @ moved.covariance @ of_moved.T + of_mount @ mount.covariance @ of_mount.T
    return UncertainTransform(T, 0.5 * (covariance + covariance.T))


def _matched(pattern: str, text: str, what: str) -> str:
    match = re.search(pattern, text)
    if match is None:
        raise InputError(f"{what}: not there; expected a .meta file of the original CDFF")
    return match[1]


def _pose(text: str, what: str) -> UncertainTransform:
    rows = [_matched(rf"\.arr\[{i}\]: (.*)", text, f"{what} covariance").split() for i in range(6)]
    t, q = (
        split_numbers(_matched(rf"\.{name}: (\S+)", text, f"{what} {name}"), count, f"{what} {name}")
        for name, count in (("translation", 3), ("orientation", 4))
    )
    T = se3.transform_from_quaternion_xyzw(t, q / np.linalg.norm(q))
    return UncertainTransform(T, np.array(rows, np.float64))


def split_numbers(text: str, count: int, what: str) -> FloatArray:
    """Split numbers of six digits that were written without separators: ``0.295922-1.54.12``.

    Raises
    ------
    InputError
        If the text can be split into this many numbers in the format of C++ (``%g``) in no way or in several.
    """

    def readings(rest: str, left: int) -> list[list[str]]:
        if left == 0:
            return [[]] if not rest else []
        heads = [rest[:k] for k in range(1, len(rest) + 1)]
        fit = [
            head
            for head in heads
            if re.fullmatch(r"-?\d+(\.\d+)?(e-?\d+)?", head) and f"{float(head):g}" == head
        ]
        return [[head, *others] for head in fit for others in readings(rest[len(head) :], left - 1)]

    result = readings(text, count)
    if len(result) != 1:
        raise InputError(f"{what}: {text!r} reads as {count} numbers in {len(result)} ways, expected one")
    return np.array(result[0], np.float64)
