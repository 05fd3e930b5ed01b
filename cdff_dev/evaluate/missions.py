# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The shipped missions, each run once as processes by ``cdff mission NAME --json``; simulated rovers and ground.

A guided mission is another one each time, since when an answer comes depends on the machine: these are figures of one
run, and no mean.
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
from cdff_dev.missions.commands import DEPLOY
from cdff_dev.ports import free_port

PAGE = "run-a-mission"


#: Each can be run alone.
PARTS = tuple(path.stem for path in sorted((DEPLOY / "missions").glob("*.yaml")))


def evaluate(data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Run missions; the real data are not asked."""
    figures = {}
    for name in parts:
        progress(f"mission {name}")
        figures[name] = _figures(name)
    return figures


def _figures(name: str) -> dict[str, Any]:
    http, connect = f"127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "cdff_common.cli", "mission", name, "--json", "--http", http, "--connect", connect]
    began_s = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout.strip():
        raise UnavailableError(
            f"mission {name} ended with {done.returncode} and no score: {done.stderr.strip()[-500:]}"
        )
    score: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    kept = {key: score[key] for key in ("faults", "guided", "remarks")}
    return kept | {"wall_s": round(time.monotonic() - began_s)} | _rounded(score["score"])


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return round(value, 4) if isinstance(value, float) else value


def table(figures: dict[str, Any]) -> str:
    """One row a mission, and what else it said."""
    rows = [
        "| mission | driven | position off, largest | goals, truly off | beyond the limits | elevation along the way "
        "| as demanded | wall time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows += [_row(name, mission) for name, mission in figures.items()]
    remarks = [f"`{name}`: {remark}." for name, mission in figures.items() for remark in mission["remarks"]]
    return "\n".join(rows + ([""] if remarks else []) + remarks)


def _row(name: str, of: dict[str, Any]) -> str:
    located, mapped = of["located"], of["mapped"]
    way = " and ".join(f"{at['way_m']:.0f}" for at in located)
    off = ", ".join(f"{at['largest_m']:.3f} m ({at['largest_m'] / at['way_m']:.3%})" for at in located)
    goals = ", ".join(f"{at['off_m']:.2f}" for at in of["reached"])
    beyond = "; ".join(_beyond(at) for at in of["driven"]) if of["guided"] else "not guided"
    elevation = f"RMS {mapped['rms_m']:.3f} m, bias {mapped['bias_m']:+.3f} m"
    held = "all" if not of["faults"] else "not: " + "; ".join(of["faults"])
    cells = (f"`{name}`", f"{way} m", off, f"{goals} m" if goals else "", beyond, elevation, held)
    return "| " + " | ".join((*cells, f"{of['wall_s']} s")) + " |"


def _beyond(at: dict[str, Any]) -> str:
    if not at["too_high"] and not at["too_steep"]:
        return f"none of {at['places']} places"
    higher_cm = 100.0 * (at["highest_m"] - at["max_step_m"])
    steeper_deg = at["steepest_deg"] - at["max_slope_deg"]
    parts = []
    if at["too_high"]:
        parts.append(f"{at['too_high']} of {at['places']} places too high, by at most {higher_cm:.0f} cm")
    if at["too_steep"]:
        parts.append(f"{at['too_steep']} of {at['places']} too steep, by at most {steeper_deg:.1f} deg")
    return ", ".join(parts)
