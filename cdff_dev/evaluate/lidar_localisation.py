# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation on simulated ground: recovery, search of the whole map, other ground, covariance, a drive.

The map is made of sweeps every 1.5 m along the first 60 m of the frozen scenario ``lidar_traverse``, each put down with
an error of its own, as a SLAM leaves them; what is wrong with the map is thus part of what is judged. A trial is a
sweep taken at rest, from anywhere within 3 m of the way and with any heading. Bounds are Clopper and Pearson's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import bounds
from cdff_dev.simulate.drive import settle
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.world import cast_scene, make_world

SCENARIO = "lidar_traverse"
#: Another seed of the same scenario: ground of the same kind that is not on the map.
OTHER_SEED = 7
TRIALS = 500
NEES_SEEDS = range(100)
MAP_TIMES_S = np.arange(2.0, 62.0, 1.5)
MAP_SIGMA_M, MAP_SIGMA_DEG = 0.01, 0.05
ASIDE_M = 3.0
GUESS_M, GUESS_DEG = 2.0, 20.0
LIMIT_M, LIMIT_DEG = 0.03, 0.1
#: An answer farther off than this is a wrong one, whatever it says of itself.
WRONG_M = 0.3
_PIECE = 300_000


class Place:
    """Ground of a scenario and seed, and sweeps on it."""

    def __init__(self, seed: int | None = None) -> None:
        self.scenario = load_scenario(SCENARIO, seed)
        world = make_world(self.scenario)
        self.relief, self._scene = world.relief, cast_scene(world.relief, world.rocks)
        (self._motion,) = world.motions.values()

    def sweep(self, T_site_base: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Points (n, 3) of a sweep at rest, in the lidar's frame."""
        return scan(self.scenario.lidar, self._scene, _AtRest(T_site_base), 0.0, rng).points_m

    def on_the_way(self, t_s: float) -> FloatArray:
        """``T_site_base`` of the drive."""
        return self._motion.poses(np.array([t_s]))[0]

    def beside_the_way(self, rng: np.random.Generator) -> FloatArray:
        """``T_site_base`` somewhere beside the mapped part of the way, with any heading."""
        middle = self.on_the_way(rng.uniform(MAP_TIMES_S[0] + 2.0, MAP_TIMES_S[-1] - 2.0))[:2, 3]
        xy, heading = middle + rng.uniform(-ASIDE_M, ASIDE_M, 2), rng.uniform(-np.pi, np.pi)
        return settle(self.relief, self.scenario.chassis, xy[None], np.array([heading]))[0]

    @cache  # noqa: B019  one instance for each seed, kept for the run
    def surveyed(self) -> list[tuple[FloatArray, FloatArray]]:
        """Pose of the lidar and points of each sweep that the map is made of."""
        rng = np.random.default_rng(0)
        mount = self.scenario.lidar.mount.matrix()
        poses = [self.on_the_way(t) for t in MAP_TIMES_S]
        return [(T @ mount, self.sweep(T, rng)) for T in poses]

    def map(self, seed: int) -> FloatArray:
        """Points (n, 3) of a map whose sweeps are put down with errors of this seed."""
        return np.vstack(self.pieces(seed))

    def pieces(self, seed: int) -> list[FloatArray]:
        """The same, sweep by sweep."""
        rng = np.random.default_rng([seed, 1])
        sigma = np.repeat([MAP_SIGMA_M, np.radians(MAP_SIGMA_DEG)], 3)
        return [se3.transform_points(T @ se3.exp_se3(sigma * rng.normal(size=6)), p) for T, p in self.surveyed()]


class _AtRest:
    """A motion that is none."""

    def __init__(self, T_site_base: FloatArray) -> None:
        self._T = T_site_base

    def poses(self, t_s: FloatArray) -> FloatArray:
        """``T_site_base (n, 4, 4)``."""
        return np.broadcast_to(self._T, (len(t_s), 4, 4))


@cache
def place(seed: int | None = None) -> Place:
    """The ground of a seed, made once."""
    return Place(seed)


def localiser(points_m: FloatArray, **config: Any) -> Dfpc:
    """Lidar localisation on a map."""
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure(config)
    for first in range(0, len(points_m), _PIECE):
        piece = Pointcloud.from_points(points_m[first : first + _PIECE], frame="site", stamp_ns=0)
        list(dfpc.step(Sample("map", 0, 0, piece)))
    return dfpc


def localised(dfpc: Dfpc, points_m: FloatArray, guess: UncertainTransform | None) -> Output:
    """The answer to one sweep, from a guess or from nothing."""
    dfpc.call("relocalise", {})
    if guess is not None:
        value = TransformWithCovariance.from_transform(guess, parent="site", child="lidar", stamp_ns=0)
        list(dfpc.step(Sample("guess", 0, 0, value)))
    at_once = np.zeros(len(points_m), np.uint32)
    sweep = LidarScan.from_arrays(points_m.astype(np.float32), at_once, frame="lidar", t0_ns=0, t1_ns=0)
    (output,) = dfpc.step(Sample("scan", 0, 0, sweep))
    return output


def trial(ground: Place, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True ``T_site_lidar``, a sweep from there, and a guess 2 m and 20 degrees off."""
    rng = np.random.default_rng([seed, 2])
    T = ground.beside_the_way(rng)
    points = ground.sweep(T, rng)
    T = T @ ground.scenario.lidar.mount.matrix()
    shift, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turned = se3.exp_so3(np.radians(GUESS_DEG) * axis) @ T[:3, :3]
    return T, points, se3.transform(turned, T[:3, 3] + GUESS_M * shift)


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures of all parts."""
    ground = place()
    dfpc = localiser(ground.map(0))
    near, anywhere, elsewhere = [], [], []
    for seed in range(TRIALS):
        progress(f"lidar localisation: trial {seed} of {TRIALS}")
        T, points, guess = trial(ground, seed)
        near.append((T, localised(dfpc, points, UncertainTransform(guess))))
        anywhere.append((T, localised(dfpc, points, None)))
        T, points, guess = trial(place(OTHER_SEED), seed)
        elsewhere.append(localised(dfpc, points, UncertainTransform(guess)))
    accepted = sum(o.quality.status is not Status.FAILED for o in elsewhere)
    return {
        "data": f"{SCENARIO} (simulated)",
        "map": {"sweeps": len(MAP_TIMES_S), "sigma_m": MAP_SIGMA_M, "sigma_deg": MAP_SIGMA_DEG},
        "seeds": [0, TRIALS - 1],
        "from 2 m and 20 deg off": rates(near),
        "from nothing": rates(anywhere),
        "on other ground": {"trials": TRIALS, "accepted": accepted, "accepted_95": bounds(accepted, TRIALS)},
        "covariance": covariance(ground, NEES_SEEDS, progress),
    }


def rates(answers: Iterable[tuple[FloatArray, Output]]) -> dict[str, Any]:
    """How many are right, wrong and refused, and the errors of those that are not refused."""
    errors, refused = [], 0
    for T, output in answers:
        if output.quality.status is Status.FAILED:
            refused += 1
            continue
        E = se3.inverse(T) @ output.value.transform.matrix
        errors.append((np.linalg.norm(E[:3, 3]), np.degrees(se3.rotation_angle(E[:3, :3]))))
    metres, degrees = np.array(errors).reshape(-1, 2).T
    trials = refused + len(errors)
    good = int(np.sum((metres <= LIMIT_M) & (degrees <= LIMIT_DEG)))
    wrong = int(np.sum(metres > WRONG_M))
    return {
        "trials": trials, "within_3_cm_and_0.1_deg": good, "within_95": bounds(good, trials),
        "refused": refused, "wrong": wrong, "wrong_95": bounds(wrong, trials),
        "translation_m": spread(metres, 5), "rotation_deg": spread(degrees, 5),
    }  # fmt: skip


def covariance(ground: Place, seeds: Iterable[int], progress: Callable[[str], None]) -> dict[str, Any]:
    """Normalised squared errors of one sweep on each of many maps, every one with errors of its own."""
    nees, sigma_m, sigma_deg = [], [], []
    for seed in seeds:
        progress(f"lidar localisation: covariance, seed {seed}")
        T, points, _ = trial(ground, 100_000 + seed)
        output = localised(localiser(ground.map(seed + 1)), points, UncertainTransform(T))
        if output.quality.status is Status.FAILED:
            continue
        found = output.value.transform
        e = pose_error(T, found.matrix)
        nees.append(float(e @ np.linalg.solve(found.covariance, e)))
        sigma = np.sqrt(np.diag(found.covariance))
        sigma_m.append(sigma[:3].mean())
        sigma_deg.append(np.degrees(sigma[3:]).mean())
    n = len(nees)
    return {
        "seeds": n, "expected": 6.0, "mean_nees": round(float(np.mean(nees)), 3),
        "band_95": [round(float(v) / n, 3) for v in chi2.ppf([0.025, 0.975], 6 * n)],
        "nees": spread(nees, 3), "mean_sigma_m": round(float(np.mean(sigma_m)), 5),
        "mean_sigma_deg": round(float(np.mean(sigma_deg)), 5),
    }  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """Right, refused and wrong answers of each kind of trial, and the covariance."""
    lines = [
        "| simulated | found | within 3 cm and 0.1° | median error | greatest | refused | wrong |",
        "|---" * 7 + "|",
    ]
    for name in ("from 2 m and 20 deg off", "from nothing"):
        row = figures[name]
        m, d = row["translation_m"], row["rotation_deg"]
        found = row["trials"] - row["refused"] - row["wrong"]
        lines.append(
            f"| {name.replace(' deg', '°')} | {_rate(found, row['trials'], bounds(found, row['trials']))} "
            f"| {_rate(row['within_3_cm_and_0.1_deg'], row['trials'], row['within_95'])} "
            f"| {1e3 * m['median']:.1f} mm, {d['median']:.3f}° | {1e3 * m['max']:.1f} mm, {d['max']:.3f}° "
            f"| {row['refused']} | {_rate(row['wrong'], row['trials'], row['wrong_95'])} |"
        )
    other = figures["on other ground"]
    wrong = _rate(other["accepted"], other["trials"], other["accepted_95"])
    lines.append(f"| on other ground | – | – | – | – | {other['trials'] - other['accepted']} | {wrong} |")
    c = figures["covariance"]
    low, high = c["band_95"]
    lines += [
        "",
        f"Covariance over {c['seeds']} held-out maps: mean squared normalised error {c['mean_nees']:.2f} (6 expected, "
        f"95 % band {low:.2f} to {high:.2f}), mean sigma of an axis {1e3 * c['mean_sigma_m']:.1f} mm and "
        f"{c['mean_sigma_deg']:.3f}°.",
    ]
    return "\n".join(lines)


def _rate(count: int, trials: int, bounds: list[float]) -> str:
    return f"{count} of {trials} ({100 * bounds[0]:.1f}–{100 * bounds[1]:.1f} %)"
