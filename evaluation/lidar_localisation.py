# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate lidar localisation on simulated ground: with a wrong guess, without a guess, and off the map.

The map consists of sweeps every 1.5 m along the first 60 m of the frozen scenario ``lidar_traverse``. The
pose of each sweep has an independent error, as in a SLAM map; the errors of the map are therefore part of
the result. A trial is a sweep recorded at rest, at a random position within 3 m of the path and with a
random heading. Intervals are those of Clopper and Pearson.
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
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import bounds
from cdff_dev.simulate.lidar import scan
from cdff_dev.simulate.rover_motion import settle
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.world import cast_scene, make_world

SCENARIO = "lidar_traverse"
#: Seed of the same scenario for other ground, which is not on the map.
OTHER_SEED = 7
TRIALS = 500
NEES_SEEDS = range(100)
#: Times of the sweeps of the map, and the standard deviations of their pose errors.
MAP_TIMES_S = np.arange(2.0, 62.0, 1.5)
MAP_SIGMA_M, MAP_SIGMA_DEG = 0.01, 0.05
#: Largest distance of a trial from the path, along x and along y.
ASIDE_M = 3.0
#: Error of an initial guess, metres and degrees.
GUESS_M, GUESS_DEG = 2.0, 20.0
#: Largest errors of an accurate answer, metres and degrees.
LIMIT_M, LIMIT_DEG = 0.03, 0.1
#: An answer with a larger error is wrong, whatever its covariance.
WRONG_M = 0.3
#: Number of points of the map in one sample.
_PIECE = 300_000


