# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of a camera calibration in words, with the images that would improve it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import COEFFICIENT_NAMES
from cdff_core.calibration.rig import RigCalibration

#: Columns and rows of the coverage map.
CELLS = (8, 6)
#: Limits of a good calibration: relative standard deviation of the focal length, principal point (px), RMS
#: (px), covered part of the cells, number of views, and spread of the tilts of the board (degrees).
_FOCAL, _CENTRE_PX, _RMS_PX, _COVERED, _VIEWS, _TILT_DEG = 0.002, 1.0, 0.5, 0.7, 10, 15.0
#: Standard deviation of the distortion at the edge of the image, pixels, above which a coefficient is not
#: observable.
_EFFECT_PX = 1.0


@dataclass(frozen=True, slots=True)
class Assessment:
    """Assessment of a calibration.

    Attributes
    ----------
    is_good : bool
        True if no limit is exceeded.
    sentences : tuple of str
        Exceeded limits, each with the remedy; one sentence if there is none.
    unobservable : tuple of str
        Coefficients that the images do not determine, as named by the calibration.
    coverage : tuple of float
        Part of the image in which corners were seen, for each camera.
    """

    is_good: bool
    sentences: tuple[str, ...]
    unobservable: tuple[str, ...]
    coverage: tuple[float, ...]


def judged(result: RigCalibration) -> Assessment:
    """Return the assessment of a calibration."""
    sentences: list[str] = []
    unobservable: list[str] = []
    coverage = []
    for number in range(len(result.cameras)):
        prefix = f"camera {number}: " if len(result.cameras) > 1 else ""
        sentences += [prefix + sentence for sentence in _of_camera(result, number)]
        missing = _unobservable(result, number)
        unobservable += [f"{number}.{name}" for name in missing]
        if missing:
            verb = "is" if len(missing) == 1 else "are"
            sentences.append(
                f"{prefix}{', '.join(missing)} {verb} not observable: move the board into the corners of the "
                "image, or use a lens model with fewer coefficients"
            )
        coverage.append(float((coverage_map(result, number) > 0).mean()))
    if not sentences:
        sentences = ["good: all parameters are determined"]
        return Assessment(True, tuple(sentences), (), tuple(coverage))
    return Assessment(False, tuple(sentences), tuple(unobservable), tuple(coverage))


def coverage_map(result: RigCalibration, camera: int) -> FloatArray:
    """Return the number of corners in each cell of the image of a camera, ``(CELLS[1], CELLS[0])``."""
    model = result.cameras[camera]
    pixels = np.concatenate([v.pixels for v in result.views if v.camera == camera])
    counts, _, _ = np.histogram2d(
        pixels[:, 1],
        pixels[:, 0],
        bins=CELLS[::-1],
        range=[[-0.5, model.rows - 0.5], [-0.5, model.cols - 0.5]],
    )
    return np.asarray(counts)


def _of_camera(result: RigCalibration, number: int) -> Iterator[str]:
    """Yield a sentence for each limit that a camera exceeds."""
    sigma = result.sigma
    views = [v for v in result.views if v.camera == number]
    residuals = [r for r, v in zip(result.residuals_px, result.views, strict=True) if v.camera == number]
    rms_px = float(np.sqrt((np.concatenate(residuals) ** 2).sum(axis=1).mean()))
    if len(views) < _VIEWS:
        yield f"{len(views)} images show the board: take at least {_VIEWS}"
    if rms_px > _RMS_PX:
        yield (
            f"the residuals are {rms_px:.2f} px (RMS): check that the board is flat and its size right, and "
            "avoid motion blur"
        )
    normals = np.array([result.T_first_board[v.board][:3, 2] for v in views])
    mean = normals.mean(axis=0)
    tilts_deg = np.rad2deg(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1.0, 1.0)))
    focal = _relative_focal_sigma(result, number)
    if np.sqrt((tilts_deg**2).mean()) < _TILT_DEG or focal > _FOCAL:
        yield (
            f"the focal length has a standard deviation of {100 * focal:.2f} %, and the board was tilted by "
            f"{np.sqrt((tilts_deg**2).mean()):.0f} degrees (RMS): tilt the board more, about both axes"
        )
    centre_px = max(sigma[f"{number}.cx"], sigma[f"{number}.cy"])
    if centre_px > _CENTRE_PX:
        yield (
            f"the principal point has a standard deviation of {centre_px:.1f} px: rotate the board by 90 "
            "degrees in some images, and tilt it about both axes"
        )
    is_seen = coverage_map(result, number) > 0
    if is_seen.mean() < _COVERED:
        yield (
            f"the board covers {100 * is_seen.mean():.0f} % of the image: move it into the "
            f"{_emptiest(is_seen)} part"
        )


