# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate absolute localisation on simulated orbital models and on shifted MOLA topography.

The simulated ground is fractal relief with craters. Its orbital model has cells of 1 m, noise of 0.15 m
(1 sigma, correlated within 1.5 m) and another datum. The initial error of the rover is up to 20 m in x and y
and 1.5 degrees in yaw (1 sigma). The rover drifts by 2 % every 5 m and observes half of the ground within
8 m. The factor of the covariance and the gates were chosen with other seeds (from 50 000).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_core.dfns.raster_matching.interface import RasterMatchingInputs
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import interval, nees_band, rate_text
from evaluation.chart import Panel, chart
from evaluation.real import RealRow
from evaluation.record import squared_error
from evaluation.scenes.orbital import ORBITAL_M, Ground, PatchRun

TRIALS, OTHER_TRIALS, FLAT_TRIALS, TRAVERSES, SHIFTS = 500, 500, 60, 40, 100
#: First seed. The factor of the covariance and the gates were chosen with seeds from 50 000 and 60 000.
FIRST_SEED = 3000
#: Drives on the same terrain; they differ in start, path, drift, measurements and orbital noise.
DRIVES_PER_SITE = 4
FIX_PATH_LENGTH_M, TRAVERSE_PATH_LENGTH_M, DATUM_M = 35.0, 125.0, 12.0
#: A fix with a larger error is false. Three orbital cells are more than all stated covariances allow.
FALSE_M = 3.0 * ORBITAL_M
#: Indices of x, y, z and yaw in the covariance of a pose.
LEVEL = np.array([0, 1, 2, 5])
MOLA_CELLS, MOLA_SHIFT_CELLS, MOLA_BLUR_CELLS, MOLA_NOISE_M, MOLA_OFFSET_M = 40, 8.0, 0.7, 20.0, 1000.0
#: Maximum standard deviation of an accepted shift, cells; on plains the relief is below the noise.
MOLA_SIGMA_CELLS = 0.2
#: Cell size of MOLA's grid at the equator, metres. Heights are divided by it, so that cells have size 1 and
#: slopes do not change.
MOLA_CELL_M = 14_822.0


#: Parts of MOLA's map that are compared with the map: name -> blur in cells, noise in metres.
MOLA_MAPS = {
    "copy": (0.0, 0.0),
    "5 m noise": (0.0, 5.0),
    "blurred": (MOLA_BLUR_CELLS, 0.0),
    "blurred, 20 m noise": (MOLA_BLUR_CELLS, MOLA_NOISE_M),
}
#: Other relief for the check of the covariance: heights of MOLA times this factor, and number of shifts.
RELIEF_FACTOR, RELIEF_SHIFTS = 10.0, 40
PARTS = ("simulated", "mola", "mola_covariance", "mola_relief")


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the results on simulated and on measured topography."""
    report: dict[str, Any] = {}
    path = data / "planetary_rasters" / "megt90n000cb.img"
    if "simulated" in parts:
        report["simulated"] = simulated(progress)
    if "mola" in parts:
        report["mola"] = mola(path, progress)
    if "mola_covariance" in parts:
        report["mola_covariance"], squared = mola_covariance(read_mola(path), progress)
        report["real"] = {
            "GradientCorrelation": {
                f"MOLA, {name}": squared_error(round(float(np.mean(values)), 3), 2, len(values))
                for name, values in squared.items()
            }
        }
    if "mola_relief" in parts:
        steep = RELIEF_FACTOR * read_mola(path)
        report["mola_relief"], _ = mola_covariance(steep, progress, RELIEF_SHIFTS)
    return report


def simulated(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on simulated drives."""
    report: dict[str, Any] = {
        "seeds_from": FIRST_SEED,
        "drives_per_site": DRIVES_PER_SITE,
        "orbital_cell_m": ORBITAL_M,
        "false_beyond_m": FALSE_M,
    }
    kinds = (
        ("after 30 m", "right", TRIALS),
        ("other ground", "other", OTHER_TRIALS),
        ("flat ground", "flat", FLAT_TRIALS),
    )
    for name, kind, trials in kinds:
        outputs = []
        for seed in range(FIRST_SEED, FIRST_SEED + trials):
            progress(f"absolute_localisation: {name}, seed {seed}")
            outputs += run_drive(seed, FIX_PATH_LENGTH_M, kind)
        report[name] = summarise(outputs)
    outputs = []
    for seed in range(FIRST_SEED + TRIALS, FIRST_SEED + TRIALS + TRAVERSES):
        progress(f"absolute_localisation: traverse, seed {seed}")
        outputs += run_drive(seed, TRAVERSE_PATH_LENGTH_M, "right")
    segments = {round(outcome["path_length_m"] / 30.0) for outcome in outputs}
    report["traverse"] = {
        f"segment {k}": summarise(
            [outcome for outcome in outputs if round(outcome["path_length_m"] / 30.0) == k]
        )
        for k in sorted(segments)
    }
    return report


