# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Feature matching: hand-marked points, measured disparities, warped views, images of nothing in common; beside COLMAP.

A known place is found where a match has both its ends within 5 px of the truth; a match is right within 3 px. Warped
views are simulated from measured images. COLMAP sees the same images where CDFF_PEER_PYTHON names an environment that
has pycolmap.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_dev.evaluate import _colmap
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.evaluate._image_pairs import ImagePair, bases, marked_dlr, middlebury, truth_of, warped
from cdff_dev.evaluate._peers import peer_python
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import in_words, interval

Float = NDArray[np.float64]
VARIANTS = ("RootSift", "Sift", "Orb", "FastGrid", "GfttKlt")
#: Those that warped views and strange images are shown to: KLT is for views that hardly differ.
TURNED = VARIANTS[:4]
VIEWS, STRANGERS = 500, 500
#: Views that the other variants are shown, and size of all views, pixels.
FEWER, SIZE = 100, (320, 240)
FOUND_PX, RIGHT_PX = 5.0, 3.0


def evaluate(
    data: Path,
    progress: Callable[[str], None],
    trials: int = VIEWS,
    others: int = STRANGERS,
) -> dict[str, Any]:
    """Figures of measured pairs, of warped views, and of strange images."""
    cv2.setNumThreads(1)
    measured = [marked_dlr(data), middlebury(data, "teddy"), middlebury(data, "tsukuba")]
    views = [warped(name, base, seed, SIZE) for seed, (name, base) in _drawn(data, trials)]
    apart = strangers(data, others)
    figures: dict[str, Any] = {"measured_pairs": {}, "warped_views": {}, "nothing_in_common": {}}
    for pair in measured:
        progress(f"feature_matching: {pair.name}")
        rows = {name: _judged(data, pair, *matched(made(name), pair.left, pair.right)) for name in VARIANTS}
        figures["measured_pairs"][pair.name] = rows
    for name in TURNED:
        progress(f"feature_matching: warped views, {name}")
        dfpc, shown = made(name), views if name == VARIANTS[0] else views[:FEWER]
        figures["warped_views"][name] = _pooled([_judged(data, v, *matched(dfpc, v.left, v.right)) for v in shown])
        if name == VARIANTS[0]:
            answered = sum(len(matched(dfpc, *images)[0]) > 0 for images in apart)
            figures["nothing_in_common"][name] = {"answered": interval(answered, len(apart))}
    peer = peer_python()
    if peer:
        progress("feature_matching: COLMAP")
        found = _colmap.matches(peer, [(p.left, p.right) for p in (*measured, *views)])
        for pair, answer in zip(measured, found, strict=False):
            figures["measured_pairs"][pair.name]["colmap_sift"] = _judged(data, pair, *answer)
        of_views = [_judged(data, v, *answer) for v, answer in zip(views, found[len(measured) :], strict=True)]
        figures["warped_views"]["colmap_sift"] = _pooled(of_views)
        answers = [len(m) > 0 for m, _ in _colmap.matches(peer, apart)]
        figures["nothing_in_common"]["colmap_sift"] = {"answered": interval(sum(answers), len(answers))}
    return figures


def _drawn(data: Path, trials: int) -> list[tuple[int, tuple[str, Any]]]:
    images = list(bases(data).items())
    return [(seed, images[seed % len(images)]) for seed in range(trials)]


