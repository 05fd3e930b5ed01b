# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``visual_odometry_dense``: KITTI next to ``visual_odometry_sparse``, simulated drives at steps of 20 cm."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from evaluation.data_sets import kitti
from evaluation.runs.short_steps import DRIVES, drive_results

METHODS = ("visual_odometry_dense", "visual_odometry_sparse")
PARTS = ("kitti", *DRIVES)


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the figures of the parts: the drive of KITTI and the simulated drives."""
    figures: dict[str, Any] = {}
    for part in parts:
        figures |= _kitti(data, progress) if part == "kitti" else {part: drive_results(part, progress)}
    return figures


def _kitti(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the figures of both compounds; over the part with a measured reference they start there."""
    pairs, truth = kitti.read(data / kitti.SEQUENCE)
    first = kitti.measured_from(truth)
    samples = [Sample("stereo", pair.stamp_ns, i, pair, id=str(i)) for i, pair in enumerate(pairs)]
    figures = {}
    for name in METHODS:
        progress(f"visual odometry, dense: KITTI, {name}")
        outputs, cpu_s = _run(name, samples)
        measured = [o for o in _run(name, samples[first:])[0] if o.value is not None]
        last = measured[-1].value.transform
        error = pose_error(se3.inverse(truth[first]) @ truth[-1], last.matrix)
        end = [o for o in outputs if o.value is not None][-1].value.transform.matrix
        figures[name] = {
            "end_percent": round(kitti.end_percent(end[None], truth), 3),
            "measured_percent": round(
                100.0 * float(np.linalg.norm(error[:3])) / kitti.path_lengths_m(truth[first:])[-1], 3
            ),
            "error_m": [round(float(v), 3) for v in error[:3]],
            "error_sigma": [round(float(v), 2) for v in error[:3] / np.sqrt(np.diag(last.covariance)[:3])],
            "nees": round(float(error @ np.linalg.solve(last.covariance, error)), 1),
            "answers": [
                sum(o.quality.status.value == s for o in outputs) for s in ("OK", "DEGRADED", "FAILED")
            ],
            "cpu_s": round(cpu_s, 3),
        }
    return {"kitti": figures, "first_measured": first}


def table(figures: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        "| KITTI 06 | end error | over the measured part | error there: right, down, forward | in σ "
        "| NEES there (6 expected) | OK, DEGRADED, FAILED | CPU s per pair |",
        "|---" * 8 + "|",
    ]
    for name, f in figures["kitti"].items():
        error, sigma = (", ".join(f"{v:+.2f}" for v in f[key]) for key in ("error_m", "error_sigma"))
        lines.append(
            f"| {name} | {f['end_percent']} % | {f['measured_percent']} % | {error} m | {sigma} "
            f"| {f['nees']} | {', '.join(str(n) for n in f['answers'])} | {f['cpu_s']} |"
        )
    dense, sparse = (figures["kitti"][name]["end_percent"] for name in METHODS)
    lines += ["", f"Ratio of the end errors: {dense / sparse:.2f} (goal 1.2).", ""]
    return "\n".join([*lines, *_steps_table([row for part in DRIVES for row in figures.get(part, [])])])


def _steps_table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the table of the simulated drives."""
    if not rows:
        return ["The simulated drives are not recorded yet."]
    lines = [
        "| simulated drive, steps of 20 cm | path length | end error | per 100 m | rotation at the end "
        "| NEES (6 expected) | OK poses with an error above 3 σ | OK, DEGRADED, FAILED | reasons "
        "| CPU ms per pair |",
        "|---" * 10 + "|",
    ]
    for row in rows:
        states = ", ".join(str(row["status"].get(name, 0)) for name in ("OK", "DEGRADED", "FAILED"))
        reasons = ", ".join(f"`{name}` {n}" for name, n in sorted(row["reasons"].items())) or "none"
        lines.append(
            f"| {row['scenario']}, seed {row['seed']}: {row['variant']} | {row['path_m']:.1f} m "
            f"| {row['end_error_m']:.2f} m | {100.0 * row['end_error_m'] / row['path_m']:.2f} m "
            f"| {row['end_rotation_deg']:.2f}° | {row['nees']} | {row['ok_beyond_3_sigma']} "
            f"| {states} | {reasons} | {row['cpu_ms_per_pair']:.0f} |"
        )
    return lines


def _run(name: str, samples: Sequence[Sample]) -> tuple[list[Output], float]:
    """Return the outputs for the pairs, and the CPU time per pair in seconds."""
    dfpc = Registry.default().make_dfpc(name)
    dfpc.configure(None, DfpcContext(robot="kitti"))
    outputs: list[Output] = []
    start = time.process_time()
    for sample in samples:
        outputs += dfpc.step(sample)
    return outputs, (time.process_time() - start) / len(samples)
