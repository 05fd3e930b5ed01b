# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare triangulated sparse points with GTSAM, and dense depths with Middlebury's ground truth.

Sparse points are simulated; both programs process the same observations. Dense depths are computed from
measured images, in units of the depth at disparity 1, because the data set states neither focal length nor
baseline.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import BundleProblem, Frame
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.disparity_to_point_cloud.interface import DisparityToPointCloudInputs
from cdff_core.dfns.n_view_triangulation.interface import NViewTriangulationInputs
from evaluation.chart import Bar, Panel, chart
from evaluation.data_sets.image_pairs import grey

Float = NDArray[np.float64]
POINTS = 100_000
CAMERA = (700.0, 700.0, 320.0, 240.0)
SIGMA_PX = 0.5
#: Name, number of views, and depths of the points, metres; the cameras are about half a metre apart.
SCENES = (
    ("2 views", 2, (4.0, 30.0)),
    ("3 views", 3, (4.0, 30.0)),
    ("5 views", 5, (4.0, 30.0)),
    ("2 views, far", 2, (20.0, 80.0)),
)
#: Grey levels per pixel of disparity in the ground truth, and the search range of all images, pixels.
SCALES = {"teddy": 4.0, "tsukuba": 16.0}
SEARCH_PX = 64


def evaluate(data: Path, progress: Callable[[str], None], points: int = POINTS) -> dict[str, Any]:
    """Return the results on simulated sparse points and measured dense depths."""
    figures: dict[str, Any] = {"sparse_simulated": {}, "dense_measured": {}}
    for name, views, depths in SCENES:
        progress(f"triangulation: {name}")
        figures["sparse_simulated"][name] = sparse(views, depths, points)
    for name in SCALES:
        figures["dense_measured"][name] = dense(data, name)
    return figures


def scene(views: int, depths: tuple[float, float], points: int, seed: int = 0) -> tuple[BundleProblem, Float]:
    """Return a problem of adjacent cameras with noisy observations, and the true points."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(*depths, points)
    X = np.column_stack([rng.uniform(-0.4, 0.4, points) * z, rng.uniform(-0.3, 0.3, points) * z, z])
    T = [
        se3.transform(se3.exp_so3(rng.normal(0, 0.03, 3)), [0.5 * i, *rng.normal(0, 0.1, 2)])
        for i in range(views)
    ]
    fx, fy, cx, cy = CAMERA
    pixels = []
    for pose in T:
        p = se3.transform_points(se3.inverse(pose), X)
        pixels.append(p[:, :2] / p[:, 2:] * [fx, fy] + [cx, cy] + rng.normal(0, SIGMA_PX, (points, 2)))
    indices = (np.tile(np.arange(views), points), np.repeat(np.arange(points), views))
    return BundleProblem.from_arrays(
        T, CAMERA, np.zeros((points, 3)), indices, np.stack(pixels, axis=1).reshape(-1, 2), frame="site"
    ), X


def sparse(views: int, depths: tuple[float, float], points: int) -> dict[str, Any]:
    """Return errors, consistency of covariances and speed of the DFN and of GTSAM on the same points."""
    problem, truth = scene(views, depths, points)
    dfn = Registry.default().make_dfn("n_view_triangulation")
    dfn.configure({"min_angle_deg": 0.0, "max_residual_px": 1000.0, "sigma_px": SIGMA_PX})
    times = []
    for _ in range(5):
        started = time.process_time()
        outputs = dfn.process(NViewTriangulationInputs(tracks=problem))
        times.append(time.process_time() - started)
    peer, peer_s = _gtsam(problem, views)
    answered_by_both = outputs.valid & np.isfinite(peer).all(axis=1)
    error = outputs.points - truth
    nees = (
        np.einsum(
            "ni,nij,nj->n",
            error[answered_by_both],
            np.linalg.inv(outputs.covariances[answered_by_both]),
            error[answered_by_both],
        )
        / 3.0
    )
    half = 1.96 * float(nees.std()) / len(nees) ** 0.5
    rmse = {
        "cdff": float(np.sqrt(np.mean(error[answered_by_both] ** 2) * 3.0)),
        "gtsam": float(np.sqrt(np.mean((peer - truth)[answered_by_both] ** 2) * 3.0)),
    }
    return {
        "points": points,
        "answered": {"cdff": int(outputs.valid.sum()), "gtsam": int(np.isfinite(peer).all(axis=1).sum())},
        "rmse_m": rmse,
        "rmse_ratio": rmse["cdff"] / rmse["gtsam"],
        "median_error_m": float(np.median(np.linalg.norm(error[answered_by_both], axis=1))),
        "nees_ratio": {
            "mean": float(nees.mean()),
            "low": float(nees.mean()) - half,
            "high": float(nees.mean()) + half,
        },
        "points_per_cpu_s": {"cdff": points / float(np.median(times)), "gtsam": points / peer_s},
    }


def _gtsam(problem: BundleProblem, views: int) -> tuple[Float, float]:
    """Return the points of GTSAM's nonlinear triangulation (NaN if it fails), and CPU seconds."""
    import gtsam

    poses = [gtsam.Pose3(T) for T in problem.cameras.matrices]
    fx, fy, cx, cy = CAMERA
    calibration = gtsam.Cal3_S2(fx, fy, 0.0, cx, cy)
    pixels = problem.observations.pixels[:, :2].reshape(-1, views, 2)
    result = np.full((len(pixels), 3), np.nan)
    started = time.process_time()
    for i, observations in enumerate(pixels):
        try:
            result[i] = gtsam.triangulatePoint3(poses, calibration, list(observations), 1e-9, True)
        except RuntimeError:  # GTSAM found no point
            continue
    return result, time.process_time() - started


