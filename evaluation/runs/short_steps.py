# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run dense visual odometry on simulated drives of 100 m with a stereo pair per 20 cm, and variants of them.

The development used parts of the drive ``visual_steps`` with the seed 101: it determined ``sigma_common_px``.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair, TransformWithCovariance
from evaluation.runs.traverse import TraverseRun, traverse_runs

#: Scenario, seed and variants of each part of the evaluation.
DRIVES = {
    "steps": (
        "visual_steps",
        203,
        ("images", "images, azimuth of the Sun", "pairs missing, wheels with slip"),
    ),
    "shadow": ("visual_steps_shadow", 204, ("images",)),
}
#: Parameters for simulated images, whose calibration is exact.
SIMULATED_CAMERA: dict[str, Any] = {
    "disparity": {"num_disparities": 64},  # the nearest ground is at 1.1 m
    "alignment": {
        "sigma_common_px": 0.01,
        "calibration": dict.fromkeys(
            ("focal_length_ratio", "baseline_ratio", "principal_point_px", "rotation_deg", "distortion_px"),
            0.0,
        ),
    },
}
#: Path length between attitude fixes, metres, and standard deviations of tilt and azimuth, degrees.
FIX_DISTANCE_M = 10.0
FIXES = {"azimuth of the Sun": (2.0, 0.2), "attitude": (0.1, 0.2)}
#: Pairs that are missing: one each time, except three in succession at the end.
MISSING = (60, 121, 182, 243, 304, 365, 426, 427, 428)
#: Slip of the wheels, relative: mean, and amplitude and wavelength (m) of its change.
SLIP, SLIP_AMPLITUDE, SLIP_WAVELENGTH_M = 0.2, 0.2, 7.0


