# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare feature matching with COLMAP on measured pairs, warped views and unrelated images.

A known point is matched if both ends of a match are within 5 px of its true positions. A match is correct if
it is within 3 px. Warped views are simulated from measured images. COLMAP processes the same images if
CDFF_PEER_PYTHON names an environment with pycolmap.
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
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import interval, rate_text
from evaluation.chart import Bar, Panel, chart
from evaluation.data_sets.image_pairs import ImagePair, base_images, marked_dlr, middlebury, truth_of, warped
from evaluation.peers import colmap
from evaluation.peers.environments import peer_python

Float = NDArray[np.float64]
VARIANTS = ("RootSift", "Sift", "Orb", "FastGrid", "GfttKlt")
#: Variants for warped views and unrelated images; KLT is for views that differ little.
WIDE_VARIANTS = VARIANTS[:4]
VIEWS, UNRELATED_PAIRS = 500, 500
#: Number of views for variants other than the default, and size of all views, pixels.
FEWER_VIEWS, SIZE = 100, (320, 240)
MATCHED_PX, CORRECT_PX = 5.0, 3.0


def evaluate(
    data: Path,
    progress: Callable[[str], None],
    trials: int = VIEWS,
    unrelated: int = UNRELATED_PAIRS,
) -> dict[str, Any]:
    """Return the results on measured pairs, warped views and unrelated images."""
    cv2.setNumThreads(1)
    measured = [marked_dlr(data), middlebury(data, "teddy"), middlebury(data, "tsukuba")]
    views = [warped(name, base, seed, SIZE) for seed, (name, base) in _select_images(data, trials)]
    other_scenes = unrelated_pairs(data, unrelated)
    figures: dict[str, Any] = {"measured_pairs": {}, "warped_views": {}, "unrelated_pairs": {}}
    for pair in measured:
        progress(f"feature_matching: {pair.name}")
        rows = {
            name: _score_matches(data, pair, *match_images(make_matcher(name), pair.left, pair.right))
            for name in VARIANTS
        }
        figures["measured_pairs"][pair.name] = rows
    for name in WIDE_VARIANTS:
        progress(f"feature_matching: warped views, {name}")
        dfpc, selected = make_matcher(name), views if name == VARIANTS[0] else views[:FEWER_VIEWS]
        figures["warped_views"][name] = _combine(
            [_score_matches(data, v, *match_images(dfpc, v.left, v.right)) for v in selected]
        )
        if name == VARIANTS[0]:
            answered = sum(len(match_images(dfpc, *images)[0]) > 0 for images in other_scenes)
            figures["unrelated_pairs"][name] = {"answered": interval(answered, len(other_scenes))}
    peer = peer_python()
    if peer:
        progress("feature_matching: COLMAP")
        result = colmap.matches(peer, [(p.left, p.right) for p in (*measured, *views)])
        for pair, answer in zip(measured, result, strict=False):
            figures["measured_pairs"][pair.name]["colmap_sift"] = _score_matches(data, pair, *answer)
        view_rows = [
            _score_matches(data, v, *answer) for v, answer in zip(views, result[len(measured) :], strict=True)
        ]
        figures["warped_views"]["colmap_sift"] = _combine(view_rows)
        answers = [len(m) > 0 for m, _ in colmap.matches(peer, other_scenes)]
        figures["unrelated_pairs"]["colmap_sift"] = {"answered": interval(sum(answers), len(answers))}
    return figures


def _select_images(data: Path, trials: int) -> list[tuple[int, tuple[str, Any]]]:
    images = list(base_images(data).items())
    return [(seed, images[seed % len(images)]) for seed in range(trials)]


