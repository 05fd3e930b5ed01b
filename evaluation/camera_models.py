# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare projections of the lens models, read from files, with those of OpenCV and COLMAP.

Each camera is written in the file format of the library and read again, so that the figures include the
conventions of the file, for example the origin of pixels. CDFF_PEER_PYTHON names an environment with pycolmap
and the contributed modules of OpenCV.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.camera import CameraModel, read_cameras
from cdff_common.geometry.se3 import FloatArray
from evaluation.peers.environments import peer_python
from evaluation.peers.lens_projections import peer_projections

COLMAP: dict[str, list[float]] = {
    "SIMPLE_PINHOLE": [500, 320, 240],
    "PINHOLE": [500, 510, 320, 240],
    "SIMPLE_RADIAL": [500, 320, 240, -0.1],
    "RADIAL": [500, 320, 240, -0.1, 0.02],
    "OPENCV": [500, 510, 320, 240, -0.1, 0.02, 1e-3, -2e-3],
    "OPENCV_FISHEYE": [300, 310, 320, 240, -0.01, 0.02, -0.003, 0.0005],
    "FULL_OPENCV": [500, 510, 320, 240, 0.5, -0.2, 1e-4, 2e-4, 0.03, 0.6, -0.15, 0.02],
    "FOV": [500, 510, 320, 240, 0.9],
    "SIMPLE_RADIAL_FISHEYE": [300, 320, 240, 0.02],
    "RADIAL_FISHEYE": [300, 320, 240, 0.02, -0.003],
    "SIMPLE_DIVISION": [500, 320, 240, -0.2],
    "DIVISION": [500, 510, 320, 240, -0.2],
    "SIMPLE_FISHEYE": [300, 320, 240],
    "FISHEYE": [300, 310, 320, 240],
}
OPENCV = {
    "pinhole, 5 coefficients": (-0.3, 0.1, 1e-3, -5e-4, -0.01),
    "rational, 8 coefficients": (0.5, -0.2, 1e-4, 2e-4, 0.03, 0.6, -0.15, 0.02),
    "thin prism, 12 coefficients": (-0.2, 0.05, 1e-4, 2e-4, 0.0, 0.01, 0.0, 0.0, 1e-3, -2e-4, 5e-4, 1e-4),
}
FISHEYE = (-0.01, 0.02, -0.003, 0.0005)
MEI = (1.2, -0.1, 0.02, 1e-4, -2e-4)
K = [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]]


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the largest difference of a pixel and the largest error of a ray for each model."""
    rng = np.random.default_rng(3)
    points = rng.uniform([-2.5, -2.0, 3.0], [2.5, 2.0, 9.0], (2000, 3))
    rows: dict[str, dict[str, Any]] = {}
    zero = np.zeros(3)
    for name, distortion in OPENCV.items():
        pixels, _ = cv2.projectPoints(points, zero, zero, np.array(K), np.array(distortion))
        rows[f"OpenCV {name}"] = _differences(_opencv_file(distortion), points, pixels.reshape(-1, 2))
    pixels, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, np.array(K), np.array(FISHEYE))
    rows["OpenCV fisheye"] = _differences(_opencv_file(FISHEYE, "fisheye"), points, pixels.reshape(-1, 2))
    versions = {"opencv": cv2.__version__}
    if (python := peer_python("pycolmap")) is not None:
        progress("camera models: COLMAP and omnidir")
        peer = peer_projections(python, points, COLMAP, {"K": K, "distortion": MEI})
        versions |= {"pycolmap": peer["pycolmap"], "opencv-contrib": peer["opencv"]}
        mei = np.array(peer["pixels"]["omnidir"])
        rows["OpenCV omnidir"] = _differences(_opencv_file(MEI, "omnidirectional"), points, mei)
        for name, parameters in COLMAP.items():
            pixels = np.array(peer["pixels"][name]) - 0.5
            rows[f"COLMAP {name}"] = _differences(_colmap_file(name, parameters), points, pixels)
    return {"points": len(points), "versions": versions, "models": rows}


def _opencv_file(distortion: tuple[float, ...], model: str = "pinhole") -> CameraModel:
    """Return the camera that is read from a file written by OpenCV."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "camera.yml"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, value in (("image_width", 640), ("image_height", 480), ("camera_model", model)):
            storage.write(name, value)
        coefficients = distortion[1:] if model == "omnidirectional" else distortion
        if model == "omnidirectional":
            storage.write("xi", distortion[0])
        storage.write("camera_matrix", np.array(K))
        storage.write("distortion_coefficients", np.array([coefficients]))
        storage.release()
        return read_cameras(path)[0]["camera"]


def _colmap_file(model: str, parameters: list[float]) -> CameraModel:
    """Return the camera that is read from a ``cameras.txt``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cameras.txt"
        values = " ".join(repr(v) for v in parameters)
        path.write_text(f"# cameras\n1 {model} 640 480 {values}\n", encoding="utf-8")
        return read_cameras(path)[0]["1"]


def _differences(camera: CameraModel, points_m: FloatArray, pixels: FloatArray) -> dict[str, Any]:
    directions = points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    rays = camera.rays(camera.project(points_m))
    return {
        "lens": camera.lens,
        "pixel": float(np.abs(camera.project(points_m) - pixels).max()),
        "ray": float(np.linalg.norm(rays - directions, axis=1).max()),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of the models."""
    lines = [
        "| model of the library | lens | largest difference of a pixel (px) | largest error of a ray (rad) |",
        "|---|---|---|---|",
    ]
    for name, row in figures["models"].items():
        lines.append(f"| {name} | {row['lens']} | {row['pixel']:.1e} | {row['ray']:.1e} |")
    versions = ", ".join(f"{name} {version}" for name, version in figures["versions"].items())
    return "\n".join([*lines, "", f"{figures['points']} points; versions: {versions}."])
