# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run visual odometry with one degraded pair in the middle, and write the degraded images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from evaluation.runs.traverse import traverse_runs

SCENARIO = "visual_rocks"
PAGE_FOLDER = Path(__file__).resolve().parents[2] / "docs" / "evaluation"
#: Index of the degraded pair, and number of pairs of each run.
_DEGRADED_INDEX, _PAIRS = 6, 9
Image = NDArray[np.uint8]
Pair = tuple[Image, Image]


def _black(pair: Pair, _: Pair) -> Pair:
    return np.zeros_like(pair[0]), np.zeros_like(pair[1])


def _overexposed(pair: Pair, _: Pair) -> Pair:
    left, right = (np.clip(3.5 * image.astype(np.float64), 0, 255).astype(np.uint8) for image in pair)
    return left, right


def _darker(pair: Pair, _: Pair) -> Pair:
    left, right = (np.asarray(0.45 * image, np.uint8) for image in pair)
    return left, right


def _blurred(pair: Pair, _: Pair) -> Pair:
    left, right = (np.asarray(cv2.GaussianBlur(image, None, 2.5), np.uint8) for image in pair)
    return left, right


def _right_frozen(pair: Pair, previous: Pair) -> Pair:
    return pair[0], previous[1]


def _both_frozen(_: Pair, previous: Pair) -> Pair:
    return previous


def _swapped(pair: Pair, _: Pair) -> Pair:
    return pair[1], pair[0]


def _dust(pair: Pair, _: Pair) -> Pair:
    """Cover two thirds of both images."""
    left, right = (image.copy() for image in pair)
    for image in (left, right):
        image[:, : 2 * image.shape[1] // 3] = 90
    return left, right


CASES: dict[str, Callable[[Pair, Pair], Pair]] = {
    "black": _black,
    "overexposed": _overexposed,
    "exposure halved": _darker,
    "blurred": _blurred,
    "right camera frozen": _right_frozen,
    "both cameras frozen": _both_frozen,
    "cameras swapped": _swapped,
    "dust on two thirds": _dust,
}


def gallery(progress: Callable[[str], None], folder: Path = PAGE_FOLDER) -> dict[str, Any]:
    """Write ``visual_odometry_failures.jpg`` (the degraded left images, in order) and return the answers."""
    drive = traverse_runs(SCENARIO, None)[1][0]
    samples = drive.samples({"navcam.pair": "stereo"})
    first_moving = next(
        i for i in range(1, len(samples)) if _has_moved(samples[i - 1].value, samples[i].value)
    )
    samples = samples[first_moving : first_moving + _PAIRS]
    T_base_left = drive.context.frames.lookup(f"{drive.robot}/base", f"{drive.robot}/navcam_left", 0).matrix
    truth = [drive.true_pose(s.stamp_ns) @ T_base_left for s in samples]
    rows, images = [], []
    for name, degrade in CASES.items():
        progress(f"visual odometry: {name}")
        pairs: list[FramePair] = [s.value for s in samples]
        pairs[_DEGRADED_INDEX] = _degraded(pairs[_DEGRADED_INDEX], pairs[_DEGRADED_INDEX - 1], degrade)
        rows.append({"case": name, **_run_case(pairs, samples, truth)})
        images.append(np.array(pairs[_DEGRADED_INDEX].left.image))
    for name, gap in (("1 pair dropped", 1), ("3 pairs dropped", 3)):
        retained = [i for i in range(_PAIRS) if not _DEGRADED_INDEX - gap <= i < _DEGRADED_INDEX]
        retained_samples = [samples[i] for i in retained]
        results = _run_case(
            [s.value for s in retained_samples],
            retained_samples,
            [truth[i] for i in retained],
            retained.index(_DEGRADED_INDEX),
        )
        rows.append({"case": name, **results})
        images.append(np.array(samples[_DEGRADED_INDEX].value.left.image))
    cv2.imwrite(str(folder / "visual_odometry_failures.jpg"), _sheet(images), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return {
        "data": f"{SCENARIO}, {drive.robot}, pairs {first_moving} to {first_moving + _PAIRS - 1}",
        "cases": rows,
    }


def _has_moved(first: FramePair, second: FramePair) -> bool:
    """Return whether two pairs differ by more than noise."""
    a, b = (np.asarray(p.left.image, np.float32) for p in (first, second))
    return float(np.abs(a - b).mean()) > 5.0


def _degraded(pair: FramePair, previous: FramePair, degrade: Callable[[Pair, Pair], Pair]) -> FramePair:
    current_images, previous_images = (
        (np.array(p.left.image), np.array(p.right.image)) for p in (pair, previous)
    )
    return FramePair.from_images(
        *degrade(current_images, previous_images),
        baseline_m=pair.baseline,
        camera_matrix=np.array(pair.left.camera_matrix),
        stamp_ns=pair.stamp_ns,
    )


def _run_case(
    pairs: Sequence[FramePair],
    samples: Sequence[Sample],
    truth: Sequence[NDArray[np.float64]],
    degraded_index: int = _DEGRADED_INDEX,
) -> dict[str, Any]:
    """Return status and reasons of the degraded pair, and status, error and standard deviation of the last
    pose.
    """
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="rover"))
    outputs: list[Output] = []
    for i, (pair, sample) in enumerate(zip(pairs, samples, strict=True)):
        outputs += dfpc.step(Sample("stereo", sample.stamp_ns, i, pair, id=str(i)))
    degraded, last = outputs[degraded_index], outputs[-1]
    row = {
        "status": degraded.quality.status.value,
        "reasons": list(degraded.quality.reasons),
        "status_at_the_end": last.quality.status.value,
    }
    if last.value is not None:
        T = last.value.transform
        error_m = (se3.inverse(truth[0]) @ truth[-1])[:3, 3] - T.matrix[:3, 3]
        row["end_error_mm"] = round(1e3 * float(np.linalg.norm(error_m)), 1)
        row["end_sigma_mm"] = round(1e3 * float(np.sqrt(np.linalg.eigvalsh(T.covariance[:3, :3])[-1])), 1)
    return row


def _sheet(images: Sequence[Image], columns: int = 5) -> Image:
    """Return the images, scaled to a third, as one image of several rows."""
    small = [cv2.resize(p, None, fx=1 / 3, fy=1 / 3, interpolation=cv2.INTER_AREA) for p in images]
    small = [cv2.copyMakeBorder(p, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=255) for p in small]
    blank = np.full_like(small[0], 255)
    small += [blank] * (-len(small) % columns)
    return np.vstack([np.hstack(small[i : i + columns]) for i in range(0, len(small), columns)])
