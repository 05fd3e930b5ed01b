# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is called safe against the true terrain: noise put on true heights, and maps of simulated lidar sweeps.

A cell is judged by the same rating of the true heights without noise. "Not safe" is what is a hazard there: over a
limit of slope or roughness, or within the rover's half width and margin of a step over its limit. Seeds here were not
used to choose anything.

Intersection over union is where sigma is at most 3 cm, and against what exact heights of the observed cells give: it
says what noise costs. What holes cost is beside it: the same against exact heights everywhere. How much the hazards'
figure says is told by exact heights alone: their hazards against those with a step limit higher by a sigma, and against
themselves grown by a cell.
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
from cdff_core.dfns.traversability._interface import TraversabilityInputs
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.registration.rates import interval
from cdff_dev.simulate.relief import crater_profile, fractal_tile, power_law_sizes

PROFILE = Path(__file__).resolve().parents[2] / "deploy" / "profiles" / "rover_traverse.yaml"
#: Intersection over union that is asked for.
ASKED_IOU = 0.9
LIMITS = ("length_m", "width_m", "max_slope_deg", "max_step_m", "max_roughness_m")
SEEDS, SIGMAS_M = range(100, 120), (0.0, 0.01, 0.02, 0.03)
EDGE_M, CELL_M, FINE_M = 40.0, 0.1, 0.025
UNKNOWN, SAFE, CAUTION, HAZARD = range(4)
#: What is compared, and its classes.
KINDS = {"safe": (SAFE,), "passable": (SAFE, CAUTION), "hazard": (HAZARD,)}


