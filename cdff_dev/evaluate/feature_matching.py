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

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_core.dfns.cameras_transform_estimation._interface import CamerasTransformEstimationInputs
from cdff_core.dfns.essential_matrix_computation._interface import EssentialMatrixComputationInputs
from cdff_core.dfns.fundamental_matrix_computation._interface import FundamentalMatrixComputationInputs
from cdff_core.dfns.homography_computation._interface import HomographyComputationInputs
from cdff_core.imaging.two_view import sampson, transfer
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
VIEWS, STRANGERS, MODEL_TRIALS = 500, 500, 500
#: Views that the other variants are shown, and size of all views, pixels.
FEWER, SIZE = 100, (320, 240)
#: How many pairs the models are made of, in turn.
PAIRS = (60, 120, 300, 900)
FOUND_PX, RIGHT_PX = 5.0, 3.0


def evaluate(
    data: Path,
    progress: Callable[[str], None],
    trials: int = VIEWS,
    others: int = STRANGERS,
    models: int = MODEL_TRIALS,
) -> dict[str, Any]:
    """Figures of measured pairs, of warped views, of strange images, and of the stated uncertainty."""
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
    progress("feature_matching: uncertainty of models")
    return figures | {"uncertainty": of_models(models)}


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


def two_views(seed: int, pairs: int = 300, wrong: float = 0.3, sigma_px: float = 0.5) -> dict[str, Any]:
    """Points before two cameras with noise and wrong partners, and the truth."""
    rng = np.random.default_rng(seed)
    K = np.array([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])
    direction = rng.normal(size=3)
    T = se3.transform(se3.exp_so3(rng.normal(0, 0.1, 3)), direction / np.linalg.norm(direction))  # T_right_left
    source = np.column_stack([rng.uniform(20, 620, pairs), rng.uniform(20, 460, pairs)])
    depth = rng.uniform(4.0, 20.0, pairs)
    points = np.column_stack([source, np.ones(pairs)]) @ np.linalg.inv(K).T * depth[:, None]
    image = se3.transform_points(T, points) @ K.T
    exact = source.copy(), image[:, :2] / image[:, 2:]
    sink = exact[1] + rng.normal(0, sigma_px, (pairs, 2))
    outliers = rng.random(pairs) < wrong
    sink[outliers] = np.column_stack([rng.uniform(0, 640, pairs), rng.uniform(0, 480, pairs)])[outliers]
    return {"source": source + rng.normal(0, sigma_px, (pairs, 2)), "sink": sink, "K": K, "T": T, "exact": exact}


def plane_views(seed: int, pairs: int, wrong: float = 0.3, sigma_px: float = 0.5) -> dict[str, Any]:
    """Points of a plane in two images with noise and wrong partners, and the truth."""
    rng = np.random.default_rng(seed)
    exact = np.column_stack([rng.uniform(20, 620, pairs), rng.uniform(20, 460, pairs)])
    H = np.eye(3) + rng.normal(0, 0.1, (3, 3)) * [[1, 1, 100], [1, 1, 100], [1e-3, 1e-3, 0]]
    image = transfer(H, exact)
    sink = image + rng.normal(0, sigma_px, (pairs, 2))
    outliers = rng.random(pairs) < wrong
    sink[outliers] = np.column_stack([rng.uniform(0, 640, pairs), rng.uniform(0, 480, pairs)])[outliers]
    return {"source": exact + rng.normal(0, sigma_px, (pairs, 2)), "sink": sink, "exact": (exact, image)}


def of_models(trials: int) -> dict[str, Any]:
    """Squared errors in units of the stated covariance, over their expected value: 1 where it is right."""
    nodes = {}
    for model in (
        "fundamental_matrix_computation", "homography_computation", "essential_matrix_computation",
        "cameras_transform_estimation",
    ):  # fmt: skip
        nodes[model] = Registry.default().make_dfn(model)
        nodes[model].configure()
    nees: dict[str, list[float]] = {"fundamental": [], "homography": [], "transform": []}
    for seed in range(trials):
        pairs = PAIRS[seed % len(PAIRS)]
        v, plane = two_views(seed, pairs), plane_views(seed, pairs)
        given = v["source"], v["sink"]
        F = nodes["fundamental_matrix_computation"].process(FundamentalMatrixComputationInputs(*given))
        nees["fundamental"].append(_of_distances(F.fundamental_matrix, F.covariance, *v["exact"]))
        H = nodes["homography_computation"].process(HomographyComputationInputs(plane["source"], plane["sink"]))
        nees["homography"].append(_of_transfers(H.homography, H.covariance, *plane["exact"]))
        E = nodes["essential_matrix_computation"].process(EssentialMatrixComputationInputs(*given, v["K"]))
        found = nodes["cameras_transform_estimation"].process(
            CamerasTransformEstimationInputs(E.essential_matrix, *given, v["K"])
        )
        nees["transform"].append(_squared(cov.pose_error(se3.inverse(v["T"]), found.transform), found.covariance, 5))
    return {name: {"trials": trials, "nees_ratio": _ratio(values)} for name, values in nees.items()}


def _of_transfers(H: Float, covariance: Float, source: Float, sink: Float) -> float:
    """Mean squared error of where a homography puts exact points, over the covariance that the homography's leaves."""
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    J = np.stack([(transfer(H + d, source) - transfer(H - d, source)) / 2e-6 for d in steps], axis=2)
    error = transfer(H, source) - sink
    spreads = np.einsum("nai,ij,nbj->nab", J, covariance, J)
    return float(np.mean(np.einsum("na,nab,nb->n", error, np.linalg.inv(spreads), error)) / 2.0)


def _of_distances(F: Float, covariance: Float, source: Float, sink: Float) -> float:
    """Mean squared distance of exact pairs from a fundamental matrix, each over the variance that F's leaves it."""
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    J = np.stack([(sampson(F + d, source, sink) - sampson(F - d, source, sink)) / 2e-6 for d in steps], axis=1)
    return float(np.mean(sampson(F, source, sink) ** 2 / np.einsum("ni,ij,nj->n", J, covariance, J)))


def _squared(error: Float, covariance: Float, rank: int) -> float:
    """Normalised squared error over its expected value, within the directions that have a variance."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    along = vectors[:, -rank:].T @ (error / scale)
    return float(np.sum(along**2 / values[-rank:]) / rank)


def _ratio(values: list[float]) -> dict[str, float]:
    """Mean and its two-sided 95 % interval."""
    mean, half = float(np.mean(values)), 1.96 * float(np.std(values)) / len(values) ** 0.5
    return {"mean": round(mean, 3), "low": round(mean - half, 3), "high": round(mean + half, 3)}


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
    """Measured pairs, warped views, strange images, uncertainty."""
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
    lines.append("")
    for name, row in figures["uncertainty"].items():
        ratio = row["nees_ratio"]
        lines.append(
            f"Squared error of the {name} over its stated covariance: {ratio['mean']} ({ratio['low']} to "
            f"{ratio['high']}) of what is expected, {row['trials']} simulated trials of 60 to 900 pairs, 30 % wrong."
        )
    return "\n".join(lines)
