# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A folder of rendered images of a board and readings of an IMU, for ``cdff calibrate camera-imu``."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import NAMESPACE_OID, uuid5

import cv2
import numpy as np
import yaml

from cdff_common.geometry import se3
from cdff_common.interfaces.product import Header
from cdff_common.types import Frame, IMUSensors, Time
from cdff_dev.logs import LogWriter
from cdff_dev.simulate.board_images import board_image
from cdff_dev.simulate.board_motion import BoardMotion, noisy_readings, stamps_at
from tests.support.board_folder import BOARD, CAMERA

T_CAMERA_IMU = se3.transform(se3.exp_so3([1.2, -0.7, 0.4]), [0.05, -0.08, 0.03])
OFFSET_S = 0.0237
BIASES = np.array([0.01, -0.02, 0.005, 0.1, -0.05, 0.08])
GRAVITY = 9.80665 * np.array([0.05, 0.995, 0.0865]) / np.linalg.norm([0.05, 0.995, 0.0865])
START_NS = 1_700_000_000 * 10**9


def write_motion_folder(path: Path, *, images_hz: float = 10.0, duration_s: float = 6.0) -> None:
    """Write images with times as names, ``imu.csv`` and the calibration of the camera."""
    rng = np.random.default_rng(3)
    motion = BoardMotion.random(BOARD, rng, distance_m=1.5)
    (path / "images").mkdir()
    stamps_ns = stamps_at(images_hz, duration_s, START_NS)
    for stamp, T in zip(stamps_ns, motion.T_camera_board((stamps_ns - START_NS) * 1e-9), strict=True):
        cv2.imwrite(str(path / "images" / f"{stamp}.png"), board_image(CAMERA, BOARD, T, rng, noise=1.0))
    imu_ns = stamps_at(200.0, duration_s + 0.4, START_NS - 200_000_000)
    # The reading with the stamp t is that of the time t + OFFSET_S.
    exact = motion.readings((imu_ns - START_NS) * 1e-9 + OFFSET_S, T_CAMERA_IMU, GRAVITY)
    force, rate = noisy_readings(*exact, rng, rate_hz=200.0, biases=BIASES)
    lines = ["#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y,w_RS_S_z,a_RS_S_x [m s^-2],a_RS_S_y,a_RS_S_z"]
    for stamp, w, a in zip(imu_ns, rate, force, strict=True):
        lines.append(",".join([str(stamp), *(f"{v:.7f}" for v in (*w, *a))]))
    (path / "imu.csv").write_text("\n".join(lines) + "\n")
    document = {
        "image_width": CAMERA.cols,
        "image_height": CAMERA.rows,
        "camera_matrix": CAMERA.matrix.tolist(),
        "distortion_coefficients": list(CAMERA.distortion),
    }
    (path / "camera.yaml").write_text(yaml.safe_dump(document))


def write_motion_log(folder: Path, path: Path) -> None:
    """Write the images and readings of ``write_motion_folder`` to a log of a rover."""
    frames = {"image": "rover/camera", "sample": "rover/imu"}
    samples: list[tuple[int, str, Any]] = []
    for file in (folder / "images").iterdir():
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        stamp_ns = int(file.stem)
        samples.append((stamp_ns, "image", Frame.from_image(np.asarray(image, np.uint8), stamp_ns=stamp_ns)))
    for line in (folder / "imu.csv").read_text().splitlines()[1:]:
        stamp, *values = line.split(",")
        w, a = np.array(values[:3], float), np.array(values[3:], float)
        samples.append((int(stamp), "sample", IMUSensors(Time.from_ns(int(stamp)), a, w, np.zeros(3))))
    with LogWriter(path) as writer:
        for i, (stamp_ns, name, value) in enumerate(sorted(samples, key=lambda sample: sample[0])):
            stream = f"/rover/{'camera' if name == 'image' else 'imu'}.{name}"
            header = Header(
                str(uuid5(NAMESPACE_OID, f"{name}{i}")), i, stamp_ns, stamp_ns, frames[name], "test"
            )
            writer.write(stream, value, stamp_ns, header)