def strangers(data: Path, trials: int) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Windows of 240 x 180 pixels of images of different scenes."""
    views = [warped(name, base, seed, (240, 180)) for seed, (name, base) in _drawn(data, trials)]
    return [(views[i].left, views[(i + 1) % trials].right) for i in range(trials)]


def made(implementation: str) -> Dfpc:
    """The DFPC with the defaults of a variant."""
    dfpc = Registry.default().make_dfpc("feature_matching")
    dfpc.configure(implementation=implementation)
    return dfpc


def matched(dfpc: Any, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[Float, float]:
    """Matches ``x0 y0 x1 y1 (n, 4)``, none where it failed, and CPU seconds."""
    dfpc.forget()
    started = time.process_time()
    outputs = [
        output
        for port, image in (("left", left), ("right", right))
        for output in dfpc.step(Sample(port, 0, 0, Frame.from_image(image, stamp_ns=0)))
    ]
    cpu_s = time.process_time() - started
    value = next((o.value for o in outputs if o.port == "matches" and o.value is not None), None)
    return np.zeros((0, 4)) if value is None else np.hstack([value.sources_px, value.sinks_px]), cpu_s


def _judged(data: Path, pair: ImagePair, matches: Float, cpu_s: float) -> dict[str, Any]:
    """Known places that were found; right matches; CPU seconds."""
    near = np.full(len(pair.points), np.inf)
    for i, (point, partner) in enumerate(zip(pair.points, pair.partners, strict=True)):
        errors = np.maximum(np.hypot(*(matches[:, :2] - point).T), np.hypot(*(matches[:, 2:] - partner).T))
        near[i] = errors.min(initial=np.inf)
    row: dict[str, Any] = {"places": len(near), "found": int((near <= FOUND_PX).sum()), "matches": len(matches)}
    if pair.name != "dlr_mock_up":
        errors = np.hypot(*(truth_of(pair, data, matches[:, :2]) - matches[:, 2:]).T)
        known = np.isfinite(errors)
        row |= {"judged": int(known.sum()), "right": int((errors[known] <= RIGHT_PX).sum())}
        row["median_error_px"] = round(float(np.median(errors[known])), 3) if known.any() else None
    else:
        row["error_px"] = [round(float(e), 2) if np.isfinite(e) else None for e in near]
    return row | {"cpu_s": round(cpu_s, 3)}


def _pooled(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "views": len(rows), "recall": _share(rows, "found", "places"), "precision": _share(rows, "right", "judged"),
        "matches_a_view": sum(row["matches"] for row in rows) / len(rows),
        "views_answered": interval(sum(row["matches"] > 0 for row in rows), len(rows)),
        "median_error_px": spread([row["median_error_px"] for row in rows if row["median_error_px"] is not None], 3),
        "cpu_s": spread([row["cpu_s"] for row in rows], 3),
    }  # fmt: skip


def _share(rows: list[dict[str, Any]], part: str, whole: str) -> dict[str, float]:
    """Share over all views with its 95 % interval; places of one view depend on each other, views do not."""
    parts, wholes = (np.array([row[key] for row in rows], np.float64) for key in (part, whole))
    total = max(float(wholes.sum()), 1.0)
    rate = float(parts.sum()) / total
    half = 1.96 * float(np.sqrt(((parts - rate * wholes) ** 2).sum())) / total
    share = {"rate": rate, "low": max(rate - half, 0.0), "high": min(rate + half, 1.0)}
    return {key: round(value, 5) for key, value in share.items()} | {"count": int(parts.sum()), "trials": int(total)}


def draw(figures: dict[str, Any]) -> bytes:
    """Recall and precision on warped views with their intervals, and CPU time."""
    rows = figures["warped_views"]

    def percent(key: str) -> dict[str, list[Bar | None]]:
        return {m: [(100 * r[key]["rate"], 100 * r[key]["low"], 100 * r[key]["high"])] for m, r in rows.items()}

    cpu: dict[str, list[Bar | None]] = {
        m: [(r["cpu_s"]["median"], r["cpu_s"]["min"], r["cpu_s"]["p95"])] for m, r in rows.items()
    }
    top = max(r["cpu_s"]["p95"] for r in rows.values())
    return chart(
        [
            Panel("known places found within 5 px, %", ["warped views"], percent("recall"), 100.0),
            Panel("matches right within 3 px, %", ["warped views"], percent("precision"), 100.0),
            Panel("CPU s a pair: median, least, 95 %", ["warped views"], cpu, 1.1 * top),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Measured pairs, warped views, strange images."""
    lines = ["| measured pair | method | known places found | right matches | median error | CPU s |", "|---" * 6 + "|"]
    for pair, rows in figures["measured_pairs"].items():
        for name, row in rows.items():
            right = f"{row['right']} of {row['judged']}" if "right" in row else f"{row['matches']} matches"
            error = f"{row['median_error_px']} px" if "right" in row else ", ".join(f"{e} px" for e in row["error_px"])
            lines.append(
                f"| {pair.replace('_', ' ')} | {name} | {row['found']} of {row['places']} | {right} | {error} | "
                f"{row['cpu_s']:.2f} |"
            )
    lines += [
        "",
        "| simulated | method | known places found | matches right | a view | CPU s | strangers answered |",
    ]
    lines.append("|---" * 7 + "|")
    apart = figures["nothing_in_common"]
    for name, row in figures["warped_views"].items():
        lines.append(
            f"| {row['views']} warped | {name} | {in_words(row['recall'])} | {in_words(row['precision'])} | "
            f"{row['matches_a_view']:.0f} | {row['cpu_s']['median']:.2f} | "
            f"{in_words(apart[name]['answered']) if name in apart else '–'} |"
        )
    return "\n".join(lines)
