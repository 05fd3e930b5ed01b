# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU times of the image DFNs on a 1920 x 1200 image, and of the corresponding OpenCV calls.

python benchmarks/imaging.py [--out FILE] [--rounds N]
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import median_cpu_s, write_report

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair
from cdff_core.dfns.background_subtraction.interface import BackgroundSubtractionInputs
from cdff_core.dfns.color_conversion.interface import ColorConversionInputs
from cdff_core.dfns.image_degradation.interface import ImageDegradationInputs
from cdff_core.dfns.image_filtering.interface import ImageFilteringInputs
from cdff_core.dfns.image_undistortion.interface import ImageUndistortionInputs
from cdff_core.dfns.stereo_degradation.interface import StereoDegradationInputs
from cdff_core.dfns.stereo_rectification.interface import StereoRectificationInputs

ROWS, COLS, SEED = 1200, 1920, 1
K = np.array([[1069.0, 0.0, 957.0], [0.0, 1071.0, 621.0], [0.0, 0.0, 1.0]])
D = (-0.22, 0.06, -3.5e-4, -1.5e-4)


def frame(image: np.ndarray, mode: str = "GRAY", x_m: float = 0.0) -> Frame:
    """Return an image with its camera, whose lens is distorted and which is ``x_m`` to the right of the
    robot.
    """
    T_robot_camera = UncertainTransform.exact(
        se3.transform(se3.exp_so3([0.0, 0.01 * x_m, 0.0]), [x_m, 0.0, 0.0])
    )
    return Frame.from_image(
        image,
        stamp_ns=0,
        mode=mode,
        camera_matrix=K,
        dist_coeffs=D,
        sensor="rover/camera",
        T_robot_sensor=T_robot_camera,
    )


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=15)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(SEED)
    grey = cv2.GaussianBlur(rng.integers(0, 256, (ROWS, COLS), dtype=np.uint8), (0, 0), 2.0)
    grey_frame, colour_frame = frame(grey), frame(np.dstack([grey] * 3), "RGB")
    pair = FramePair(baseline=0.27, left=grey_frame, right=frame(grey, x_m=0.27))
    maps = cv2.initUndistortRectifyMap(K, np.array(D), None, K, (COLS, ROWS), cv2.CV_16SC2)

    def half_size() -> Any:
        return cv2.resize(grey, (960, 600), interpolation=cv2.INTER_AREA)

    cases: list[tuple[str, str | None, dict[str, Any], Any, Callable[[], Any] | None]] = [
        (
            "image_undistortion",
            None,
            {},
            ImageUndistortionInputs(image=grey_frame),
            lambda: cv2.remap(grey, *maps, 1),
        ),
        ("stereo_rectification", None, {}, StereoRectificationInputs(pair=pair), None),
        ("image_degradation", None, {}, ImageDegradationInputs(image=grey_frame), half_size),
        ("stereo_degradation", None, {}, StereoDegradationInputs(pair=pair), None),
        (
            "color_conversion",
            None,
            {},
            ColorConversionInputs(image=colour_frame),
            lambda: cv2.cvtColor(colour_frame.image, 7),
        ),
        ("background_subtraction", None, {}, BackgroundSubtractionInputs(image=grey_frame), None),
    ]
    registry = Registry.default()
    cases += [
        ("image_filtering", name, {}, ImageFilteringInputs(image=grey_frame), None)
        for name in registry.dfn("image_filtering").implementations
    ]
    report: dict[str, Any] = {
        "benchmark": "imaging",
        "python": platform.python_version(),
        "image": f"{COLS}x{ROWS}",
    }
    for name, implementation, config, inputs, peer in cases:
        node = registry.make_dfn(name, implementation)
        node.configure(config)
        started = time.process_time()
        node.process(inputs)
        row = {"first_cpu_s": time.process_time() - started}
        row["cpu_s"] = median_cpu_s(lambda n=node, i=inputs: n.process(i), args.rounds)
        if peer is not None:
            row["bare_opencv_cpu_s"] = median_cpu_s(peer, args.rounds)
        report[f"{name}/{implementation}" if implementation else name] = row
    write_report(report, args.out)


if __name__ == "__main__":
    main()
