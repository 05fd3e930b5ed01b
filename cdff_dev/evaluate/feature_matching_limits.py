# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where feature matching ends: views of measured images changed in one way, more and more, until none is answered."""

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
from cdff_dev.evaluate._image_pairs import bases
from cdff_dev.evaluate.feature_matching import RIGHT_PX, made

#: The tables stand in the page of the DFPC.
PAGE = "feature_matching"
ROWS, COLS = 240, 320
#: What is changed, its unit, and how far.
CHANGES: dict[str, tuple[str, tuple[float, ...]]] = {
    "tilt out of the plane": ("°", (30, 40, 50, 60, 70)),
    "turn in the plane": ("°", (45, 90, 180)),
    "farther, times": ("", (1.5, 2, 3, 4, 6)),
    "noise, sigma": (" DN", (5, 10, 20, 40, 80)),
    "light, share": ("", (0.5, 0.2, 0.1, 0.05)),
    "blur, sigma": (" px", (1, 2, 4, 8)),
    "overlap, share": ("", (0.5, 0.3, 0.2, 0.1)),
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Of every change: how many of the images were answered, how many matches were right, and why not."""
    cv2.setNumThreads(1)
    dfpc = made("RootSift")
    images = {name: _window(base) for name, base in bases(data).items()}
    rows = []
    for change, (unit, amounts) in CHANGES.items():
        for amount in amounts:
            progress(f"feature_matching_limits: {change} {amount:g}")
            views = [_judged(dfpc, left, *changed(left, change, amount)) for left in images.values()]
            answered = [v for v in views if v["matches"]]
            reasons = [v["reason"] for v in views if not v["matches"]]
            rows.append(
                {
                    "change": change, "amount": f"{amount:g}{unit}", "images": len(views), "answered": len(answered),
                    "matches": sum(v["matches"] for v in answered), "right": sum(v["right"] for v in answered),
                    "reasons": {r: reasons.count(r) for r in sorted(set(reasons))},
                }
            )  # fmt: skip
    return {"rows": rows}


def _window(base: NDArray[np.uint8]) -> NDArray[np.uint8]:
    y, x = (base.shape[0] - ROWS) // 2, (base.shape[1] - COLS) // 2
    return np.ascontiguousarray(base[y : y + ROWS, x : x + COLS])


def changed(left: NDArray[np.uint8], change: str, amount: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """The image changed, with 2 DN of noise, and the homography from the given one to it."""
    H, image = np.eye(3), left.astype(np.float64)
    centre = np.array([[1.0, 0.0, -COLS / 2], [0.0, 1.0, -ROWS / 2], [0.0, 0.0, 1.0]])
    if change == "tilt out of the plane":
        a, far = np.radians(amount), 1.5 * COLS  # a plane that far, in its own pixels, turned about its middle
        H = np.linalg.inv(centre) @ np.array([[np.cos(a), 0, 0], [0, 1, 0], [-np.sin(a) / far, 0, 1]]) @ centre
    elif change == "turn in the plane":
        a = np.radians(amount)
        turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
        H = np.linalg.inv(centre) @ turn @ centre
    elif change == "farther, times":
        H = np.linalg.inv(centre) @ np.diag([1.0 / amount, 1.0 / amount, 1.0]) @ centre
    elif change == "overlap, share":
        H[0, 2] = -(1.0 - amount) * COLS
    elif change == "light, share":
        image *= amount
    elif change == "blur, sigma":
        image = cv2.GaussianBlur(image, (0, 0), amount)
    if not np.array_equal(H, np.eye(3)):
        shrunk = cv2.GaussianBlur(image, (0, 0), 0.4 * amount) if change == "farther, times" else image
        image = cv2.warpPerspective(shrunk, H, (COLS, ROWS), flags=cv2.INTER_LINEAR)
    sigma = amount if change == "noise, sigma" else 2.0
    noisy = image + np.random.default_rng(0).normal(0.0, sigma, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), H


def _outputs(dfpc: Any, *images: NDArray[np.uint8]) -> Iterator[Any]:
    dfpc.forget()
    for port, image in zip(("left", "right"), images, strict=True):
        yield from dfpc.step(Sample(port, 0, 0, Frame.from_image(image, stamp_ns=0)))


def _judged(dfpc: Any, left: NDArray[np.uint8], right: NDArray[np.uint8], H: NDArray[np.float64]) -> dict[str, Any]:
    found = next(o for o in _outputs(dfpc, left, right) if o.port == "matches")
    if found.value is None:
        codes = [reason.split(":")[0] for reason in found.quality.reasons]
        return {"matches": 0, "right": 0, "reason": codes[-1]}
    errors = np.hypot(*(transfer(H, found.value.sources_px) - found.value.sinks_px).T)
    return {"matches": len(errors), "right": int((errors <= RIGHT_PX).sum()), "reason": ""}


def table(figures: dict[str, Any]) -> str:
    """One line a change."""
    lines = [
        "| the second image has | images answered | right matches | why the others were refused |",
        "|---" * 4 + "|",
    ]
    for row in figures["rows"]:
        why = ", ".join(f"`{reason}` {count}" for reason, count in row["reasons"].items())
        lines.append(
            f"| {row['change']} {row['amount']} | {row['answered']} of {row['images']} | "
            f"{row['right']} of {row['matches']} | {why or '–'} |"
        )
    return "\n".join(lines)
