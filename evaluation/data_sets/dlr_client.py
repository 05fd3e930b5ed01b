# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mock-up of a client satellite of DLR (``dlr_oos_client``): mesh, stereo pair, cameras, start pose.

Units of the files are millimetres. The matrices of the cameras are camera-to-world, other than their comment
states.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import NamedTuple

import cv2
import numpy as np

from cdff_common.arrays import ByteArray, FloatArray, IntArray
from cdff_common.geometry import se3

FOLDER = "dlr_oos_client"
#: T_world_docking, start pose of DLR (README of the data set, from the unit test of InFuse).
_T_WORLD_DOCKING = np.array(
    [
        [0.014377, -0.997371, 0.071024, 1.207899488],
        [0.433600, 0.070224, 0.898365, 0.296456254],
        [-0.900991, 0.017880, 0.433469, 1.202087847],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


class ClientCamera(NamedTuple):
    """Camera matrix (3, 3), distortion k1 k2 p1 p2 k3 (5,), T_world_camera (4, 4), image (rows, columns)."""

    matrix: FloatArray
    distortion: FloatArray
    T_world_camera: FloatArray
    image: ByteArray


def cameras(data: Path) -> tuple[ClientCamera, ClientCamera]:
    """Return the left and the right camera."""
    lines = _values(data / FOLDER / "camera_parameters.txt")[1:]
    found = []
    for k, side in enumerate("LR"):
        fx, fy, cx, cy, skew = lines[6 * k + 2]
        T = np.vstack([np.reshape(lines[6 * k + 4], (3, 4)), [0.0, 0.0, 0.0, 1.0]])
        T[:3, 3] *= 1e-3
        image = cv2.imread(str(data / FOLDER / f"DLR_OOS_cam{side}0000.pgm"), cv2.IMREAD_GRAYSCALE)
        matrix = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        found.append(
            ClientCamera(
                matrix, np.array(lines[6 * k + 3]), se3.normalise_transform(T), np.asarray(image, np.uint8)
            )
        )
    return found[0], found[1]


def mesh(data: Path) -> tuple[FloatArray, IntArray]:
    """Return vertices (n, 3), metres, and triangles (m, 3) of all polyhedra of the model."""
    vertices: list[FloatArray] = []
    triangles: list[tuple[int, int, int]] = []
    count = 0
    lines = (data / FOLDER / "theModel_client.txt").read_text(encoding="utf-8").splitlines()
    content = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    for i, kind in enumerate(content):
        if kind != "P":
            continue
        part = data / FOLDER / "model" / PurePosixPath(content[i + 3]).name
        rows = [line.split() for line in part.read_text(encoding="utf-8").splitlines()]
        points = [[float(v) for v in row[1:4]] for row in rows if row and row[0] == "v"]
        for row in rows:
            if row and row[0] == "f":
                corners = [count + int(v) - 1 for v in row[2:]]
                triangles += [(corners[0], corners[j], corners[j + 1]) for j in range(1, len(corners) - 1)]
        vertices.append(1e-3 * np.array(points))
        count += len(points)
    return np.concatenate(vertices), np.array(triangles, np.int64)


def start_pose(data: Path, camera: ClientCamera) -> FloatArray:
    """Return DLR's start pose as T_camera_model (4, 4), metres."""
    T_model_docking = np.vstack(
        [np.reshape(_values(data / FOLDER / "theModel_client.txt")[1], (3, 4)), [0, 0, 0, 1]]
    )
    T_model_docking[:3, 3] *= 1e-3
    T = se3.inverse(camera.T_world_camera) @ _T_WORLD_DOCKING @ np.linalg.inv(T_model_docking)
    return se3.normalise_transform(T)


def _values(path: Path) -> list[list[float]]:
    """Return the numbers of each line that has only numbers."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            if not line.startswith("#") and line.split():
                rows.append([float(word) for word in line.split()])
        except ValueError:
            continue
    return rows
