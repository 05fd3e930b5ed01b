# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU time and memory of BodyMotionEstimation on 200 poses of a tumbling body, and of Tracking3D.

python benchmarks/body_motion.py [--out FILE] [--rounds N]
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
import tracemalloc
from pathlib import Path

import numpy as np
from _report import write_report

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.dfns.body_motion_estimation.interface import BodyMotionEstimationInputs
from cdff_core.rigid_body.torque_free import TorqueFreeBody

POSES, INTERVAL_S, SEED = 200, 5.0, 1
SIGMA_M, SIGMA_RAD = 0.005, float(np.deg2rad(0.4))


def measured_poses() -> FloatArray:
    """Return noisy poses (n, 4, 4) of a body that tumbles with 0.7 degrees per second."""
    rng = np.random.default_rng(SEED)
    body = TorqueFreeBody([0.6, 0.8, 1.0], np.deg2rad(0.7) * np.array([0.4, 0.5, 0.77]))
    R = body.orientations(INTERVAL_S * np.arange(POSES))
    noisy = se3.exp_so3(SIGMA_RAD * rng.normal(size=(POSES, 3))) @ R
    return np.asarray(se3.transform(noisy, SIGMA_M * rng.normal(size=(POSES, 3))))


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    poses = measured_poses()
    covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
    t_s = INTERVAL_S * np.arange(POSES)
    inputs = BodyMotionEstimationInputs(
        times_s=t_s,
        poses=poses,
        covariances=np.repeat(covariance[None], POSES, axis=0),
        is_noise_known=True,
        queries_s=t_s[-1:],
        is_fitted=False,
    )
    dfn = Registry.default().make_dfn("body_motion_estimation")
    times = []
    for _ in range(args.rounds + 1):
        dfn.configure()
        started = time.process_time()
        dfn.process(inputs)
        times.append(time.process_time() - started)
    tracemalloc.start()
    dfn.configure()
    dfn.process(inputs)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    dfpc = Registry.default().make_dfpc("tracking_3d")
    dfpc.configure()
    started = time.process_time()
    for t, T in zip(t_s, poses, strict=True):
        stamp_ns = 1000 * round(1e6 * t)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(T, covariance), parent="inertial", child="client/body", stamp_ns=stamp_ns
        )
        list(dfpc.step(Sample("pose", stamp_ns, 0, value)))
    report = {
        "benchmark": "body_motion",
        "python": platform.python_version(),
        "poses": POSES,
        "TorqueFree": {
            "cpu_s_median": round(statistics.median(times[1:]), 4),
            "memory_mb": round(peak / 1e6, 2),
        },
        "tracking_3d_cpu_s_per_pose": round((time.process_time() - started) / POSES, 4),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
