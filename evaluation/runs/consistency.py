# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate errors and NEES of the position manager on many simulated drives, and of a GTSAM smoother."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_dev.compare.error_summary import error_summary
from evaluation.runs.dead_reckoning import SimulatedRun, shared_fixes, simulate_drive
from evaluation.runs.traverse import EXACT_MOUNTS, normalised_error

#: Seeds with which parameters were chosen; no result uses them. Seeds up to 349 were used in earlier tests.
TRAINING = range(1000, 1060)
HELD_OUT = range(350, 400)
PATH_LENGTH_M = 10.0
_WHEELS_AND_IMU = ("imu", "odometry")
#: Name -> ports, parameters, and the fraction of the error variance of fixes that is common to a drive.
SETS: dict[str, tuple[tuple[str, ...], dict[str, Any], float]] = {
    "wheels, imu, vo": ((*_WHEELS_AND_IMU, "visual_odometry"), {}, 0.0),
    "wheels, imu, lidar odometry": ((*_WHEELS_AND_IMU, "lidar_odometry"), {}, 0.0),
    "with fixes": ((*_WHEELS_AND_IMU, "visual_odometry", "fix"), {"fixes": {"weighting": "kalman"}}, 0.0),
    "wheels, imu": (_WHEELS_AND_IMU, {}, 0.0),
    "fixes of one map, intersection": (
        (*_WHEELS_AND_IMU, "fix"),
        {"fixes": {"weighting": "intersection"}},
        0.9,
    ),
    "fixes of one map, assumed independent": (
        (*_WHEELS_AND_IMU, "fix"),
        {"fixes": {"weighting": "kalman"}},
        0.9,
    ),
}
#: Number of drives for GTSAM and for the sets ``FEWER_SETS``, which have no consistency limit.
FEWER = 5
PEER_SETS = ("wheels, imu, vo",)
FEWER_SETS = ("wheels, imu", "fixes of one map, intersection", "fixes of one map, assumed independent")


#: Method, name of the set, error in percent of the path length, NEES, CPU seconds per second of input.
Trial = tuple[str, str, float, float, float]


def consistency(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results over the held-out seeds."""
    trials: list[Trial] = []
    for k, seed in enumerate(HELD_OUT):
        progress(f"position manager: drive {k + 1} of {len(HELD_OUT)}")
        trials += trials_of(seed, with_all=k < FEWER)
    degrees = 6 * len(HELD_OUT)
    return {
        "data": "measurements simulated by evaluation.runs.dead_reckoning, no images, no sweeps",
        "drives": len(HELD_OUT),
        "seeds": [HELD_OUT.start, HELD_OUT.stop - 1],
        "training_seeds": [TRAINING.start, TRAINING.stop - 1],
        "path_length_m": PATH_LENGTH_M,
        "band": [round(float(chi2.ppf(q, degrees)) / len(HELD_OUT), 3) for q in (0.025, 0.975)],
        **{
            method: _summary([t for t in trials if t[0] == method])
            for method in ("position_manager", "gtsam")
        },
    }


def _summary(trials: list[Trial]) -> dict[str, Any]:
    """Return the results of each set of sources."""
    results = {}
    for name in dict.fromkeys(t[1] for t in trials):
        _, _, errors, squared, cpu_s = zip(*(t for t in trials if t[1] == name), strict=True)
        results[name] = {
            "drives": len(errors),
            "end_error_percent": error_summary(errors),
            "nees": error_summary(squared),
            "mean_nees": round(float(np.mean(squared)), 3),
            "cpu_s_per_input_s": round(float(np.median(cpu_s)), 4),
        }
    return results


def trials_of(seed: int, *, with_all: bool) -> list[Trial]:
    """Return the trials of all sets on one drive; ``with_all`` includes GTSAM and ``FEWER_SETS``."""
    from evaluation.peers.gtsam_smoother import smooth

    drive = simulate_drive(seed, PATH_LENGTH_M, ground=10 + seed % 4)
    trials = []
    for name, (ports, parameters, shared) in SETS.items():
        if name in FEWER_SETS and not with_all:
            continue
        samples = select_samples(drive, ports, shared)
        started_s = time.process_time()
        pose = last_pose(drive, samples, parameters)
        trials.append(_trial(drive, "position_manager", name, pose, started_s))
        if name in PEER_SETS and with_all:
            started_s = time.process_time()
            trials.append(_trial(drive, "gtsam", name, smooth(drive, ports), started_s))
    return trials


def select_samples(drive: SimulatedRun, ports: tuple[str, ...], shared: float) -> list[Sample]:
    """Return the samples of some ports in time order; ``shared``: see ``shared_fixes``."""
    samples = {**drive.samples, **({"fix": shared_fixes(drive, shared)} if shared else {})}
    return sorted((s for port in ports for s in samples[port]), key=lambda s: (s.stamp_ns, s.port))


def last_pose(
    drive: SimulatedRun, samples: list[Sample], parameters: dict[str, Any]
) -> tuple[int, UncertainTransform]:
    """Return stamp and value of the last pose of the position manager."""
    node = Registry.default().make_dfpc("position_manager")
    node.configure({**EXACT_MOUNTS, **parameters}, drive.context)
    last = None
    for sample in samples:
        for output in node.step(sample):
            last = output if output.port == "pose" else last
    assert last is not None  # every drive has poses
    return last.t1_ns, last.value.transform


def _trial(
    drive: SimulatedRun, method: str, name: str, pose: tuple[int, UncertainTransform], started_s: float
) -> Trial:
    cpu_s = (time.process_time() - started_s) / drive.duration_s
    error_m, nees = normalised_error(drive.truth(pose[0]), pose[1])
    return method, name, 100.0 * error_m / drive.path_length_m, nees, cpu_s