@dataclass(frozen=True, slots=True, eq=False)
class Rated:
    """Maps of the heights as seen, of the true ones where they were seen, and of all true ones; sigma of each cell.

    ``lenient`` is ``exact`` with a step limit higher by the median sigma.
    """

    found: NavigationMap
    exact: NavigationMap
    lenient: NavigationMap
    truth: NavigationMap
    sigma_m: FloatArray


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Scores over all seeds at each noise, and of lidar maps."""
    del data
    limits = rover_limits()
    report: dict[str, Any] = {"limits": limits, "cell_m": CELL_M, "seeds": [SEEDS[0], SEEDS[-1]], "noise": {}}
    for sigma_m in SIGMAS_M:
        progress(f"navigation_mapping: noise {sigma_m} m")
        maps = [rated_maps(seed, sigma_m, limits) for seed in SEEDS]
        report["noise"][f"{100 * sigma_m:g} cm"] = scores(maps, limits)
    noisy = [report["noise"][f"{100 * sigma_m:g} cm"]["iou_cells"] for sigma_m in SIGMAS_M if sigma_m > 0.0]
    together = {kind: np.sum([cells[kind] for cells in noisy], axis=0).tolist() for kind in KINDS}
    report["iou_of_all_noises"] = _ratios(together)
    report["rover_traverse (simulated), lidar, true poses"] = _simulated(limits, progress)
    return report


def rover_limits() -> dict[str, float]:
    """Those of the rover of the demonstration."""
    limits = load_profile(PROFILE).robots[0].limits
    return {name: limits[name] for name in LIMITS}


@cache
def true_heights(seed: int) -> FloatArray:
    """Mean heights of cells of ``CELL_M``: hills and craters steeper than the rover climbs, rocks it cannot take."""
    rng = np.random.default_rng([seed, 21])
    n = round(EDGE_M / FINE_M)
    z = fractal_tile(rng, n, FINE_M, (4.0, 40.0), 0.8, np.tan(np.radians(9.0)))
    z += fractal_tile(rng, n, FINE_M, (0.15, 4.0), 0.8, np.tan(np.radians(3.5)))
    axis = (np.arange(n) + 0.5) * FINE_M
    for diameter in power_law_sizes(rng, 12, 1.5, 8.0, 1.5):
        i, j, r = _around(axis, rng.uniform(0.0, EDGE_M, 2), 1.5 * diameter)
        z[i, j] += crater_profile(r, diameter, diameter * rng.uniform(0.1, 0.25), 0.04 * diameter)
    for diameter in power_law_sizes(rng, 500, 0.1, 1.2, 2.0):
        i, j, r = _around(axis, rng.uniform(0.0, EDGE_M, 2), diameter)
        z[i, j] += rng.uniform(0.6, 1.2) * np.sqrt(np.maximum(0.25 * diameter**2 - r**2, 0.0))
    k = round(CELL_M / FINE_M)
    return np.asarray(z.reshape(n // k, k, n // k, k).mean(axis=(1, 3)))


def rated_maps(seed: int, sigma_m: float, limits: dict[str, float]) -> Rated:
    """True heights with noise, and with holes over 15 % of the ground."""
    truth, rng = true_heights(seed), np.random.default_rng([seed, 22])
    hidden = gaussian_filter(rng.normal(size=truth.shape), 3.0)
    seen = hidden < np.quantile(hidden, 0.85)
    noisy = np.where(seen, truth + rng.normal(0.0, 1.0, truth.shape) * sigma_m, np.nan)
    return compared(noisy, np.where(seen, sigma_m**2, np.nan), truth, limits)


def compared(heights: FloatArray, variance: FloatArray, truth: FloatArray, limits: dict[str, float]) -> Rated:
    """The three maps of heights with their variances and of the true heights."""
    seen = np.isfinite(heights)
    exact = {**limits, "sigmas": 0.0}
    sigma = np.where(seen, np.sqrt(np.where(seen, variance, 0.0)), np.inf)
    there = np.where(seen, truth, np.nan)
    higher = {**exact, "max_step_m": limits["max_step_m"] + float(np.median(sigma[seen]))}
    return Rated(
        rated(heights, limits, variance), rated(there, exact), rated(there, higher), rated(truth, exact), sigma
    )  # fmt: skip


def rated(heights: FloatArray, config: dict[str, float], variance: FloatArray | None = None) -> NavigationMap:
    """What ``traversability`` makes of heights."""
    rows, cols = heights.shape
    geometry = GridGeometry("site", CELL_M, 0.0, rows * CELL_M, rows, cols)
    layers = {"mean": heights} if variance is None else {"mean": heights, "variance": variance}
    dem = ElevationMap.from_layers(geometry, {k: v.astype(np.float32) for k, v in layers.items()}, t0_ns=0, t1_ns=0)
    node = Registry.default().make_dfn("traversability")
    node.configure(config)
    return node.process(TraversabilityInputs(dem=dem)).map


def scores(maps: list[Rated], limits: dict[str, float]) -> dict[str, Any]:
    """Cells called safe that are not, by how much, and how far the classes agree."""
    safe = wrong = 0
    cells = _agreement(maps, "exact")
    slope_deg = step_m = -np.inf
    for m in maps:
        a, b = m.found.layer("class"), m.truth.layer("class")
        called = (a == SAFE) & (b != UNKNOWN)
        safe += int(called.sum())
        wrong += int((called & (b == HAZARD)).sum())
        if called.any():
            slope_deg = max(slope_deg, float(np.nanmax(m.truth.layer("slope_deg")[called])) - limits["max_slope_deg"])
            step_m = max(step_m, _highest_step(m.truth, called, limits) - limits["max_step_m"])
    return {
        "called_safe_but_hazard": interval(wrong, safe), "slope_beyond_deg": round(slope_deg, 3),
        "step_beyond_m": round(step_m, 4), "iou": _ratios(cells), "iou_cells": cells,
        "iou_with_holes": _ratios(_agreement(maps, "truth")), "hazards_by_exact_heights": _hazards_alone(maps),
    }  # fmt: skip


def _agreement(maps: list[Rated], other: str) -> dict[str, list[int]]:
    """Cells of a kind in both maps, and in either: safe, passable (safe or caution), hazard."""
    cells = {kind: [0, 0] for kind in KINDS}
    for m in maps:
        a, b = m.found.layer("class"), getattr(m, other).layer("class")
        sharp = (m.sigma_m <= 0.03 + 1e-6) & (a != UNKNOWN) & (b != UNKNOWN)
        for kind, classes in KINDS.items():
            ours, theirs = sharp & np.isin(a, classes), sharp & np.isin(b, classes)
            cells[kind][0] += int((ours & theirs).sum())
            cells[kind][1] += int((ours | theirs).sum())
    return cells


def _hazards_alone(maps: list[Rated]) -> dict[str, float]:
    """What hazards by exact heights have in common with those of a limit higher by a sigma, and grown by a cell."""
    cells = {"limit_higher_by_a_sigma": [0, 0], "grown_by_a_cell": [0, 0]}
    for m in maps:
        exact = m.exact.layer("class")
        known, hazard = exact != UNKNOWN, exact == HAZARD
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        grown = known & (cv2.dilate(hazard.astype(np.uint8), cross) > 0)
        for name, other in (
            ("limit_higher_by_a_sigma", m.lenient.layer("class") == HAZARD),
            ("grown_by_a_cell", grown),
        ):
            cells[name][0] += int((hazard & other).sum())
            cells[name][1] += int((hazard | other).sum())
    return _ratios(cells)


def _ratios(cells: dict[str, list[int]]) -> dict[str, float]:
    return {kind: round(both / max(either, 1), 4) for kind, (both, either) in cells.items()}


def _highest_step(truth: NavigationMap, called: np.ndarray, limits: dict[str, float]) -> float:
    """Of the true steps within half the rover's width of cells called safe."""
    reach = round(0.5 * min(limits["width_m"], limits["length_m"]) / CELL_M)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    steps = np.nan_to_num(truth.layer("step_m"), nan=0.0)
    return float(cv2.dilate(steps, disc)[called].max())


