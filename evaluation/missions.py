# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scores of the shipped rover missions: ``cdff mission NAME --json`` runs each once on simulated terrain.

The results are those of one run, not a mean: guided missions differ from run to run, because the time of
each reply depends on the machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import UnavailableError
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_common.resources import deploy_folder
from cdff_dev.missions.orbit.script import is_orbital
from cdff_dev.ports import free_port

_FILES = [path for path in sorted((deploy_folder() / "missions").glob("*.yaml")) if not is_orbital(path)]
#: Suffix of the variant of a mission whose rover has cameras only.
_CAMERAS = "_without_lidar"
#: Missions and their variants; each can be run separately.
PARTS = tuple(
    name
    for path in _FILES
    for name in (
        path.stem,
        *((f"{path.stem}{_CAMERAS}",) if "without_lidar" in read_mapping(path) else ()),
    )
)


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Return the scores of missions; the data folder is not used."""
    figures = {}
    for name in parts:
        progress(f"mission {name}")
        figures[name] = _run_mission(name)
    return figures


def _run_mission(name: str) -> dict[str, Any]:
    http, connect = f"127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"
    command = [
        sys.executable,
        "-m",
        "cdff_common.cli",
        "mission",
        name.removesuffix(_CAMERAS),
        *(("--without-lidar",) if name.endswith(_CAMERAS) else ()),
        "--json",
        "--http",
        http,
        "--connect",
        connect,
    ]
    started_s = time.monotonic()
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    if not completed.stdout.strip():
        error = completed.stderr.strip()[-500:]
        raise UnavailableError(f"mission {name} ended with {completed.returncode} and no score: {error}")
    score: dict[str, Any] = json.loads(completed.stdout.splitlines()[-1])
    results = {key: score[key] for key in ("faults", "guided", "remarks")}
    return results | {"wall_s": round(time.monotonic() - started_s)} | _rounded(score["score"])


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return round(value, 4) if isinstance(value, float) else value


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each mission, followed by the remarks."""
    rows = [
        "| mission | path length | largest position error | errors at goals | limit violations | elevation "
        "along the path | requirements met | wall time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows += [_row(name, mission) for name, mission in figures.items()]
    remarks = [f"`{name}`: {remark}." for name, mission in figures.items() for remark in mission["remarks"]]
    return "\n".join(rows + ([""] if remarks else []) + remarks)


def _row(name: str, mission: dict[str, Any]) -> str:
    localisation, elevation_errors = mission["located"], mission["mapped"]
    length = " and ".join(f"{entry['path_length_m']:.0f}" for entry in localisation)
    errors = ", ".join(
        f"{entry['largest_m']:.3f} m ({entry['largest_m'] / entry['path_length_m']:.3%})"
        for entry in localisation
    )
    goals = ", ".join(f"{entry['off_m']:.2f}" for entry in mission["reached"])
    violations = (
        "; ".join(_violations(entry) for entry in mission["driven"]) if mission["guided"] else "not guided"
    )
    elevation = f"RMS {elevation_errors['rms_m']:.3f} m, bias {elevation_errors['bias_m']:+.3f} m"
    requirements = "all" if not mission["faults"] else "not: " + "; ".join(mission["faults"])
    cells = (
        f"`{name}`",
        f"{length} m",
        errors,
        f"{goals} m" if goals else "",
        violations,
        elevation,
        requirements,
    )
    return "| " + " | ".join((*cells, f"{mission['wall_s']} s")) + " |"


def _violations(entry: dict[str, Any]) -> str:
    if not entry["too_high"] and not entry["too_steep"]:
        return f"none at {entry['places']} positions"
    higher_cm = 100.0 * (entry["highest_m"] - entry["max_step_m"])
    slope_excess_deg = entry["steepest_deg"] - entry["max_slope_deg"]
    parts = []
    if entry["too_high"]:
        parts.append(
            f"{entry['too_high']} of {entry['places']} positions above the step limit, "
            f"by at most {higher_cm:.0f} cm"
        )
    if entry["too_steep"]:
        parts.append(
            f"{entry['too_steep']} of {entry['places']} too steep, by at most {slope_excess_deg:.1f} deg"
        )
    return ", ".join(parts)
