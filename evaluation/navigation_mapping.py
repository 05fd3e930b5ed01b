# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare traversability classes with the true terrain, for noisy heights and for maps of simulated sweeps.

The reference class of a cell is computed from the true heights without noise. A true hazard exceeds a limit
of slope or roughness, or is within half the rover's width plus margin of a step above the limit. No parameter
was chosen with these seeds.

Intersection over union (IoU) is computed over cells with a standard deviation of at most 3 cm. One reference
uses exact heights of the observed cells (effect of noise), the other exact heights everywhere (effect of
noise and holes). The sensitivity of the IoU of hazards is computed from exact heights: their hazards are
compared with those of a step limit raised by one sigma, and with hazards enlarged by one cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry, aggregate_to
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability.interface import TraversabilityInputs
from cdff_dev.compare.registration.rates import interval
from cdff_dev.simulate.relief import crater_profile, fractal_tile, power_law_sizes
from evaluation.chart import Bar, Panel, chart

PROFILE = Path(__file__).resolve().parents[1] / "deploy" / "profiles" / "rover_traverse.yaml"
#: Required intersection over union.
REQUIRED_IOU = 0.9
LIMITS = ("length_m", "width_m", "max_slope_deg", "max_step_m", "max_roughness_m")
SEEDS, SIGMAS_M = range(100, 120), (0.0, 0.01, 0.02, 0.03)
#: Edge of the ground, its cells, and the cells in which it is generated.
EDGE_M, CELL_M, FINE_M = 40.0, 0.1, 0.025
UNKNOWN, SAFE, CAUTION, HAZARD = range(4)
#: Compared sets and their classes.
KINDS = {"safe": (SAFE,), "passable": (SAFE, CAUTION), "hazard": (HAZARD,)}


