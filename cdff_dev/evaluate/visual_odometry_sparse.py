# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on 51 stereo pairs of a KITTI drive, over 20 seeds: end error as a share of the path."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.registry import Registry
from cdff_core.runtime import Runner
from cdff_dev.convert.kitti import PAIR, ROBOT, TRUTH, open_kitti
from cdff_dev.evaluate.record import spread
from cdff_dev.replay.engine import samples_of

SEQUENCE = "kitti_stereo/KITTI_sequence_1"
SEEDS = range(20)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """End error and worst error on the way, per seed, and what became of the images."""
    log = open_kitti(data / SEQUENCE)
    truth = [np.asarray(s.value.transform.matrix) for s in log.samples([TRUTH])]
    path_m = float(sum(np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in itertools.pairwise(truth)))
    end_percent, turn_deg, counts = [], [], {"images": 0, "failed": 0, "degraded": 0}
    for seed in SEEDS:
        progress(f"visual odometry, seed {seed}")
        dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
        dfpc.configure(context=DfpcContext(robot=ROBOT, seed=seed))
        runner = Runner(dfpc)
        poses = []
        for sample in samples_of(log, {"stereo": PAIR}, ROBOT):
            runner.push(sample)
            poses += [p.value.transform.matrix for p in runner.drain() if p.value is not None]
        poses += [p.value.transform.matrix for p in runner.finish() if p.value is not None]
        error = se3.inverse(truth[0]) @ truth[-1]
        error = se3.inverse(error) @ se3.inverse(poses[0]) @ poses[-1]
        end_percent.append(100 * float(np.linalg.norm(error[:3, 3])) / path_m)
        turn_deg.append(float(np.degrees(se3.rotation_angle(error[:3, :3]))))
        for key, count in zip(counts, ("samples", "failed", "degraded"), strict=True):
            counts[key] += int(runner.counters.to_dict()[count])
    return {
        "data": SEQUENCE,
        "path_m": round(path_m, 3),
        "seeds": [SEEDS.start, SEEDS.stop - 1],
        "end_error_percent": spread(end_percent),
        "end_rotation_deg": spread(turn_deg),
        "totals": counts,
    }
