# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Results of a calibration with a board: text, calibration file, all figures, and pictures."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from cdff_common.arrays import ByteArray
from cdff_common.output import write_file
from cdff_core.calibration.adjustment import COEFFICIENT_NAMES
from cdff_core.calibration.assessment import Assessment, coverage_map, stereo_words
from cdff_core.calibration.rig import RigCalibration

#: Length of a drawn residual per pixel.
_ARROW = 100.0


def lines(result: RigCalibration, assessment: Assessment, images: int) -> Iterator[str]:
    """Yield the result in words."""
    sigma = result.sigma
    corners = sum(len(view.numbers) for view in result.views)
    yield (
        f"{len(result.views)} of {images} images, {corners} corners ({result.dropped} dropped), "
        f"residuals {result.rms_px:.3f} px (RMS)"
    )
    for number, camera in enumerate(result.cameras):
        yield f"camera {number}: {camera.lens}, {camera.cols} x {camera.rows} pixels"
        for name, value in _values(result, number).items():
            digits = 2 if name in ("fx", "fy", "cx", "cy") else 5
            mark = "  not observable" if f"{number}.{name}" in assessment.unobservable else ""
            yield f"  {name:6} {value:11.{digits}f} ± {sigma[f'{number}.{name}']:.{digits}f}{mark}"
    if len(result.cameras) > 1:
        yield stereo_words(result)
    for sentence in assessment.sentences:
        yield f"assessment: {sentence}"


def document(result: RigCalibration, assessment: Assessment, images: int) -> dict[str, Any]:
    """Return all figures as plain data."""
    sigma = result.sigma
    return {
        "cameras": [
            {
                "lens": camera.lens,
                "rows": camera.rows,
                "cols": camera.cols,
                "parameters": {
                    name: {"value": value, "sigma": sigma[f"{number}.{name}"]}
                    for name, value in _values(result, number).items()
                },
                "T_camera_first": result.T_camera_first[number].tolist(),
                "coverage": assessment.coverage[number],
            }
            for number, camera in enumerate(result.cameras)
        ],
        "covariance": {"names": list(result.names), "matrix": result.covariance.tolist()},
        "images": images,
        "views": len(result.views),
        "corners": sum(len(view.numbers) for view in result.views),
        "dropped": result.dropped,
        "rms_px": result.rms_px,
        "sigma_px": result.sigma_px,
        "assessment": {
            "good": assessment.is_good,
            "sentences": list(assessment.sentences),
            "unobservable": list(assessment.unobservable),
        },
    }


def calibration_text(result: RigCalibration) -> str:
    """Return the calibration file in the form of OpenCV, which ``read_camera`` and ``read_stereo`` read."""
    first = result.cameras[0]
    fields: dict[str, Any] = {
        "image_width": first.cols,
        "image_height": first.rows,
        "camera_model": first.lens,
    }
    if len(result.cameras) == 1:
        fields |= {"camera_matrix": first.matrix.tolist(), "distortion_coefficients": list(first.distortion)}
    else:
        T = result.T_camera_first[1]
        for number, camera in enumerate(result.cameras, 1):
            fields |= {f"M{number}": camera.matrix.tolist(), f"D{number}": list(camera.distortion)}
        fields |= {"R": T[:3, :3].tolist(), "T": T[:3, 3].tolist()}
    return yaml.safe_dump(fields, sort_keys=False, default_flow_style=None)


def write_results(folder: Path, result: RigCalibration, assessment: Assessment, images: int) -> None:
    """Write ``calibration.yaml``, ``calibration.json``, and ``coverage_N.png`` and ``residuals_N.png``."""
    folder.mkdir(parents=True, exist_ok=True)
    write_file(folder / "calibration.yaml", calibration_text(result).encode())
    figures = json.dumps(document(result, assessment, images), indent=1, sort_keys=True)
    write_file(folder / "calibration.json", (figures + "\n").encode())
    for number in range(len(result.cameras)):
        for name, picture in (("coverage", coverage_picture), ("residuals", residual_picture)):
            encoded = cv2.imencode(".png", picture(result, number))[1]
            write_file(folder / f"{name}_{number}.png", encoded.tobytes())


def coverage_picture(result: RigCalibration, number: int) -> ByteArray:
    """Return the cells of the image, brighter with more corners, and the corners, ``(rows, cols, 3)``."""
    camera = result.cameras[number]
    counts = coverage_map(result, number)
    levels = np.clip(counts / max(float(np.median(counts[counts > 0])), 1.0), 0.0, 1.0)
    cells = np.rint(levels * 140.0).astype(np.uint8)
    picture = cv2.resize(cells, (camera.cols, camera.rows), interpolation=cv2.INTER_NEAREST)
    picture = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    for view in result.views:
        if view.camera == number:
            for x, y in np.rint(view.pixels).astype(int):
                cv2.circle(picture, (int(x), int(y)), 2, (80, 220, 255), cv2.FILLED)
    return np.asarray(picture)


def residual_picture(result: RigCalibration, number: int) -> ByteArray:
    """Return the residuals as lines, 100 times longer, from the measured corners, ``(rows, cols, 3)``."""
    camera = result.cameras[number]
    picture = np.zeros((camera.rows, camera.cols, 3), np.uint8)
    for view, r in zip(result.views, result.residuals_px, strict=True):
        if view.camera == number:
            starts = np.rint(view.pixels).astype(int)
            ends = np.rint(view.pixels + _ARROW * r).astype(int)
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
                cv2.line(picture, start, end, (80, 220, 255), 1, cv2.LINE_AA)
    return picture


def _values(result: RigCalibration, number: int) -> dict[str, float]:
    camera = result.cameras[number]
    names = ("fx", "fy", "cx", "cy", *COEFFICIENT_NAMES[camera.lens][: len(camera.distortion)])
    return dict(zip(names, (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion), strict=True))
