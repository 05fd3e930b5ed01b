# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare dense disparity with OpenCV's plain SGBM at equal density, on the measured Middlebury pairs.

Density is the fraction of pixels with ground truth, hidden pixels included, that have a disparity. bad-1 and
bad-2 are the fractions of these disparities with an error above 1 and 2 px. The DFN uses the same setting and
search range for all pairs, plain SGBM the search range of each pair. The density of plain SGBM is varied by
its uniqueness ratio; its bad-1 is interpolated at the density of the DFN.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs

#: Name of a pair: grey values per pixel of disparity in its ground truth, search range of plain SGBM, px.
PAIRS = {"tsukuba": (16.0, 16), "teddy": (4.0, 64)}
SEARCH_PX = 64
MATCHERS: dict[str, tuple[str, dict[str, Any]]] = {
    "Sgbm, 3 paths": ("Sgbm", {"paths": 3}),
    "Sgbm, 5 paths (default)": ("Sgbm", {"paths": 5}),
    "Sgbm, 8 paths": ("Sgbm", {"paths": 8}),
    "Sgbm, 3 paths, gaps to 16 px filled": ("Sgbm", {"paths": 3, "fill_px": 16}),
    "Bm": ("Bm", {}),
}
UNIQUENESS_PERCENT = (0, 5, 10, 15, 20, 30, 40, 50, 60, 70, 80)
RUNS = 5


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return density, errors and CPU time of each matcher on each pair."""
    figures: dict[str, Any] = {}
    for name, (scale, range_px) in PAIRS.items():
        progress(f"disparity_image: {name}")
        folder = data / "middlebury" / name
        left, right, truth = (
            cv2.imread(str(folder / f), cv2.IMREAD_GRAYSCALE) for f in ("im2.png", "im6.png", "disp2.png")
        )
        true_px = np.where(truth > 0, truth.astype(np.float64) / scale, np.nan)
        curve = [
            score_disparities(plain(left, right, range_px, ratio), true_px) for ratio in UNIQUENESS_PERCENT
        ]
        default_sgbm = curve[UNIQUENESS_PERCENT.index(10)]
        pair: dict[str, Any] = {"pixels": int(np.isfinite(true_px).sum()), "plain SGBM": default_sgbm}
        for label, (implementation, config) in MATCHERS.items():
            node = Registry.default().make_dfn("disparity_image", implementation)
            node.configure({"num_disparities": SEARCH_PX, **config})
            images = DisparityImageInputs(
                left=Frame.from_image(left, stamp_ns=0, mode="GRAY"),
                right=Frame.from_image(right, stamp_ns=0, mode="GRAY"),
            )
            started = time.process_time()
            for _ in range(RUNS):
                disparity = node.process(images).disparity.image
            cpu_s = (time.process_time() - started) / RUNS
            score = score_disparities(disparity, true_px)
            pair[label] = score | {
                "plain_bad_1_percent": at_density(curve, score["density_percent"]),
                "cpu_s": round(cpu_s, 3),
            }
        figures[name] = pair
    return figures


def plain(left: np.ndarray, right: np.ndarray, range_px: int, uniqueness_percent: int) -> FloatArray:
    """Return the disparities of OpenCV's plain SGBM, px; NaN if unmatched."""
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=range_px,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=uniqueness_percent,
        speckleWindowSize=100,
        speckleRange=32,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    result = matcher.compute(left, right)
    return np.where(result >= 0, result / 16.0, np.nan)


def score_disparities(disparity: FloatArray, true_px: FloatArray) -> dict[str, float]:
    """Return density, bad-1 and bad-2 in percent, and the mean of the errors up to 1 px."""
    known = np.isfinite(true_px)
    errors_px = np.abs(disparity - true_px)[known & np.isfinite(disparity)]
    return {
        "density_percent": round(100.0 * errors_px.size / known.sum(), 2),
        "bad_1_percent": round(100.0 * float(np.mean(errors_px > 1.0)), 2),
        "bad_2_percent": round(100.0 * float(np.mean(errors_px > 2.0)), 2),
        "mean_within_1_px": round(float(errors_px[errors_px <= 1.0].mean()), 3),
    }


def at_density(curve: list[dict[str, float]], density_percent: float) -> float | None:
    """Return bad-1 of a curve at a density, percent; None if the curve does not reach this density."""
    points = sorted((score["density_percent"], score["bad_1_percent"]) for score in curve)
    densities = [d for d, _ in points]
    if not densities[0] <= density_percent <= densities[-1]:
        return None
    return round(float(np.interp(density_percent, densities, [b for _, b in points])), 2)


def table(figures: dict[str, Any]) -> str:
    """Return the table of densities, errors and CPU times."""
    lines = [
        "| pair | matcher | density % | bad-1 % | bad-2 % | bad-1 of plain SGBM at this density % | CPU s |",
        "|---|---|---|---|---|---|---|",
    ]
    for pair, entries in figures.items():
        for name, score in entries.items():
            if name == "pixels":
                continue
            plain_bad_1 = score.get("plain_bad_1_percent", "")
            lines.append(
                f"| {pair} | {name} | {score['density_percent']} | {score['bad_1_percent']} | "
                f"{score['bad_2_percent']} | "
                f"{'density not reached' if plain_bad_1 is None else plain_bad_1} | "
                f"{score.get('cpu_s', '')} |"
            )
    return "\n".join(lines) + "\n"