@dataclass(frozen=True, slots=True, eq=False)
class ClassifiedMaps:
    """Navigation maps of the same ground from different heights.

    Attributes
    ----------
    estimated : NavigationMap
        From the noisy heights of the observed cells.
    exact : NavigationMap
        From the true heights of the observed cells.
    lenient : NavigationMap
        From the same heights as ``exact``, with the step limit raised by the median standard deviation.
    truth : NavigationMap
        From the true heights of all cells.
    sigma_m : ndarray
        Standard deviation of the height of each cell; infinite if unobserved.
    """

    estimated: NavigationMap
    exact: NavigationMap
    lenient: NavigationMap
    truth: NavigationMap
    sigma_m: FloatArray


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results over all seeds for each noise, and those of lidar maps."""
    del data
    limits = rover_limits()
    report: dict[str, Any] = {"limits": limits, "cell_m": CELL_M, "seeds": [SEEDS[0], SEEDS[-1]], "noise": {}}
    for sigma_m in SIGMAS_M:
        progress(f"navigation_mapping: noise {sigma_m} m")
        maps = [noisy_maps(seed, sigma_m, limits) for seed in SEEDS]
        report["noise"][f"{100 * sigma_m:g} cm"] = summarise(maps, limits)
    noisy = [report["noise"][f"{100 * sigma_m:g} cm"]["iou_cells"] for sigma_m in SIGMAS_M if sigma_m > 0.0]
    pooled = {kind: np.sum([cells[kind] for cells in noisy], axis=0).tolist() for kind in KINDS}
    report["iou_of_all_noises"] = _ratios(pooled)
    report["rover_traverse (simulated), lidar, true poses"] = _simulated(limits, progress)
    return report


def rover_limits() -> dict[str, float]:
    """Return the limits of the rover of the demonstration."""
    limits = load_profile(PROFILE).robots[0].limits
    return {name: limits[name] for name in LIMITS}


@cache
def true_heights(seed: int) -> FloatArray:
    """Return the mean heights of cells of ``CELL_M``; some slopes and rocks exceed the rover's limits."""
    rng = np.random.default_rng([seed, 21])
    n = round(EDGE_M / FINE_M)
    z = fractal_tile(rng, n, FINE_M, (4.0, 40.0), 0.8, np.tan(np.radians(9.0)))
    z += fractal_tile(rng, n, FINE_M, (0.15, 4.0), 0.8, np.tan(np.radians(3.5)))
    axis = (np.arange(n) + 0.5) * FINE_M
    for diameter in power_law_sizes(rng, 12, 1.5, 8.0, 1.5):
        i, j, distance_m = _crater_window(axis, rng.uniform(0.0, EDGE_M, 2), 1.5 * diameter)
        z[i, j] += crater_profile(distance_m, diameter, diameter * rng.uniform(0.1, 0.25), 0.04 * diameter)
    for diameter in power_law_sizes(rng, 500, 0.1, 1.2, 2.0):
        i, j, distance_m = _crater_window(axis, rng.uniform(0.0, EDGE_M, 2), diameter)
        z[i, j] += rng.uniform(0.6, 1.2) * np.sqrt(np.maximum(0.25 * diameter**2 - distance_m**2, 0.0))
    k = round(CELL_M / FINE_M)
    return np.asarray(z.reshape(n // k, k, n // k, k).mean(axis=(1, 3)))


def noisy_maps(seed: int, sigma_m: float, limits: dict[str, float]) -> ClassifiedMaps:
    """Return the maps of true heights with noise, and with holes over 15 % of the ground."""
    truth, rng = true_heights(seed), np.random.default_rng([seed, 22])
    hidden = gaussian_filter(rng.normal(size=truth.shape), 3.0)
    observed = hidden < np.quantile(hidden, 0.85)
    noisy = np.where(observed, truth + rng.normal(0.0, 1.0, truth.shape) * sigma_m, np.nan)
    return classify_heights(noisy, np.where(observed, sigma_m**2, np.nan), truth, limits)


def classify_heights(
    heights: FloatArray, variance: FloatArray, truth: FloatArray, limits: dict[str, float]
) -> ClassifiedMaps:
    """Return the maps of estimated heights with variances and of the true heights."""
    observed = np.isfinite(heights)
    # Without a margin for the standard deviations of the heights.
    exact = {**limits, "sigmas": 0.0}
    sigma = np.where(observed, np.sqrt(np.where(observed, variance, 0.0)), np.inf)
    observed_truth = np.where(observed, truth, np.nan)
    raised_limit = {**exact, "max_step_m": limits["max_step_m"] + float(np.median(sigma[observed]))}
    return ClassifiedMaps(
        classify(heights, limits, variance),
        classify(observed_truth, exact),
        classify(observed_truth, raised_limit),
        classify(truth, exact),
        sigma,
    )


def classify(
    heights: FloatArray, config: dict[str, float], variance: FloatArray | None = None
) -> NavigationMap:
    """Return the navigation map that ``traversability`` computes from heights."""
    rows, cols = heights.shape
    geometry = GridGeometry("site", CELL_M, 0.0, rows * CELL_M, rows, cols)
    layers = {"mean": heights} if variance is None else {"mean": heights, "variance": variance}
    dem = ElevationMap.from_layers(
        geometry, {k: v.astype(np.float32) for k, v in layers.items()}, t0_ns=0, t1_ns=0
    )
    node = Registry.default().make_dfn("traversability")
    node.configure(config)
    return node.process(TraversabilityInputs(dem=dem)).map


def summarise(maps: list[ClassifiedMaps], limits: dict[str, float]) -> dict[str, Any]:
    """Return the rate of hazards rated safe, their largest excess over a limit, and the IoU of classes."""
    safe = wrong = 0
    cells = _agreement(maps, "exact")
    slope_deg = step_m = -np.inf
    for classified in maps:
        a, b = classified.estimated.layer("class"), classified.truth.layer("class")
        rated_safe = (a == SAFE) & (b != UNKNOWN)
        safe += int(rated_safe.sum())
        wrong += int((rated_safe & (b == HAZARD)).sum())
        if rated_safe.any():
            largest_slope_deg = float(np.nanmax(classified.truth.layer("slope_deg")[rated_safe]))
            slope_deg = max(slope_deg, largest_slope_deg - limits["max_slope_deg"])
            step_m = max(step_m, _highest_step(classified.truth, rated_safe, limits) - limits["max_step_m"])
    return {
        "hazards_rated_safe": interval(wrong, safe),
        "slope_beyond_deg": round(slope_deg, 3),
        "step_beyond_m": round(step_m, 4),
        "iou": _ratios(cells),
        "iou_cells": cells,
        "iou_with_holes": _ratios(_agreement(maps, "truth")),
        "hazards_by_exact_heights": _hazards_alone(maps),
    }


def _agreement(maps: list[ClassifiedMaps], other: str) -> dict[str, list[int]]:
    """Return for each kind the number of cells of this kind in both maps, and in at least one map."""
    cells = {kind: [0, 0] for kind in KINDS}
    for classified in maps:
        a, b = classified.estimated.layer("class"), getattr(classified, other).layer("class")
        compared_cells = (classified.sigma_m <= 0.03 + 1e-6) & (a != UNKNOWN) & (b != UNKNOWN)
        for kind, classes in KINDS.items():
            in_a, in_b = compared_cells & np.isin(a, classes), compared_cells & np.isin(b, classes)
            cells[kind][0] += int((in_a & in_b).sum())
            cells[kind][1] += int((in_a | in_b).sum())
    return cells


def _hazards_alone(maps: list[ClassifiedMaps]) -> dict[str, float]:
    """Return the IoU of exact hazards with those of a limit raised by a sigma, and enlarged by a cell."""
    cells = {"limit_higher_by_a_sigma": [0, 0], "grown_by_a_cell": [0, 0]}
    for classified in maps:
        exact = classified.exact.layer("class")
        known, hazard = exact != UNKNOWN, exact == HAZARD
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        grown = known & (cv2.dilate(hazard.astype(np.uint8), cross) > 0)
        for name, other in (
            ("limit_higher_by_a_sigma", classified.lenient.layer("class") == HAZARD),
            ("grown_by_a_cell", grown),
        ):
            cells[name][0] += int((hazard & other).sum())
            cells[name][1] += int((hazard | other).sum())
    return _ratios(cells)


def _ratios(cells: dict[str, list[int]]) -> dict[str, float]:
    return {kind: round(intersection / max(union, 1), 4) for kind, (intersection, union) in cells.items()}


def _highest_step(truth: NavigationMap, rated_safe: np.ndarray, limits: dict[str, float]) -> float:
    """Return the largest true step within half the rover's width of cells rated safe, metres."""
    reach = round(0.5 * min(limits["width_m"], limits["length_m"]) / CELL_M)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    steps = np.nan_to_num(truth.layer("step_m"), nan=0.0)
    return float(cv2.dilate(steps, disc)[rated_safe].max())


def _simulated(limits: dict[str, float], progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of both rovers of the demonstration, mapped with true poses, cells of ``CELL_M``."""
    from cdff_common.interfaces.dfpc import Sample
    from cdff_dev.logs import open_log
    from cdff_dev.simulate.scenario import load_scenario
    from cdff_dev.simulate.store import simulated_log
    from evaluation.runs.elevation import build_map

    progress("navigation_mapping: simulated traverse")
    log, profile = open_log(simulated_log(load_scenario("rover_traverse"))), load_profile(PROFILE)
    terrain = next(iter(log.samples(["/site/truth.terrain"]))).value
    maps = []
    for robot in profile.robot_ids:
        entry = profile.robot(robot)
        ports = {f"/{robot}/truth.pose": "poses", f"/{robot}/lidar.scan": "scan"}
        samples = (Sample(ports[s.stream], s.stamp_ns, s.seq, s.value) for s in log.samples(list(ports)))
        context = entry.context(entry.dfpc("digital_elevation_mapping"))
        dem = build_map(samples, context, "Lidar", {"resolution_m": 0.05, "fusion": {"size_m": 40.0}})
        maps.append(_compare_with_terrain(dem, terrain, limits))
    return summarise(maps, limits)


def _compare_with_terrain(
    dem: ElevationMap, terrain: ElevationMap, limits: dict[str, float]
) -> ClassifiedMaps:
    """Return the maps of an elevation map and of the terrain, both averaged to cells of ``CELL_M``."""
    layers = {name: dem.layer(name) for name in dem.layer_names}
    coarse = aggregate_to(CellStatistics.from_layers(dem.geometry, layers, dem.t1_ns), CELL_M)
    geometry = coarse.geometry
    heights = np.where(coarse.observed, coarse.mean, np.nan)
    fine = terrain.geometry
    factor = max(1, round(CELL_M / fine.resolution_m))
    x_m = (np.arange(geometry.cols * factor) + 0.5) * CELL_M / factor + geometry.xmin_m
    y_m = geometry.ymax_m - (np.arange(geometry.rows * factor) + 0.5) * CELL_M / factor
    x, y = np.meshgrid(x_m, y_m)
    r, c, inside = fine.cells_of(x.ravel(), y.ravel())
    terrain_m = np.where(inside, terrain.layer("mean")[r, c], np.nan).reshape(
        geometry.rows, factor, geometry.cols, factor
    )
    return classify_heights(heights, coarse.variance, terrain_m.mean(axis=(1, 3)), limits)


def _crater_window(axis: FloatArray, centre: FloatArray, reach: float) -> tuple[slice, slice, FloatArray]:
    i, j = (slice(*np.searchsorted(axis, [c - reach, c + reach])) for c in centre)
    return i, j, np.hypot(axis[i, None] - centre[0], axis[None, j] - centre[1])


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: IoU and rate of hazards rated safe as functions of the noise, as SVG."""
    noise = figures["noise"]
    names = list(noise)
    iou: dict[str, list[Bar | None]] = {
        kind: [(noise[n]["iou"][kind],) * 3 for n in names] for kind in ("safe", "passable", "hazard")
    }
    rates = [noise[n]["hazards_rated_safe"] for n in names]
    wrong: dict[str, list[Bar | None]] = {
        "rate and 95 % bounds": [(100 * r["rate"], 100 * r["low"], 100 * r["high"]) for r in rates]
    }
    return chart(
        [
            Panel("intersection over union", names, iou, 1.0),
            Panel("hazards rated safe, % (grey: target)", names, wrong, 0.2, (0.0, 0.135)),
        ]
    )


def _joined(ratios: dict[str, float]) -> str:
    return " / ".join(f"{ratio:.3f}" for ratio in ratios.values())


def _iou_text(iou: float) -> str:
    """Return the IoU as text, bold if it is below the required value."""
    return f"{iou:.3f}" if iou >= REQUIRED_IOU else f"**{iou:.3f}**"


def _small_rate_text(rate: dict[str, Any]) -> str:
    """Return count, trials and rate with three decimals of a percent."""
    return f"{rate['count']} of {rate['trials']} ({100 * rate['count'] / rate['trials']:.3f} %)"


def table(figures: dict[str, Any]) -> str:
    """Return the tables: IoU of each class, and the results for each noise and for the simulated rovers."""
    rows = {f"noise {name} (1σ)": row for name, row in figures["noise"].items()}
    drives = {name: row for name, row in figures.items() if isinstance(row, dict) and "iou" in row}
    rows |= drives
    noisy = {name: row for name, row in figures["noise"].items() if name != "0 cm"}
    lines = [
        "| intersection over union (**bold**: below 0.9) | safe | passable | hazard |",
        "|---|---|---|---|",
    ]
    groups = {f"noise {' / '.join(noisy)}": list(noisy.values())} | {
        name: [row] for name, row in drives.items()
    }
    for name, group in groups.items():
        for ground, key in (("observed ground", "iou"), ("with holes", "iou_with_holes")):
            cells = (
                " / ".join(_iou_text(row[key][kind]) for row in group)
                for kind in ("safe", "passable", "hazard")
            )
            lines.append(f"| {name}, {ground} | {' | '.join(cells)} |")
    lines += [
        "",
        "| heights | rated safe, true hazard | largest excess over a limit "
        "| IoU safe / passable / hazard | with holes "
        "| hazards of exact heights against the same with a limit 1σ higher / one cell larger |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        iou, iou_with_holes, sensitivity = (
            _joined(row[key]) for key in ("iou", "iou_with_holes", "hazards_by_exact_heights")
        )
        lines.append(
            f"| {name} | {_small_rate_text(row['hazards_rated_safe'])} | {row['slope_beyond_deg']:.2f}°, "
            f"{100 * row['step_beyond_m']:.1f} cm | {iou} | {iou_with_holes} | {sensitivity} |"
        )
    lines += [
        "",
        f"Noise of 1 to 3 cm together: IoU safe / passable / hazard {_joined(figures['iou_of_all_noises'])}.",
    ]
    return "\n".join(lines)