def _simulated(limits: dict[str, float], progress: Callable[[str], None]) -> dict[str, Any]:
    """The demonstration's log mapped with its true poses, both rovers, in cells of ``CELL_M``."""
    from cdff_common.interfaces.dfpc import Sample
    from cdff_dev.evaluate._dem_drives import mapped
    from cdff_dev.logs import open_log
    from cdff_dev.simulate.scenario import load_scenario
    from cdff_dev.simulate.store import simulated_log

    progress("navigation_mapping: simulated traverse")
    log, profile = open_log(simulated_log(load_scenario("rover_traverse"))), load_profile(PROFILE)
    terrain = next(iter(log.samples(["/site/truth.terrain"]))).value
    maps = []
    for robot in profile.robot_ids:
        entry = profile.robot(robot)
        ports = {f"/{robot}/truth.pose": "poses", f"/{robot}/lidar.scan": "scan"}
        samples = (Sample(ports[s.stream], s.stamp_ns, s.seq, s.value) for s in log.samples(list(ports)))
        context = entry.context(entry.dfpc("digital_elevation_mapping"))
        dem = mapped(samples, context, "Lidar", {"resolution_m": 0.05, "fusion": {"size_m": 40.0}})
        maps.append(_coarse(dem, terrain, limits))
    return scores(maps, limits)


def _coarse(dem: ElevationMap, terrain: ElevationMap, limits: dict[str, float]) -> Rated:
    layers = {name: dem.layer(name) for name in dem.layer_names}
    coarse = aggregate_to(CellStatistics.from_layers(dem.geometry, layers, dem.t1_ns), CELL_M)
    g = coarse.geometry
    heights = np.where(coarse.observed, coarse.mean, np.nan)
    fine = terrain.geometry
    factor = max(1, round(CELL_M / fine.resolution_m))
    sub = (np.arange(g.cols * factor) + 0.5) * CELL_M / factor + g.xmin_m
    down = g.ymax_m - (np.arange(g.rows * factor) + 0.5) * CELL_M / factor
    x, y = np.meshgrid(sub, down)
    r, c, inside = fine.cells_of(x.ravel(), y.ravel())
    true = np.where(inside, terrain.layer("mean")[r, c], np.nan).reshape(g.rows, factor, g.cols, factor)
    return compared(heights, coarse.variance, true.mean(axis=(1, 3)), limits)