def drive_results(part: str, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return the results of each variant of the drive of a part."""
    scenario, seed, names = DRIVES[part]
    (drive,) = traverse_runs(scenario, seed)[1]
    pairs = drive.samples({"navcam.pair": "stereo"})
    rows = []
    for name in names:
        progress(f"visual odometry, dense: {scenario}, seed {seed}, {name}")
        row = _score(drive, variant(name, drive, pairs, seed))
        rows.append({"scenario": scenario, "seed": seed, "variant": name} | row)
    return rows


def variant(name: str, drive: TraverseRun, pairs: Sequence[Sample], seed: int) -> list[Sample]:
    """Return the samples of a variant of a drive, in order of time."""
    if name == "pairs missing, wheels with slip":
        kept = [pair for i, pair in enumerate(pairs) if i not in MISSING]
        return _merged(kept, slipping_wheels(drive, pairs))
    if name == "images":
        return list(pairs)
    tilt_deg, azimuth_deg = FIXES[name.removeprefix("images, ")]
    rng = np.random.default_rng([seed, round(1000 * tilt_deg)])
    return _merged(pairs, attitude_fixes(drive, pairs, tilt_deg, azimuth_deg, rng))


def _merged(pairs: Sequence[Sample], others: Sequence[Sample]) -> list[Sample]:
    return sorted([*others, *pairs], key=lambda s: (s.stamp_ns, s.port))


def attitude_fixes(
    drive: TraverseRun, pairs: Sequence[Sample], tilt_deg: float, azimuth_deg: float, rng: np.random.Generator
) -> list[Sample]:
    """Return a fix at the first pair and after each ``FIX_DISTANCE_M``, with independent errors."""
    poses = np.array([drive.true_pose(pair.stamp_ns) for pair in pairs])
    length_m = np.concatenate([[0.0], np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).cumsum()])
    chosen = np.searchsorted(length_m, np.arange(0.0, length_m[-1], FIX_DISTANCE_M))
    sigmas_rad = np.radians([tilt_deg, tilt_deg, azimuth_deg])
    covariance = np.diag([1e6] * 3 + list(sigmas_rad**2))
    fixes = []
    for i in chosen:
        R = se3.exp_so3(sigmas_rad * rng.standard_normal(3)) @ poses[i, :3, :3]
        fix = UncertainTransform(se3.transform(R, np.zeros(3)), covariance)
        fixes.append(_pose_sample("attitude", fix, "site", drive.robot, pairs[i].stamp_ns, int(i)))
    return fixes


def slipping_wheels(drive: TraverseRun, pairs: Sequence[Sample]) -> list[Sample]:
    """Return wheel poses at the pairs; the slip changes between 0 and 40 % along the path."""
    poses = np.array([drive.true_pose(pair.stamp_ns) for pair in pairs])
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    length_m = np.linalg.norm(steps[:, :3, 3], axis=1).cumsum()
    slip = SLIP + SLIP_AMPLITUDE * np.sin(2.0 * np.pi * length_m / SLIP_WAVELENGTH_M)
    T, samples = np.eye(4), []
    for i, pair in enumerate(pairs):
        if i > 0:
            step = steps[i - 1]
            T = T @ se3.transform(step[:3, :3], step[:3, 3] / (1.0 - slip[i - 1]))
        samples.append(
            _pose_sample(
                "odometry", UncertainTransform(T), f"{drive.robot}/odom", drive.robot, pair.stamp_ns, i
            )
        )
    return samples


def _pose_sample(
    port: str, T: UncertainTransform, parent: str, robot: str, stamp_ns: int, number: int
) -> Sample:
    pose = TransformWithCovariance.from_transform(T, parent=parent, child=f"{robot}/base", stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, number, pose)


def _score(drive: TraverseRun, samples: Sequence[Sample]) -> dict[str, Any]:
    """Return errors, NEES, status and CPU time of a run."""
    dfpc = Registry.default().make_dfpc("visual_odometry_dense")
    dfpc.configure(SIMULATED_CAMERA, drive.context)
    outputs: list[Output] = []
    start_s = time.process_time()
    for sample in samples:
        outputs += dfpc.step(sample)
    cpu_s = time.process_time() - start_s
    located = [output for output in outputs if output.value is not None]
    T_base_left = drive.context.frames.lookup(f"{drive.robot}/base", f"{drive.robot}/navcam_left", 0).matrix
    truth = np.array([drive.true_pose(o.t1_ns) @ T_base_left for o in located])
    truth = se3.inverse(truth[0]) @ truth
    T = np.array([o.value.transform.matrix for o in located])
    covariances = np.array([o.value.transform.covariance for o in located])
    errors = np.array([pose_error(a, b) for a, b in zip(truth, T, strict=True)])
    sigmas = np.sqrt(np.einsum("nii->ni", covariances))
    beyond = (np.abs(errors[1:]) > 3.0 * sigmas[1:]).any(axis=1)
    is_ok = np.array([o.quality.status.value == "OK" for o in located])[1:]
    steps_m = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    distances_m = np.linalg.norm(errors[:, :3], axis=1)
    counts = Counter(o.quality.status.value for o in outputs)
    return {
        "path_m": round(float(steps_m.sum()), 2),
        "median_step_m": round(float(np.median(steps_m)), 3),
        "pairs": sum(isinstance(s.value, FramePair) for s in samples),
        "status": dict(counts),
        "reasons": dict(Counter(r.split(":")[0] for o in outputs for r in o.quality.reasons)),
        "end_error_m": round(float(distances_m[-1]), 3),
        "largest_error_m": round(float(distances_m.max()), 3),
        "end_rotation_deg": round(float(np.degrees(np.linalg.norm(errors[-1, 3:]))), 3),
        "end_error": [round(float(v), 5) for v in errors[-1]],
        "end_sigmas": [round(float(v), 5) for v in sigmas[-1]],
        "nees": round(float(errors[-1] @ np.linalg.solve(covariances[-1], errors[-1])), 1),
        "ok_beyond_3_sigma": int((beyond & is_ok).sum()),
        "cpu_ms_per_pair": round(1000.0 * cpu_s / len(outputs), 1),
    }