def run_drive(seed: int, path_length_m: float, kind: str) -> list[dict[str, Any]]:
    """Return the result of each segment of a drive.

    Parameters
    ----------
    seed : int
    path_length_m : float
    kind : str
        ``right`` (the orbital model shows the terrain of the drive), ``other`` (it shows other terrain) or
        ``flat`` (terrain without relief).
    """
    slope_deg = 0.0 if kind == "flat" else 6.0
    site = seed // DRIVES_PER_SITE
    ground = _ground(site, slope_deg)
    orbital_ground = _ground(site + 1_000_000, slope_deg) if kind == "other" else ground
    drive = PatchRun.make(ground, seed, path_length_m)
    dfpc = Registry.default().make_dfpc("absolute_localisation")
    dfpc.configure({}, DfpcContext("mana"))
    list(dfpc.step(Sample("orbital", 0, 0, orbital_ground.orbital(seed, DATUM_M))))
    results: list[dict[str, Any]] = []
    index = -1
    for sample in drive.samples(ground, seed):
        index += sample.port == "poses"
        start_s = time.process_time()
        for output in dfpc.step(sample):
            truth = drive.true_poses[index].copy()
            truth[2, 3] += DATUM_M
            results.append(score_output(output, truth, time.process_time() - start_s))
            results[-1]["path_length_m"] = output.quality.metrics.get("path_length_m", path_length_m)
    if not results:
        raise InputError(f"seed {seed}: a path of {path_length_m} m ended before a match")
    return results


@lru_cache(maxsize=2)
def _ground(seed: int, slope_deg: float) -> Ground:
    return Ground.make(seed, slope_deg)


def score_output(output: Output, truth: np.ndarray, cpu_s: float) -> dict[str, Any]:
    """Return the errors of an output at the robot, or the reasons of its refusal."""
    if output.value is None:
        return {"reasons": [r.split(":")[0] for r in output.quality.reasons], "cpu_s": cpu_s}
    T = output.value.transform
    T_error = T.matrix @ np.linalg.inv(truth)
    error = np.append(T.matrix[:3, 3] - truth[:3, 3], np.arctan2(T_error[1, 0], T_error[0, 0]))
    P = T.covariance[np.ix_(LEVEL, LEVEL)]
    return {
        "cpu_s": cpu_s,
        "error_m": float(np.hypot(error[0], error[1])),
        "height_m": abs(float(error[2])),
        "yaw_deg": abs(float(np.degrees(error[3]))),
        "nees": float(error @ np.linalg.solve(P, error)),
        "sigma_m": float(np.sqrt(P[0, 0] + P[1, 1])),
    }