def dense(data: Path, name: str) -> dict[str, Any]:
    """Return the errors of the depths of a stereo pair in units of their stated standard deviation.

    They are computed over all pixels with depth and ground truth, and over pixels within 1 px of the truth.
    """
    folder = data / "middlebury" / name
    scale = SCALES[name]
    truth = grey(folder / "disp2.png").astype(np.float64) / scale
    K = np.eye(3)
    left, right = (Frame.from_image(grey(folder / f"im{i}.png"), stamp_ns=0, camera_matrix=K) for i in (2, 6))
    matcher = Registry.default().make_dfn("disparity_image")
    matcher.configure({"num_disparities": SEARCH_PX})
    disparity = matcher.process(DisparityImageInputs(left=left, right=right)).disparity
    construct = Registry.default().make_dfn("disparity_to_point_cloud")
    construct.configure({"min_depth_m": 0.0, "max_depth_m": 1e9, "max_depth_sigma_m": 1000.0})
    outputs = construct.process(DisparityToPointCloudInputs(disparity=disparity, baseline_m=1.0, left=left))
    pixels = np.rint(outputs.points[:, :2] / outputs.points[:, 2:]).astype(int)
    d = truth[pixels[:, 1], pixels[:, 0]]
    known = d > 0.0
    z, sigma, d = outputs.points[known, 2], outputs.depth_sigma_m[known], d[known]
    normalised = (z - 1.0 / d) / sigma
    is_close = np.abs(1.0 / z - d) <= 1.0
    intensity = left.image[pixels[:, 1], pixels[:, 0]]
    return {
        "pixels_with_truth": int((truth > 0).sum()),
        "density": round(float(known.sum() / (truth > 0).sum()), 4),
        "bad_1": round(float(1.0 - is_close.mean()), 4),
        "sigma_px": construct.config.sigma_px,
        "disparity_rms_px": {
            "all": round(float(np.sqrt(np.mean((1.0 / z - d) ** 2))), 3),
            "within_1_px": round(float(np.sqrt(np.mean((1.0 / z - d)[is_close] ** 2))), 3),
        },
        "all": _consistency(normalised),
        "within_1_px": _consistency(normalised[is_close]),
        "truth_step_px": 1.0 / scale if name == "teddy" else 1.0,
        "intensity_is_the_left_image": bool(np.array_equal(outputs.intensity, intensity)),
    }


