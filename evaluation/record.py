# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write evaluation results with their provenance, so that they can be reproduced."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from cdff_common.clock import format_stamp, wall_ns


def provenance(root: Path) -> dict[str, Any]:
    """Return commit, uncommitted changes outside ``docs``, lock file hash, Python, machine and time."""
    lock = root / "requirements" / "evaluate.txt"
    return {
        "commit": _git(root, "rev-parse", "HEAD"),
        "tree_differs": bool(_git(root, "status", "--porcelain", "--untracked-files=no", "--", ":!docs")),
        "lock_sha256": hashlib.sha256(lock.read_bytes()).hexdigest()[:16] if lock.is_file() else "none",
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "created": format_stamp(wall_ns()),
    }


def write(
    root: Path, name: str, figures: dict[str, Any], part: str = "", origin: dict[str, Any] | None = None
) -> Path:
    """Write ``docs/evaluation/{name}.json`` and return its path.

    If ``part`` is given, only the results and the provenance of this part are replaced. ``origin`` is the
    provenance at the start of the evaluation, by default that of now.
    """
    path = root / "docs" / "evaluation" / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    results = {"evaluation": name, "provenance": origin or provenance(root), "figures": figures}
    if part and path.is_file():
        part_results, results = results, json.loads(path.read_text(encoding="utf-8"))
        results["figures"] |= figures
        results["provenance"].setdefault("parts", {})[part] = part_results["provenance"]
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return path


def squared_error(
    mean: float, degrees_of_freedom: int, trials: int, pairs: int | None = None
) -> dict[str, Any]:
    """Return the entry of ``figures.real.{implementation}.{data set}`` for a mean NEES e' P^-1 e.

    ``pairs`` is the number of different pairs of clouds or maps, if some trials differ only in the guess.
    ``cdff check`` refuses a covariance called calibrated without such entries.
    """
    entry = {"squared_error": mean, "degrees_of_freedom": degrees_of_freedom, "trials": trials}
    return entry if pairs is None else entry | {"pairs": pairs}


def _git(root: Path, *arguments: str) -> str:
    try:
        command = ["git", *arguments]
        completed = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"  # git is not installed, or the folder is not a repository
    return completed.stdout.strip()
