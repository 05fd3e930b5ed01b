# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors and consistency of the position manager over many simulated drives, beside a smoother of GTSAM."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_dev.evaluate._dead_reckoning import Travel, shared_fixes, travel
from cdff_dev.evaluate._gtsam_smoother import smoothed
from cdff_dev.evaluate.record import spread
from cdff_dev.evaluate.traverse import normalised_error

#: Seeds by which parameters were chosen; they are in no figure. Those up to 349 were looked at before.
TRAINING = range(1000, 1060)
HELD_OUT = range(350, 400)
WAY_M = 10.0
_FELT = ("imu", "odometry")
#: Name -> ports, parameters, and the share of the fixes' errors that is common to a drive.
SETS: dict[str, tuple[tuple[str, ...], dict[str, Any], float]] = {
    "wheels, imu, vo": ((*_FELT, "visual_odometry"), {}, 0.0),
    "wheels, imu, lidar odometry": ((*_FELT, "lidar_odometry"), {}, 0.0),
    "with fixes": ((*_FELT, "visual_odometry", "fix"), {"fix_weighting": "kalman"}, 0.0),
    "wheels, imu": (_FELT, {}, 0.0),
    "fixes of one map, intersection": ((*_FELT, "fix"), {"fix_weighting": "intersection"}, 0.9),
    "fixes of one map, as if independent": ((*_FELT, "fix"), {"fix_weighting": "kalman"}, 0.9),
}
#: Drives of the peer, and of what is not asked to be consistent; fewer, since they cost more or say less.
FEWER = 5
PEER_SETS = ("wheels, imu, vo",)
FEWER_SETS = ("wheels, imu", "fixes of one map, intersection", "fixes of one map, as if independent")


#: Method, name of the set, error in percent of the way, squared error by covariance, CPU seconds per second of input.
Trial = tuple[str, str, float, float, float]


def consistency(progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures over the held-out seeds."""
    trials: list[Trial] = []
    for k, seed in enumerate(HELD_OUT):
        progress(f"position manager: drive {k + 1} of {len(HELD_OUT)}")
        trials += trials_of(seed, everything=k < FEWER)
    degrees = 6 * len(HELD_OUT)
    return {
        "data": "measurements simulated by cdff_dev.evaluate._dead_reckoning, no images, no sweeps",
        "drives": len(HELD_OUT),
        "seeds": [HELD_OUT.start, HELD_OUT.stop - 1],
        "training_seeds": [TRAINING.start, TRAINING.stop - 1],
        "way_m": WAY_M,
        "band": [round(float(chi2.ppf(q, degrees)) / len(HELD_OUT), 3) for q in (0.025, 0.975)],
        **{method: _figures([t for t in trials if t[0] == method]) for method in ("position_manager", "gtsam")},
    }


def _figures(trials: list[Trial]) -> dict[str, Any]:
    """By set."""
    out = {}
    for name in dict.fromkeys(t[1] for t in trials):
        _, _, errors, squared, cpu_s = zip(*(t for t in trials if t[1] == name), strict=True)
        out[name] = {
            "drives": len(errors),
            "end_error_percent": spread(errors),
            "nees": spread(squared),
            "mean_nees": round(float(np.mean(squared)), 3),
            "cpu_s_per_input_s": round(float(np.median(cpu_s)), 4),
        }
    return out


def trials_of(seed: int, *, everything: bool) -> list[Trial]:
    """All sets on one drive; with the peer, and the set that is not asked to be consistent, where ``everything``."""
    drive = travel(seed, WAY_M, ground=10 + seed % 4)
    trials = []
    for name, (ports, parameters, shared) in SETS.items():
        if name in FEWER_SETS and not everything:
            continue
        samples = gathered(drive, ports, shared)
        begun_s = time.process_time()
        trials.append(_judged(drive, "position_manager", name, managed(drive, samples, parameters), begun_s))
        if name in PEER_SETS and everything:
            begun_s = time.process_time()
            trials.append(_judged(drive, "gtsam", name, smoothed(drive, ports), begun_s))
    return trials


def gathered(drive: Travel, ports: tuple[str, ...], shared: float) -> list[Sample]:
    """Samples of some ports in the order of time; fixes that share errors are drawn for it."""
    of = {**drive.samples, **({"fix": shared_fixes(drive, shared)} if shared else {})}
    return sorted((s for port in ports for s in of[port]), key=lambda s: (s.stamp_ns, s.port))


def managed(drive: Travel, samples: list[Sample], parameters: dict[str, Any]) -> tuple[int, UncertainTransform]:
    """Time and value of the last pose."""
    node = Registry.default().make_dfpc("position_manager")
    node.configure(parameters, drive.context)
    last = None
    for sample in samples:
        for output in node.step(sample):
            last = output if output.port == "pose" else last
    assert last is not None  # every drive leads to poses
    return last.t1_ns, last.value.transform


def _judged(drive: Travel, method: str, name: str, found: tuple[int, UncertainTransform], begun_s: float) -> Trial:
    cpu_s = (time.process_time() - begun_s) / drive.duration_s
    error_m, nees = normalised_error(drive.truth(found[0]), found[1])
    return method, name, 100.0 * error_m / drive.way_m, nees, cpu_s
