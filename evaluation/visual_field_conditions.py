# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every visual compound under every field condition, on real images and in the simulator.

A cell states the median error of the positions, the number of poses by status, and the number of poses with
status OK whose error exceeds three stated standard deviations in any component. The covariance of the true
poses is added to the stated one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import DfpcContext, Output
from evaluation.data_sets.image_conditions import Condition, View, conditions, stereo_conditions
from evaluation.runs.visual_conditions import (
    STEREO_COMPOUNDS,
    ImageSet,
    euroc_set,
    kitchen_set,
    kitti_set,
    localise,
    simulated_sets,
    track,
)

PARTS = ("kitti", "euroc", "kitchen", "simulator")
#: Stated standard deviations within which an error is expected.
_SIGMAS = 3.0


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the cells by set of images, condition and compound."""
    sources: dict[str, Callable[[], list[ImageSet]]] = {
        "kitti": lambda: [kitti_set(data)],
        "euroc": lambda: [euroc_set(data)],
        "kitchen": lambda: [kitchen_set(data)],
        "simulator": simulated_sets,
    }
    figures: dict[str, Any] = {}
    for part in parts:
        rows: dict[str, Any] = {}
        for images in sources[part]():
            for name, condition in _conditions(images).items():
                progress(f"visual field conditions: {part}, {name}")
                rows[name] = {compound: _cell(images, condition, compound) for compound in images.compounds}
        figures[part] = rows
    return figures


def _conditions(images: ImageSet) -> dict[str, Condition]:
    """Return the conditions of a set; one whose scene is itself a condition has no other one."""
    if images.scene_condition:
        return {images.scene_condition: list}
    return conditions() | (stereo_conditions() if images.is_stereo else {})


def _cell(images: ImageSet, condition: Condition, compound: str) -> dict[str, Any]:
    """Return the result of a compound under a condition."""
    context = DfpcContext("rover")
    if compound == "visual_localisation":
        return score(localise(images, condition(images.queries), context), images)
    return score(track(compound, images, condition(images.sequence), context), images, is_relative=True)


def score(
    answers: Sequence[tuple[View, Output]], images: ImageSet, *, is_relative: bool = False
) -> dict[str, Any]:
    """Return errors and counts of poses; ``is_relative``: the first pose is the origin of the others."""
    statuses = Counter(output.quality.status.value for _, output in answers)
    reasons = Counter(reason.split(":")[0] for _, output in answers for reason in output.quality.reasons)
    row: dict[str, Any] = {
        "status": [statuses.get(name, 0) for name in ("OK", "DEGRADED", "FAILED")],
        "reasons": dict(reasons.most_common(4)),
    }
    located = [(view, output) for view, output in answers if output.value is not None]
    if not located:
        return row
    origin = se3.inverse(images.truth[located[0][0].index]) if is_relative else np.eye(4)
    start = se3.inverse(located[0][1].value.transform.matrix) if is_relative else np.eye(4)
    noise = np.diag(np.repeat([images.sigma_m, np.radians(images.sigma_deg)], 3) ** 2.0)
    errors_m, beyond = [], 0
    for view, output in located[1:] if is_relative else located:
        transform = output.value.transform
        T_true = origin @ images.truth[view.index]
        error = pose_error(T_true, start @ transform.matrix)
        covariance = np.asarray(transform.covariance) + (2.0 if is_relative else 1.0) * noise
        errors_m.append(float(np.linalg.norm(error[:3])))
        is_beyond = bool((np.abs(error) > _SIGMAS * np.sqrt(np.diag(covariance))).any())
        beyond += is_beyond and output.quality.status.value == "OK"
    if errors_m:
        row |= {
            "median_m": round(float(np.median(errors_m)), 4),
            "largest_m": round(max(errors_m), 4),
            "ok_beyond_3_sigma": beyond,
        }
    return row


def table(figures: dict[str, Any]) -> str:
    """Return a table for each set of images."""
    lines: list[str] = []
    cells = wrong = 0
    for part, rows in figures.items():
        compounds = [c for c in STEREO_COMPOUNDS if any(c in row for row in rows.values())]
        lines += [f"**{_TITLES[part]}**", "", f"| condition | {' | '.join(compounds)} |"]
        lines.append("|---" * (1 + len(compounds)) + "|")
        for name, row in rows.items():
            texts = [_text(row[c]) if c in row else "–" for c in compounds]
            lines.append(f"| {name} | {' | '.join(texts)} |")
            cells += len(row)
            wrong += sum(bool(cell.get("ok_beyond_3_sigma")) for cell in row.values())
        lines.append("")
    lines.append(f"{wrong} of {cells} cells contain a pose with status OK and an error above 3 σ.")
    return "\n".join(lines)


_TITLES = {
    "kitti": "KITTI 06, stereo",
    "euroc": "EuRoC V1_01, stereo pairs 1.5 s apart",
    "kitchen": "7-Scenes kitchen, RGB-D",
    "simulator": "Simulator, stereo",
}


def _text(cell: dict[str, Any]) -> str:
    error = f"{cell['median_m']:.3f} m" if "median_m" in cell else "no pose"
    status = "/".join(map(str, cell["status"]))
    wrong = cell.get("ok_beyond_3_sigma")
    reasons = ", ".join(f"`{reason}`" for reason in list(cell["reasons"])[:2])
    marked = f" **{wrong} OK beyond 3 σ**" if wrong else ""
    return f"{error}, {status}{marked}{f' {reasons}' if reasons else ''}"
