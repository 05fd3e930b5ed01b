# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU times of the position manager per second of input and per measurement, and of its DFNs.

python benchmarks/position_manager.py [--out FILE] [--seconds N] [--memory S]
"""

from __future__ import annotations

import argparse
import platform
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report

from cdff_common.codecs import encode
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_core.dfns.frame_interpolation.interface import FrameInterpolationInputs
from cdff_core.dfns.gravity_levelling.interface import GravityLevellingInputs
from cdff_core.dfns.gyro_integration.interface import GyroIntegrationInputs
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs
from cdff_core.dfns.kalman_prediction.interface import KalmanPredictionInputs
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs
from cdff_core.dfns.pose_weighting.interface import PoseWeightingInputs

MS = 1_000_000


def samples(seconds: int, start_s: int = 0, imu_ms: int = 10) -> list[Sample]:
    """Return exact samples of a curve at 0.4 m/s: IMU 100 Hz, wheels 10 Hz, visual odometry 4 Hz."""
    start_ns = start_s * 1000 * MS

    def pose(port: str, stamp_ns: int, child: str) -> Sample:
        T = se3.exp_se3(stamp_ns * 1e-9 * np.array([0.4, 0, 0, 0, 0, 0.1]))
        value = TransformWithCovariance.from_transform(
            UncertainTransform(T, 1e-6 * (1 + stamp_ns * 1e-9) * np.eye(6)),
            parent="mana/odom",
            child=child,
            stamp_ns=stamp_ns,
        )
        return Sample(port, stamp_ns, 0, value)

    def imu(stamp_ns: int) -> Sample:
        value = IMUSensors(Time.from_ns(stamp_ns), np.array([0, 0, 3.71]), np.array([0, 0, 0.1]), np.zeros(3))
        return Sample("imu", stamp_ns, 0, value)

    results = [imu(start_ns + k * imu_ms * MS) for k in range(1000 // imu_ms * seconds)]
    results += [pose("odometry", start_ns + k * 100 * MS, "mana/base") for k in range(10 * seconds)]
    results += [
        pose("visual_odometry", start_ns + k * 250 * MS, "mana/navcam_left") for k in range(4 * seconds)
    ]
    return sorted(results, key=lambda s: (s.stamp_ns, s.port))


def make_position_manager() -> Any:
    """Return a configured position manager; all sensors are mounted at the origin of the base."""
    frames = FrameGraph()
    for parent, child in (
        ("site", "mana/odom"),
        ("mana/base", "mana/imu"),
        ("mana/base", "mana/navcam_left"),
    ):
        frames.set_static(parent, child, UncertainTransform.identity())
    dfpc = Registry.default().make_dfpc("position_manager")
    dfpc.configure(None, DfpcContext("mana", frames))
    return dfpc


def compound_cpu_s(seconds: int) -> float:
    """Return CPU seconds per second of input."""
    dfpc, inputs = make_position_manager(), samples(seconds)
    started = time.process_time()
    for sample in inputs:
        list(dfpc.step(sample))
    return (time.process_time() - started) / seconds


def answer_ms(seconds: int, late_ns: int = 0) -> dict[str, float]:
    """Return milliseconds of CPU from a measurement to the newest pose, per port: median and 95 %.

    Visual odometry arrives ``late_ns`` late; measurements received in between are then processed again.
    """
    dfpc = make_position_manager()
    times_ms: dict[str, list[float]] = {}
    for sample in sorted(
        samples(seconds), key=lambda s: s.stamp_ns + late_ns * (s.port == "visual_odometry")
    ):
        started = time.process_time_ns()
        list(dfpc.step(sample))
        if sample.stamp_ns > 2_000 * MS:
            dfpc.get_pose("site", "mana/base", -1)
            times_ms.setdefault(sample.port, []).append((time.process_time_ns() - started) * 1e-6)
    return {
        f"{port}_{name}_ms": round(float(np.quantile(values, q)), 3)
        for port, values in sorted(times_ms.items())
        for name, q in (("median", 0.5), ("p95", 0.95))
    }


def memory_and_cost(seconds: int) -> dict[str, dict[str, float]]:
    """Return memory and CPU time every 15 minutes of a long run."""
    dfpc, results = make_position_manager(), {}
    for minute in range(seconds // 60):
        inputs = samples(60, minute * 60, imu_ms=50)
        started = time.process_time()
        for sample in inputs:
            list(dfpc.step(sample))
        if (minute + 1) % 15 == 0:
            state = dfpc.state()
            results[f"{minute + 1} min"] = {
                "process_peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, 1),
                "poses": len(state.line.stamps_ns),
                "state_mb": round(len(encode(state, "msgpack")) / 1e6, 2),
                "trajectory_mb": round(len(encode(dfpc.get_trajectory(-1, -1), "msgpack")) / 1e6, 2),
                "cpu_s_of_the_last_minute": round(time.process_time() - started, 2),
            }
    return results


def dfn_cpu_s(name: str, implementation: str, inputs: Any, rounds: int = 500) -> float:
    """Return CPU seconds per call of a DFN."""
    node = Registry.default().make_dfn(name, implementation)
    node.configure()
    call: Callable[[Any], Any] = node.process
    call(inputs)
    started = time.process_time()
    for _ in range(rounds):
        call(inputs)
    return (time.process_time() - started) / rounds


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument(
        "--memory", type=int, default=0, metavar="S", help="also run for this time and report the memory"
    )
    args = parser.parse_args()
    step = OdometryIncrementInputs(
        first=np.eye(4),
        second=se3.exp_se3([0.1, 0, 0, 0, 0, 0.02]),
        mount=np.eye(4),
        first_covariance=1e-6 * np.eye(6),
        second_covariance=2e-6 * np.eye(6),
    )
    stamps = np.arange(34, dtype=np.int64) * 10 * MS
    forces, rates = np.tile([0, 0, 3.71], (34, 1)), np.full((34, 3), 0.1)
    gyro = GyroIntegrationInputs(
        stamps_ns=stamps,
        rates_rad_s=rates,
        bias_rad_s=np.zeros(3),
        interval_ns=np.array([0, int(stamps[-1])]),
    )
    predict = KalmanPredictionInputs(
        pose=np.eye(4),
        velocity=np.zeros(3),
        biases=np.zeros(6),
        covariance=np.eye(30),
        interval_ns=np.array([0, 100 * MS]),
        stamps_ns=stamps,
        specific_force=forces,
        rates_rad_s=rates,
        gravity=3.71,
    )
    correct = KalmanCorrectionInputs(
        residual=np.zeros(6), jacobian=np.eye(6, 30), noise=np.eye(6), covariance=np.eye(30)
    )
    weigh = PoseWeightingInputs(
        first=np.eye(4),
        first_covariance=np.eye(6),
        second=np.eye(4),
        second_covariance=np.diag([2.0, 1, 1, 1, 1, 0.5]),
    )
    between = FrameInterpolationInputs(
        first=np.eye(4),
        second=np.eye(4),
        interval_ns=np.array([0, 100 * MS]),
        time_ns=30 * MS,
        first_covariance=np.eye(6),
        second_covariance=np.eye(6),
        cross_covariance=np.eye(6),
    )
    level = GravityLevellingInputs(
        specific_force=np.tile([0, 0, 3.71], (50, 1)), rates_rad_s=np.zeros((50, 3))
    )
    report = {
        "benchmark": "position_manager",
        "python": platform.python_version(),
        "input_s": args.seconds,
        "cpu_s_per_input_s": round(compound_cpu_s(args.seconds), 4),
        "insert_to_answer": answer_ms(args.seconds),
        "insert_to_answer, visual odometry 0.2 s late": answer_ms(args.seconds, 200 * MS),
        "OdometryIncrement/CovarianceDifference": round(
            dfn_cpu_s("odometry_increment", "CovarianceDifference", step), 6
        ),
        "OdometryIncrement/DistanceModel": round(dfn_cpu_s("odometry_increment", "DistanceModel", step), 6),
        "GyroIntegration/MidpointRates": round(dfn_cpu_s("gyro_integration", "MidpointRates", gyro), 6),
        "KalmanPrediction/InertialErrorState": round(
            dfn_cpu_s("kalman_prediction", "InertialErrorState", predict), 6
        ),
        "KalmanCorrection/JosephForm": round(dfn_cpu_s("kalman_correction", "JosephForm", correct), 6),
        "PoseWeighting/CovarianceIntersection": round(
            dfn_cpu_s("pose_weighting", "CovarianceIntersection", weigh), 6
        ),
        "FrameInterpolation/Geodesic": round(dfn_cpu_s("frame_interpolation", "Geodesic", between), 6),
        "GravityLevelling/MeanSpecificForce": round(
            dfn_cpu_s("gravity_levelling", "MeanSpecificForce", level), 6
        ),
    }
    if args.memory:
        report["memory"] = memory_and_cost(args.memory)
    write_report(report, args.out)


if __name__ == "__main__":
    main()