def _around(axis: FloatArray, centre: FloatArray, reach: float) -> tuple[slice, slice, FloatArray]:
    i, j = (slice(*np.searchsorted(axis, [c - reach, c + reach])) for c in centre)
    return i, j, np.hypot(axis[i, None] - centre[0], axis[None, j] - centre[1])


def draw(figures: dict[str, Any]) -> bytes:
    """Intersection over union, and what is called safe and is not, over the noise."""
    noise = figures["noise"]
    names = list(noise)
    iou: dict[str, list[Bar | None]] = {
        kind: [(noise[n]["iou"][kind],) * 3 for n in names] for kind in ("safe", "passable", "hazard")
    }
    rates = [noise[n]["called_safe_but_hazard"] for n in names]
    wrong: dict[str, list[Bar | None]] = {
        "rate and 95 % bounds": [(100 * r["rate"], 100 * r["low"], 100 * r["high"]) for r in rates]
    }
    return chart(
        [
            Panel("intersection over union", names, iou, 1.0),
            Panel("called safe, a hazard in truth, % (grey: allowed)", names, wrong, 0.2, (0.0, 0.135)),
        ]
    )


def _shown(shares: dict[str, float]) -> str:
    return " / ".join(f"{share:.3f}" for share in shares.values())


def _against(share: float) -> str:
    """A share, bold where it misses what is asked."""
    return f"{share:.3f}" if share >= ASKED_IOU else f"**{share:.3f}**"


def _rarely(rate: dict[str, Any]) -> str:
    """A rate of some in a million."""
    return f"{rate['count']} of {rate['trials']} ({100 * rate['count'] / rate['trials']:.3f} %)"


def table(figures: dict[str, Any]) -> str:
    """What reaches 0.9 and what does not; one row per noise, and the simulated rovers."""
    rows = {f"noise {name} (1σ)": row for name, row in figures["noise"].items()}
    drives = {name: row for name, row in figures.items() if isinstance(row, dict) and "iou" in row}
    rows |= drives
    noisy = {name: row for name, row in figures["noise"].items() if name != "0 cm"}
    lines = ["| intersection over union (**bold**: below 0.9) | safe | passable | hazard |", "|---|---|---|---|"]
    together = {f"noise {' / '.join(noisy)}": list(noisy.values())} | {name: [row] for name, row in drives.items()}
    for name, some in together.items():
        for beside, key in (("observed ground", "iou"), ("with holes", "iou_with_holes")):
            cells = (" / ".join(_against(row[key][kind]) for row in some) for kind in ("safe", "passable", "hazard"))
            lines.append(f"| {name}, {beside} | {' | '.join(cells)} |")
    lines += [
        "",
        "| heights | called safe, a hazard in truth | farthest beyond a limit "
        "| IoU safe / passable / hazard | with holes | hazard, exact, limit 1σ higher / grown by a cell |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        iou, holes, alone = (_shown(row[name]) for name in ("iou", "iou_with_holes", "hazards_by_exact_heights"))
        lines.append(
            f"| {name} | {_rarely(row['called_safe_but_hazard'])} | {row['slope_beyond_deg']:.2f}°, "
            f"{100 * row['step_beyond_m']:.1f} cm | {iou} | {holes} | {alone} |"
        )
    lines += ["", f"Noise of 1 to 3 cm together: IoU safe / passable / hazard {_shown(figures['iou_of_all_noises'])}."]
    return "\n".join(lines)