class SimulatedGround:
    """The simulated ground of a seed, and sweeps recorded on it."""

    def __init__(self, seed: int | None = None) -> None:
        self.scenario = load_scenario(SCENARIO, seed)
        world = make_world(self.scenario)
        self.relief, self._scene = world.relief, cast_scene(world.relief, world.rocks)
        (self._motion,) = world.motions.values()

    def sweep(self, T_site_base: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the points (n, 3) of a sweep recorded at rest, in the lidar frame, metres."""
        return scan(self.scenario.lidar, self._scene, _AtRest(T_site_base), 0.0, rng).points_m

    def on_path(self, t_s: float) -> FloatArray:
        """Return ``T_site_base`` of the drive at a time."""
        return self._motion.poses(np.array([t_s]))[0]

    def near_path(self, rng: np.random.Generator) -> FloatArray:
        """Return a random ``T_site_base`` near the mapped part of the path, with any heading."""
        xy_on_path = self.on_path(rng.uniform(MAP_TIMES_S[0] + 2.0, MAP_TIMES_S[-1] - 2.0))[:2, 3]
        xy, heading = xy_on_path + rng.uniform(-ASIDE_M, ASIDE_M, 2), rng.uniform(-np.pi, np.pi)
        return settle(self.relief, self.scenario.chassis, xy[None], np.array([heading]))[0]

    @cache  # noqa: B019  one instance for each seed, kept for the run
    def map_sweeps(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the true ``T_site_lidar`` and the points of each sweep of the map."""
        rng = np.random.default_rng(0)
        mount = self.scenario.lidar.mount.matrix()
        poses = [self.on_path(t) for t in MAP_TIMES_S]
        return [(T @ mount, self.sweep(T, rng)) for T in poses]

    def map(self, seed: int) -> FloatArray:
        """Return the points (n, 3) of a map; the seed selects the pose errors of its sweeps."""
        return np.vstack(self.pieces(seed))

    def pieces(self, seed: int) -> list[FloatArray]:
        """Return the points (n, 3) of each sweep of the map in the site frame."""
        rng = np.random.default_rng([seed, 1])
        sigma = np.repeat([MAP_SIGMA_M, np.radians(MAP_SIGMA_DEG)], 3)
        return [
            se3.transform_points(T @ se3.exp_se3(sigma * rng.normal(size=6)), p) for T, p in self.map_sweeps()
        ]


class _AtRest:
    """The motion of a robot at rest."""

    def __init__(self, T_site_base: FloatArray) -> None:
        self._T = T_site_base

    def poses(self, t_s: FloatArray) -> FloatArray:
        """Return the constant pose for each time, ``T_site_base (n, 4, 4)``."""
        return np.broadcast_to(self._T, (len(t_s), 4, 4))


@cache
def simulated_ground(seed: int | None = None) -> SimulatedGround:
    """Return the simulated ground of a seed (cached)."""
    return SimulatedGround(seed)


def make_localiser(points_m: FloatArray, **config: Any) -> Dfpc:
    """Return the DFPC configured with a map."""
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure(config)
    for start in range(0, len(points_m), _PIECE):
        piece = Pointcloud.from_points(points_m[start : start + _PIECE], frame="site", stamp_ns=0)
        list(dfpc.step(Sample("map", 0, 0, piece)))
    return dfpc


def localise(dfpc: Dfpc, points_m: FloatArray, guess: UncertainTransform | None) -> Output:
    """Return the output for one sweep, with a guess or without."""
    dfpc.call("relocalise", {})
    if guess is not None:
        value = TransformWithCovariance.from_transform(guess, parent="site", child="lidar", stamp_ns=0)
        list(dfpc.step(Sample("guess", 0, 0, value)))
    point_times = np.zeros(len(points_m), np.uint32)
    sweep = LidarScan.from_arrays(points_m.astype(np.float32), point_times, frame="lidar", t0_ns=0, t1_ns=0)
    (output,) = dfpc.step(Sample("scan", 0, 0, sweep))
    return output


def trial(ground: SimulatedGround, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the true ``T_site_lidar``, a sweep from this pose, and a guess with an error of 2 m and 20
    degrees.
    """
    rng = np.random.default_rng([seed, 2])
    T = ground.near_path(rng)
    points = ground.sweep(T, rng)
    T = T @ ground.scenario.lidar.mount.matrix()
    direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R_guess = se3.exp_so3(np.radians(GUESS_DEG) * axis) @ T[:3, :3]
    return T, points, se3.transform(R_guess, T[:3, 3] + GUESS_M * direction)


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results for each kind of start, and the consistency of the covariance."""
    ground = simulated_ground()
    dfpc = make_localiser(ground.map(0))
    with_guess, without_guess, off_map = [], [], []
    for seed in range(TRIALS):
        progress(f"lidar localisation: trial {seed} of {TRIALS}")
        T, points, guess = trial(ground, seed)
        with_guess.append((T, localise(dfpc, points, UncertainTransform(guess))))
        without_guess.append((T, localise(dfpc, points, None)))
        T, points, guess = trial(simulated_ground(OTHER_SEED), seed)
        off_map.append(localise(dfpc, points, UncertainTransform(guess)))
    accepted = sum(o.quality.status is not Status.FAILED for o in off_map)
    return {
        "data": f"{SCENARIO} (simulated)",
        "map": {"sweeps": len(MAP_TIMES_S), "sigma_m": MAP_SIGMA_M, "sigma_deg": MAP_SIGMA_DEG},
        "seeds": [0, TRIALS - 1],
        "from 2 m and 20 deg off": rates(with_guess),
        "without a guess": rates(without_guess),
        "other ground": {"trials": TRIALS, "accepted": accepted, "accepted_95": bounds(accepted, TRIALS)},
        "covariance": covariance(ground, NEES_SEEDS, progress),
    }


def rates(answers: Iterable[tuple[FloatArray, Output]]) -> dict[str, Any]:
    """Return the numbers of accurate, wrong and refused answers, and the errors of accepted answers."""
    errors, refused = [], 0
    for T, output in answers:
        if output.quality.status is Status.FAILED:
            refused += 1
            continue
        E = se3.inverse(T) @ output.value.transform.matrix
        errors.append((np.linalg.norm(E[:3, 3]), np.degrees(se3.rotation_angle(E[:3, :3]))))
    metres, degrees = np.array(errors).reshape(-1, 2).T
    trials = refused + len(errors)
    accurate = int(np.sum((metres <= LIMIT_M) & (degrees <= LIMIT_DEG)))
    wrong = int(np.sum(metres > WRONG_M))
    return {
        "trials": trials,
        "within_3_cm_and_0.1_deg": accurate,
        "within_95": bounds(accurate, trials),
        "refused": refused,
        "wrong": wrong,
        "wrong_95": bounds(wrong, trials),
        "translation_m": error_summary(metres, 5),
        "rotation_deg": error_summary(degrees, 5),
    }


def covariance(
    ground: SimulatedGround, seeds: Iterable[int], progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return the NEES of one sweep on each of many maps with different pose errors."""
    nees, sigma_m, sigma_deg = [], [], []
    for seed in seeds:
        progress(f"lidar localisation: covariance, seed {seed}")
        T, points, _ = trial(ground, 100_000 + seed)
        output = localise(make_localiser(ground.map(seed + 1)), points, UncertainTransform(T))
        if output.quality.status is Status.FAILED:
            continue
        result = output.value.transform
        error = pose_error(T, result.matrix)
        nees.append(float(error @ np.linalg.solve(result.covariance, error)))
        sigma = np.sqrt(np.diag(result.covariance))
        sigma_m.append(sigma[:3].mean())
        sigma_deg.append(np.degrees(sigma[3:]).mean())
    n = len(nees)
    return {
        "seeds": n,
        "expected": 6.0,
        "mean_nees": round(float(np.mean(nees)), 3),
        "band_95": [round(float(v) / n, 3) for v in chi2.ppf([0.025, 0.975], 6 * n)],
        "nees": error_summary(nees, 3),
        "mean_sigma_m": round(float(np.mean(sigma_m)), 5),
        "mean_sigma_deg": round(float(np.mean(sigma_deg)), 5),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table of accurate, refused and wrong answers, and the consistency of the covariance."""
    lines = [
        "| start (simulated) | localised | within 3 cm and 0.1° | median error | maximum | refused | wrong |",
        "|---" * 7 + "|",
    ]
    for name in ("from 2 m and 20 deg off", "without a guess"):
        row = figures[name]
        translation, rotation = row["translation_m"], row["rotation_deg"]
        result = row["trials"] - row["refused"] - row["wrong"]
        start = name.replace(" deg", "°")
        lines.append(
            f"| {start} | {_rate(result, row['trials'], bounds(result, row['trials']))} "
            f"| {_rate(row['within_3_cm_and_0.1_deg'], row['trials'], row['within_95'])} "
            f"| {1e3 * translation['median']:.1f} mm, {rotation['median']:.3f}° "
            f"| {1e3 * translation['max']:.1f} mm, {rotation['max']:.3f}° "
            f"| {row['refused']} | {_rate(row['wrong'], row['trials'], row['wrong_95'])} |"
        )
    other = figures["other ground"]
    wrong = _rate(other["accepted"], other["trials"], other["accepted_95"])
    lines.append(f"| other ground | – | – | – | – | {other['trials'] - other['accepted']} | {wrong} |")
    stated = figures["covariance"]
    low, high = stated["band_95"]
    lines += [
        "",
        f"Covariance over {stated['seeds']} held-out maps: mean NEES {stated['mean_nees']:.2f} "
        f"(6 expected, 95 % band {low:.2f} to {high:.2f}), mean sigma of an axis "
        f"{1e3 * stated['mean_sigma_m']:.1f} mm and {stated['mean_sigma_deg']:.3f}°.",
    ]
    return "\n".join(lines)


def _rate(count: int, trials: int, bounds: list[float]) -> str:
    return f"{count} of {trials} ({100 * bounds[0]:.1f}–{100 * bounds[1]:.1f} %)"
