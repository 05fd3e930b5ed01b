# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The frame around figures: where they come from, so that they can be had again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.clock import format_stamp, wall_ns


def provenance(root: Path) -> dict[str, Any]:
    """Commit, whether what is no document differs from it, lock file, Python, machine and time."""
    lock = root / "requirements" / f"py{''.join(platform.python_version_tuple()[:2])}.txt"
    return {
        "commit": _git(root, "rev-parse", "HEAD"),
        "tree_differs": bool(_git(root, "status", "--porcelain", "--untracked-files=no", "--", ":!docs")),
        "lock_sha256": hashlib.sha256(lock.read_bytes()).hexdigest()[:16] if lock.is_file() else "none",
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "made": format_stamp(wall_ns()),
    }


def write(root: Path, name: str, figures: dict[str, Any], part: str = "") -> Path:
    """Write ``docs/evaluation/{name}.json`` and return its path; of a part, only its own figures and provenance."""
    path = root / "docs" / "evaluation" / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    made = {"evaluation": name, "provenance": provenance(root), "figures": figures}
    if part:
        of_part, made = made, json.loads(path.read_text(encoding="utf-8"))
        made["figures"] |= figures
        made["provenance"].setdefault("parts", {})[part] = of_part["provenance"]
    path.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    return path


def spread(values: ArrayLike, digits: int = 4) -> dict[str, float]:
    """Count, least, median, 95th percentile and greatest of a list of errors."""
    v = np.asarray(values, dtype=np.float64)
    if not v.size:
        return {"count": 0}
    figures = {"min": v.min(), "median": np.median(v), "p95": np.quantile(v, 0.95), "max": v.max()}
    return {"count": int(v.size)} | {key: round(float(value), digits) for key, value in figures.items()}


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"  # no git here, or no checkout: the figures say that nobody knows their commit
    return done.stdout.strip()