def unrelated_pairs(data: Path, trials: int) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Return pairs of windows of 240 x 180 pixels from images of different scenes."""
    views = [warped(name, base, seed, (240, 180)) for seed, (name, base) in _select_images(data, trials)]
    return [(views[i].left, views[(i + 1) % trials].right) for i in range(trials)]


def make_matcher(implementation: str, **slots: dict[str, float]) -> Dfpc:
    """Return the DFPC with an implementation, and default parameters except those of the given slots."""
    dfpc = Registry.default().make_dfpc("feature_matching")
    dfpc.configure(slots, implementation=implementation)
    return dfpc


def match_images(dfpc: Any, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[Float, float]:
    """Return the matches ``x0 y0 x1 y1 (n, 4)`` and CPU seconds; n is 0 if the result is FAILED."""
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


def _score_matches(data: Path, pair: ImagePair, matches: Float, cpu_s: float) -> dict[str, Any]:
    """Return the numbers of matched known points and of correct matches, and CPU seconds."""
    nearest_px = np.full(len(pair.points), np.inf)
    for i, (point, partner) in enumerate(zip(pair.points, pair.partners, strict=True)):
        errors = np.maximum(np.hypot(*(matches[:, :2] - point).T), np.hypot(*(matches[:, 2:] - partner).T))
        nearest_px[i] = errors.min(initial=np.inf)
    row: dict[str, Any] = {
        "known_points": len(nearest_px),
        "matched": int((nearest_px <= MATCHED_PX).sum()),
        "matches": len(matches),
    }
    if pair.name != "dlr_mock_up":
        errors = np.hypot(*(truth_of(pair, data, matches[:, :2]) - matches[:, 2:]).T)
        known = np.isfinite(errors)
        row |= {"evaluated": int(known.sum()), "correct": int((errors[known] <= CORRECT_PX).sum())}
        row["median_error_px"] = round(float(np.median(errors[known])), 3) if known.any() else None
    else:
        row["error_px"] = [round(float(e), 2) if np.isfinite(e) else None for e in nearest_px]
    return row | {"cpu_s": round(cpu_s, 3)}


def _combine(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "views": len(rows),
        "recall": _fraction(rows, "matched", "known_points"),
        "precision": _fraction(rows, "correct", "evaluated"),
        "matches_per_view": sum(row["matches"] for row in rows) / len(rows),
        "views_answered": interval(sum(row["matches"] > 0 for row in rows), len(rows)),
        "median_error_px": error_summary(
            [row["median_error_px"] for row in rows if row["median_error_px"] is not None], 3
        ),
        "cpu_s": error_summary([row["cpu_s"] for row in rows], 3),
    }


def _fraction(rows: list[dict[str, Any]], count_key: str, trials_key: str) -> dict[str, float]:
    """Return a rate with its 95 % interval over views, because points of one view are correlated."""
    counts, trials = (np.array([row[key] for row in rows], np.float64) for key in (count_key, trials_key))
    total = max(float(trials.sum()), 1.0)
    rate = float(counts.sum()) / total
    half = 1.96 * float(np.sqrt(((counts - rate * trials) ** 2).sum())) / total
    fraction = {"rate": rate, "low": max(rate - half, 0.0), "high": min(rate + half, 1.0)}
    return {key: round(value, 5) for key, value in fraction.items()} | {
        "count": int(counts.sum()),
        "trials": int(total),
    }


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: recall, precision and CPU time on warped views, as SVG."""
    rows = figures["warped_views"]

    def percent(key: str) -> dict[str, list[Bar | None]]:
        return {
            m: [(100 * r[key]["rate"], 100 * r[key]["low"], 100 * r[key]["high"])] for m, r in rows.items()
        }

    cpu: dict[str, list[Bar | None]] = {
        m: [(r["cpu_s"]["median"], r["cpu_s"]["min"], r["cpu_s"]["p95"])] for m, r in rows.items()
    }
    top = max(r["cpu_s"]["p95"] for r in rows.values())
    return chart(
        [
            Panel("known points matched within 5 px, %", ["warped views"], percent("recall"), 100.0),
            Panel("correct matches (within 3 px), %", ["warped views"], percent("precision"), 100.0),
            Panel("CPU s per pair: median, minimum, 95 %", ["warped views"], cpu, 1.1 * top),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables: measured pairs; warped views and unrelated images."""
    lines = [
        "| measured pair | method | known points matched | correct matches | median error | CPU s |",
        "|---" * 6 + "|",
    ]
    for pair, rows in figures["measured_pairs"].items():
        for name, row in rows.items():
            correct = (
                f"{row['correct']} of {row['evaluated']}" if "correct" in row else f"{row['matches']} matches"
            )
            error = (
                f"{row['median_error_px']} px"
                if "correct" in row
                else ", ".join(f"{e} px" for e in row["error_px"])
            )
            lines.append(
                f"| {pair.replace('_', ' ')} | {name} | {row['matched']} of {row['known_points']} | "
                f"{correct} | {error} | {row['cpu_s']:.2f} |"
            )
    lines += [
        "",
        "| simulated | method | known points matched | correct matches | matches per view | CPU s | unrelated pairs accepted |",
    ]
    lines.append("|---" * 7 + "|")
    unrelated = figures["unrelated_pairs"]
    for name, row in figures["warped_views"].items():
        lines.append(
            f"| {row['views']} warped | {name} | {rate_text(row['recall'])} | {rate_text(row['precision'])} | "
            f"{row['matches_per_view']:.0f} | {row['cpu_s']['median']:.2f} | "
            f"{rate_text(unrelated[name]['answered']) if name in unrelated else '–'} |"
        )
    return "\n".join(lines)