def _relative_focal_sigma(result: RigCalibration, number: int) -> float:
    """Return the relative standard deviation of the focal length near the axis, the larger of both axes.

    It is ``fx / (1 + xi)`` for an omnidirectional lens, and ``fx`` for the other lenses.
    """
    camera = result.cameras[number]
    sigmas = []
    for name, focal in (("fx", camera.fx), ("fy", camera.fy)):
        gradient = np.zeros(len(result.names))
        gradient[result.names.index(f"{number}.{name}")] = 1.0 / focal
        if camera.lens == "omnidirectional":
            gradient[result.names.index(f"{number}.xi")] = -1.0 / (1.0 + camera.distortion[0])
        sigmas.append(float(np.sqrt(gradient @ result.covariance @ gradient)))
    return max(sigmas)


def _emptiest(is_seen: BoolArray) -> str:
    """Return the name of the quarter of the image with the fewest covered cells."""
    half_rows, half_cols = is_seen.shape[0] // 2, is_seen.shape[1] // 2
    quarters = {
        f"{vertical} {horizontal}": is_seen[rows, cols].mean()
        for vertical, rows in (("upper", slice(None, half_rows)), ("lower", slice(half_rows, None)))
        for horizontal, cols in (("left", slice(None, half_cols)), ("right", slice(half_cols, None)))
    }
    return min(quarters, key=lambda name: float(quarters[name]))


def _unobservable(result: RigCalibration, number: int) -> list[str]:
    """Return the coefficients without which the distortion at the edge of the image is determined.

    Coefficients of high order are tried first: their errors compensate each other, so that a large standard
    deviation of one coefficient alone is no evidence.
    """
    camera = result.cameras[number]
    edge = np.array(
        [[x, y] for x in (0.0, camera.cols - 1.0) for y in (0.0, camera.rows / 2, camera.rows - 1.0)]
    )
    rays = camera.rays(edge)
    rays = rays[np.isfinite(rays).all(axis=1)]
    names = COEFFICIENT_NAMES[camera.lens][: len(camera.distortion)]
    if not len(rays) or not names:
        return []
    columns = []
    for k in range(len(names)):
        step = max(1e-6, 1e-6 * abs(camera.distortion[k]))
        changed = list(camera.distortion)
        changed[k] += step
        moved = replace(camera, distortion=tuple(changed)).project(rays) - camera.project(rays)
        columns.append(np.nan_to_num(moved.reshape(-1) / step))
    J = np.column_stack(columns)
    rows = [result.names.index(f"{number}.{name}") for name in names]
    covariance = result.covariance[np.ix_(rows, rows)]
    order = sorted(range(len(names)), key=lambda k: (names[k][0] != "p", k))
    missing: list[str] = []
    while order:
        kept = sorted(order)
        fixed = [k for k in range(len(names)) if k not in kept]
        conditional = covariance[np.ix_(kept, kept)]
        if fixed:
            cross = covariance[np.ix_(kept, fixed)]
            conditional = conditional - cross @ np.linalg.pinv(covariance[np.ix_(fixed, fixed)]) @ cross.T
        effect_px = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", J[:, kept], conditional, J[:, kept]), 0.0))
        if effect_px.max() <= _EFFECT_PX:
            break
        missing.append(names[order.pop()])
    return missing


def stereo_words(result: RigCalibration) -> str:
    """Return baseline and rotation of the second camera with their standard deviations."""
    T, sigma = result.T_camera_first[1], result.sigma
    baseline = float(np.linalg.norm(T[:3, 3]))
    direction = T[:3, 3] / baseline
    rows = [result.names.index(f"1.{axis}") for axis in "xyz"]
    sigma_m = float(np.sqrt(direction @ result.covariance[np.ix_(rows, rows)] @ direction))
    angle = float(np.rad2deg(se3.rotation_angle(T[:3, :3])))
    sigma_deg = float(np.rad2deg(max(sigma[f"1.r{axis}"] for axis in "xyz")))
    return f"baseline {baseline:.5f} ± {sigma_m:.5f} m, rotation {angle:.3f} ± {sigma_deg:.3f}°"
