# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate limits of feature matching: pairs whose second image is changed by increasing amounts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Frame
from cdff_core.imaging.two_view import transfer
from evaluation.data_sets.image_pairs import base_images
from evaluation.feature_matching import CORRECT_PX, make_matcher

#: Page that contains the table of this evaluation.
PAGE = "feature_matching"
ROWS, COLS = 240, 320
#: Change of the second image: unit and amounts.
CHANGES: dict[str, tuple[str, tuple[float, ...]]] = {
    "out-of-plane tilt": ("°", (30, 40, 50, 60, 70)),
    "in-plane rotation": ("°", (45, 90, 180)),
    "distance, factor": ("", (1.5, 2, 3, 4, 6)),
    "noise, sigma": (" DN", (5, 10, 20, 40, 80)),
    "brightness, factor": ("", (0.5, 0.2, 0.1, 0.05)),
    "blur, sigma": (" px", (1, 2, 4, 8)),
    "overlap, fraction": ("", (0.5, 0.3, 0.2, 0.1)),
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the numbers of accepted pairs and correct matches, and the refusal reasons, for each change."""
    cv2.setNumThreads(1)
    dfpc = make_matcher("RootSift")
    images = {name: _window(base) for name, base in base_images(data).items()}
    rows = []
    for change, (unit, amounts) in CHANGES.items():
        for amount in amounts:
            progress(f"feature_matching_limits: {change} {amount:g}")
            views = [_score_view(dfpc, left, *changed_view(left, change, amount)) for left in images.values()]
            answered = [v for v in views if v["matches"]]
            reasons = [v["reason"] for v in views if not v["matches"]]
            rows.append(
                {
                    "change": change,
                    "amount": f"{amount:g}{unit}",
                    "images": len(views),
                    "answered": len(answered),
                    "matches": sum(v["matches"] for v in answered),
                    "correct": sum(v["correct"] for v in answered),
                    "reasons": {r: reasons.count(r) for r in sorted(set(reasons))},
                }
            )
    return {"rows": rows}


def _window(base: NDArray[np.uint8]) -> NDArray[np.uint8]:
    y, x = (base.shape[0] - ROWS) // 2, (base.shape[1] - COLS) // 2
    return np.ascontiguousarray(base[y : y + ROWS, x : x + COLS])


def changed_view(
    left: NDArray[np.uint8], change: str, amount: float
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return the changed image, with 2 DN of noise, and the homography from the original image to it."""
    H, image = np.eye(3), left.astype(np.float64)
    centre = np.array([[1.0, 0.0, -COLS / 2], [0.0, 1.0, -ROWS / 2], [0.0, 0.0, 1.0]])
    if change == "out-of-plane tilt":
        # The image is a plane at this distance (pixels), tilted about the image centre.
        angle, distance_px = np.radians(amount), 1.5 * COLS
        tilt = np.array([[np.cos(angle), 0, 0], [0, 1, 0], [-np.sin(angle) / distance_px, 0, 1]])
        H = np.linalg.inv(centre) @ tilt @ centre
    elif change == "in-plane rotation":
        c, s = np.cos(np.radians(amount)), np.sin(np.radians(amount))
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        H = np.linalg.inv(centre) @ rotation @ centre
    elif change == "distance, factor":
        H = np.linalg.inv(centre) @ np.diag([1.0 / amount, 1.0 / amount, 1.0]) @ centre
    elif change == "overlap, fraction":
        H[0, 2] = -(1.0 - amount) * COLS
    elif change == "brightness, factor":
        image *= amount
    elif change == "blur, sigma":
        image = cv2.GaussianBlur(image, (0, 0), amount)
    if not np.array_equal(H, np.eye(3)):
        smoothed = cv2.GaussianBlur(image, (0, 0), 0.4 * amount) if change == "distance, factor" else image
        image = cv2.warpPerspective(smoothed, H, (COLS, ROWS), flags=cv2.INTER_LINEAR)
    sigma = amount if change == "noise, sigma" else 2.0
    noisy = image + np.random.default_rng(0).normal(0.0, sigma, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), H


def _outputs(dfpc: Any, *images: NDArray[np.uint8]) -> Iterator[Any]:
    dfpc.forget()
    for port, image in zip(("left", "right"), images, strict=True):
        yield from dfpc.step(Sample(port, 0, 0, Frame.from_image(image, stamp_ns=0)))


def _score_view(
    dfpc: Any, left: NDArray[np.uint8], right: NDArray[np.uint8], H: NDArray[np.float64]
) -> dict[str, Any]:
    result = next(o for o in _outputs(dfpc, left, right) if o.port == "matches")
    if result.value is None:
        codes = [reason.split(":")[0] for reason in result.quality.reasons]
        return {"matches": 0, "correct": 0, "reason": codes[-1]}
    errors = np.hypot(*(transfer(H, result.value.sources_px) - result.value.sinks_px).T)
    return {"matches": len(errors), "correct": int((errors <= CORRECT_PX).sum()), "reason": ""}


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each change."""
    lines = [
        "| change of the second image | pairs accepted | correct matches | reasons of refusal |",
        "|---" * 4 + "|",
    ]
    for row in figures["rows"]:
        why = ", ".join(f"`{reason}` {count}" for reason, count in row["reasons"].items())
        lines.append(
            f"| {row['change']} {row['amount']} | {row['answered']} of {row['images']} | "
            f"{row['correct']} of {row['matches']} | {why or '–'} |"
        )
    return "\n".join(lines)
