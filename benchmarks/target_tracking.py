# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of TargetStatePrediction and of the compound target_tracking for one measurement.

python benchmarks/target_tracking.py [--rounds N] [--out FILE]
"""

from __future__ import annotations

import argparse
import itertools
import platform
from functools import partial
from pathlib import Path

import numpy as np
from _report import measure, write_report

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.dfns.target_state_prediction.interface import TargetStatePredictionInputs


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    T = se3.transform(np.eye(3), [0.0, 0.0, 8.0])
    node = Registry.default().make_dfn("target_state_prediction")
    node.configure()
    inputs = TargetStatePredictionInputs(
        pose=T,
        velocity=np.zeros(3),
        rate=np.array([0.0, 0.0, np.radians(5.0)]),
        centre_of_mass_m=np.zeros(3),
        inertia=np.eye(3),
        covariance=np.eye(20),
        duration_s=1.0,
    )
    dfpc = Registry.default().make_dfpc("target_tracking")
    dfpc.configure()
    stamps_ns = itertools.count(0, 10**9)

    def step() -> None:
        stamp_ns = next(stamps_ns)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(T, 1e-4 * np.eye(6)), parent="lidar", child="client/body", stamp_ns=stamp_ns
        )
        list(dfpc.step(Sample("measurement", stamp_ns, 0, value)))

    write_report(
        {
            "benchmark": "target_tracking",
            "python": platform.python_version(),
            "TargetStatePrediction": measure(partial(node.process, inputs), args.rounds),
            "TargetTracking": measure(step, args.rounds),
        },
        args.out,
    )


if __name__ == "__main__":
    main()