def _consistency(normalised: Float) -> dict[str, Any]:
    """Return mean square, median relative to a Gaussian, and fractions within 1, 2, 3 sigma of normalised
    errors.
    """
    size = np.abs(normalised)
    return {
        "nees": round(float(np.mean(size**2)), 3),
        "median_over_gaussian": round(float(np.median(size)) / 0.6745, 3),
        "within_sigmas": {f"{k}": round(float(np.mean(size <= k)), 4) for k in (1, 2, 3)},
    }


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: RMSE relative to GTSAM, consistency, dense depths within sigma, as SVG."""
    rows, measured = figures["sparse_simulated"], figures["dense_measured"]
    ratio: list[Bar | None] = [(r["rmse_ratio"],) * 3 for r in rows.values()]
    nees: list[Bar | None] = [
        tuple(r["nees_ratio"][k] for k in ("mean", "low", "high")) for r in rows.values()
    ]  # type: ignore[misc]  # each tuple has three values
    fractions: dict[str, list[Bar | None]] = {
        name: [(100 * r["all"]["within_sigmas"][k],) * 3 for k in "123"] for name, r in measured.items()
    }
    fractions["Gaussian"] = [(68.3,) * 3, (95.4,) * 3, (99.7,) * 3]
    return chart(
        [
            Panel("RMSE relative to GTSAM (grey: up to 1.02)", list(rows), {"cdff": ratio}, 1.5, (0.0, 1.02)),
            Panel("NEES per degree of freedom", list(rows), {"cdff": nees}, 2.0),
            Panel("all dense depths within 1, 2, 3 sigma, %", ["1", "2", "3"], fractions, 100.0),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables: sparse points and GTSAM; dense depths and ground truth."""
    head = (
        "| simulated, 0.5 px noise | points | RMSE cdff | RMSE GTSAM | ratio | NEES per degree of freedom | "
        "points per CPU s | GTSAM's |"
    )
    lines = [head, "|---" * 8 + "|"]
    for name, row in figures["sparse_simulated"].items():
        rate, ratio = row["points_per_cpu_s"], row["nees_ratio"]
        lines.append(
            f"| {name} | {row['points']} | {row['rmse_m']['cdff']:.5g} m | {row['rmse_m']['gtsam']:.5g} m | "
            f"{row['rmse_ratio']:.4f} | {ratio['mean']:.3f} ({ratio['low']:.3f} to {ratio['high']:.3f}) | "
            f"{rate['cdff'] / 1e6:.2f} million | {rate['gtsam'] / 1e6:.3f} million |"
        )
    lines += [
        "",
        "| measured | density | pixels | fraction | RMS of disparities | median error / σ_z, 1 if Gaussian "
        "| mean NEES (1 expected) | within 1, 2, 3 σ_z |",
        "|---" * 8 + "|",
    ]
    for name, row in figures["dense_measured"].items():
        for key, pixels, fraction, rms in (
            ("all", "all", 1.0, row["disparity_rms_px"]["all"]),
            (
                "within_1_px",
                "within 1 px of the truth",
                1.0 - row["bad_1"],
                row["disparity_rms_px"]["within_1_px"],
            ),
        ):
            statistics = row[key]
            within = ", ".join(f"{100 * statistics['within_sigmas'][k]:.1f} %" for k in "123")
            lines.append(
                f"| {name} | {100 * row['density']:.1f} % | {pixels} | {100 * fraction:.1f} % | {rms} px | "
                f"{statistics['median_over_gaussian']:.2f} | {statistics['nees']:.3g} | {within} |"
            )
    lines.append("| Gaussian | | | | | 1 | 1 | 68.3 %, 95.4 %, 99.7 % |")
    return "\n".join(lines)