def summarise(outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return rates with their 95 % intervals, error summaries and the NEES."""
    answered = [outcome for outcome in outcomes if "error_m" in outcome]
    false_fixes = [outcome for outcome in answered if outcome["error_m"] > FALSE_M]
    reasons: dict[str, int] = {}
    for outcome in outcomes:
        for reason in outcome.get("reasons", ()):
            reasons[reason] = reasons.get(reason, 0) + 1
    results: dict[str, Any] = {
        "answered": interval(len(answered), len(outcomes)),
        "false": interval(len(false_fixes), len(outcomes)),
        "reasons_of_refusals": reasons,
        "cpu_s": error_summary([outcome["cpu_s"] for outcome in outcomes]),
    }
    if answered:
        nees = float(np.mean([outcome["nees"] for outcome in answered]))
        low, high = nees_band(len(answered), 4)
        within_a_cell = sum(outcome["error_m"] <= ORBITAL_M for outcome in answered)
        results |= {
            "error_m": error_summary([outcome["error_m"] for outcome in answered]),
            "height_m": error_summary([outcome["height_m"] for outcome in answered]),
            "yaw_deg": error_summary([outcome["yaw_deg"] for outcome in answered]),
            "within_a_cell": interval(within_a_cell, len(answered)),
            "mean_sigma_m": round(float(np.mean([outcome["sigma_m"] for outcome in answered])), 4),
            "nees": {"mean": round(nees, 2), "band_95": [round(low, 2), round(high, 2)], "expected": 4},
        }
    return results


def mola(path: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Match pieces of MOLA's map, shifted, blurred, with noise and a height offset, with the map."""
    globe = read_mola(path)
    node = Registry.default().make_dfn("raster_matching")
    node.configure(
        {
            "search_m": MOLA_SHIFT_CELLS + 3.0,
            "search_deg": 0.0,
            "min_relief": 1e-4,
            "covariance_inflation": 2.2,
        }
    )
    errors, refused = [], 0
    for seed in range(SHIFTS):
        progress(f"absolute_localisation: MOLA, shift {seed}")
        reference, template, shift = shifted_piece(globe, np.random.default_rng([seed, 11]))
        outputs = node.process(RasterMatchingInputs(reference=reference, template=template))
        if np.sqrt(np.trace(outputs.covariances[0][:2, :2])) > MOLA_SIGMA_CELLS:
            refused += 1
            continue
        errors.append(float(np.hypot(*(outputs.transforms[0][:2, 3] - shift))))
    within = sum(e <= 0.2 for e in errors)
    return {
        "shifts": SHIFTS,
        "cells": MOLA_CELLS,
        "largest_shift_cells": MOLA_SHIFT_CELLS,
        "blur_cells": MOLA_BLUR_CELLS,
        "noise_m": MOLA_NOISE_M,
        "largest_offset_m": MOLA_OFFSET_M,
        "refused_above_sigma_cells": [refused, MOLA_SIGMA_CELLS],
        "error_cells": error_summary(errors),
        "within_0.2_cells": interval(within, len(errors)),
    }


def mola_covariance(
    globe: np.ndarray, progress: Callable[[str], None], shifts: int = SHIFTS
) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """Return a summary, and the NEES (2 degrees of freedom) of each answer, on two plain grids."""
    dfpc = Registry.default().make_dfpc("absolute_localisation")
    figures: dict[str, Any] = {}
    all_squared: dict[str, list[float]] = {}
    for name, (blur_cells, noise_m) in MOLA_MAPS.items():
        errors: list[float] = []
        squared = all_squared[name] = []
        for seed in range(shifts):
            progress(f"absolute_localisation: MOLA, {name}, shift {seed}")
            orbital, rover, shift = shifted_piece(
                globe, np.random.default_rng([seed, 11]), blur_cells=blur_cells, noise_m=noise_m, offset_m=0.0
            )
            dfpc.configure({}, DfpcContext("mana"))
            samples = Sample("orbital", 0, 0, orbital), Sample("dem", 0, 0, rover)
            (output,) = [output for sample in samples for output in dfpc.step(sample)]
            if output.value is not None:
                shift_error = output.value.transform.matrix[:2, 3] - shift
                errors.append(float(np.hypot(*shift_error)))
                squared.append(
                    float(
                        shift_error @ np.linalg.solve(output.value.transform.covariance[:2, :2], shift_error)
                    )
                )
        figures[name] = {
            "answered": interval(len(errors), shifts),
            "false": interval(sum(shift_error > 3.0 for shift_error in errors), shifts),
            "error_cells": error_summary(errors, 5),
            "squared_error": {**error_summary(squared, 3), "mean": round(float(np.mean(squared)), 3)},
        }
    return figures, all_squared


def read_mola(path: Path) -> np.ndarray:
    """Return the heights (720, 1440) of MOLA's map, metres."""
    return np.fromfile(path, dtype=">i2").reshape(720, 1440).astype(np.float64)


def shifted_piece(
    globe: np.ndarray,
    rng: np.random.Generator,
    *,
    blur_cells: float = MOLA_BLUR_CELLS,
    noise_m: float = MOLA_NOISE_M,
    offset_m: float = MOLA_OFFSET_M,
) -> tuple[ElevationMap, ElevationMap, np.ndarray]:
    """Return a window of the map, a smaller map shifted by (x, y) cells, and the shift; cell size 1.

    Latitudes are within 60 degrees, because the grid cells are far from square near the poles.
    """
    half, margin = MOLA_CELLS // 2, round(MOLA_SHIFT_CELLS) + 12
    row, col = int(rng.integers(120 + 60, 600 - 60)), int(rng.integers(100, 1340))
    shift = rng.uniform(-MOLA_SHIFT_CELLS, MOLA_SHIFT_CELLS, 2) / np.sqrt(2.0)
    n = half + margin
    window = globe[row - n : row + n, col - n : col + n]
    edges = (-float(n), -float(n), float(n), float(n))
    window_grid = GridGeometry.aligned("site", 1.0, edges)
    r, c = np.indices((2 * half, 2 * half), dtype=np.float64) + margin
    blurred = gaussian_filter(window, blur_cells, mode="nearest") if blur_cells else window
    piece = map_coordinates(blurred, np.stack([r - shift[1], c + shift[0]]), order=5)
    piece += rng.normal(0.0, noise_m, piece.shape) + rng.uniform(-offset_m, offset_m)
    piece_grid = GridGeometry.aligned("site", 1.0, (-float(half), -float(half), float(half), float(half)))
    maps = [
        ElevationMap.from_layers(g, {"mean": (z / MOLA_CELL_M).astype(np.float32)}, t0_ns=0, t1_ns=0)
        for g, z in ((window_grid, window), (piece_grid, piece))
    ]
    return maps[0], maps[1], shift


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: errors along the traverse, and errors of the shifts on MOLA, as SVG."""
    traverse = figures["simulated"]["traverse"]
    names = [name for name in traverse if "error_m" in traverse[name]]
    errors = [tuple(traverse[name]["error_m"][key] for key in ("median", "min", "p95")) for name in names]
    cells = figures["mola"]["error_cells"]
    return chart(
        [
            Panel("error, m (orbital cell 1 m)", names, {"median, minimum to 95 %": errors}, 1.5),
            Panel(
                "error on MOLA, cells",
                ["100 shifts"],
                {"median, minimum to maximum": [(cells["median"], cells["min"], cells["max"])]},
                0.3,
                (0.0, 0.2),
            ),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the table: rates of answers and false answers, errors, NEES."""
    rows = {k: v for k, v in figures["simulated"].items() if isinstance(v, dict) and "answered" in v}
    rows |= {f"traverse, {k}": v for k, v in figures["simulated"]["traverse"].items()}
    lines = [
        "| drive | answered | false (error above 3 cells) | error median, 95 %, maximum "
        "| NEES (4 expected; 95 % band) |",
        "|---" * 5 + "|",
    ]
    for name, row in rows.items():
        error, nees = row.get("error_m"), row.get("nees")
        error_text = f"{error['median']:.2f}, {error['p95']:.2f}, {error['max']:.2f} m" if error else "none"
        nees_text = (
            f"{nees['mean']:.2f} ({nees['band_95'][0]:.2f}–{nees['band_95'][1]:.2f})" if nees else "none"
        )
        cells = (name, rate_text(row["answered"]), rate_text(row["false"]), error_text, nees_text)
        lines.append(f"| {' | '.join(cells)} |")
    cells = figures["mola"]["error_cells"]
    lines += [
        "",
        f"MOLA, {figures['mola']['shifts']} shifts, {figures['mola']['refused_above_sigma_cells'][0]} "
        f"refused: median {cells['median']:.3f}, 95 % {cells['p95']:.3f}, maximum {cells['max']:.3f} "
        f"cells; within 0.2 cells {rate_text(figures['mola']['within_0.2_cells'])}.",
        "",
        "| two grids of MOLA | answered | false | error median, 95 %, maximum "
        "| NEES, mean and median (2 expected) |",
        "|---" * 5 + "|",
    ]
    rows = figures["mola_covariance"] | {
        f"relief × {RELIEF_FACTOR:g}, {name}": row for name, row in figures.get("mola_relief", {}).items()
    }
    for name, row in rows.items():
        error, squared = row["error_cells"], row["squared_error"]
        error_text = f"{error['median']:.4f}, {error['p95']:.4f}, {error['max']:.4f} cells"
        cells = (name, rate_text(row["answered"]), rate_text(row["false"]), error_text)
        lines.append(f"| {' | '.join(cells)} | {squared['mean']:.2f}, {squared['median']:.2f} |")
    return "\n".join(lines)


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    return [
        RealRow(
            f"{name}, NEES of the horizontal position (2 expected)",
            "",
            str(row["squared_error"]),
            "",
            "0.5 to 6",
        )
        for name, row in figures["real"]["GradientCorrelation"].items()
    ]
