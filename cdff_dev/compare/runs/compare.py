# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Differences of two runs in trajectories, maps, requests, latency, quality and configuration."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from cdff_common.errors import CdffError, InputError
from cdff_common.formats.clouds import read_cloud
from cdff_common.formats.file_source import load
from cdff_dev.compare import elevation
from cdff_dev.compare.elevation.read import read_dem
from cdff_dev.compare.trajectory.compare import compare as compare_trajectories
from cdff_dev.compare.trajectory.read import read_track

#: Summaries of the commands that write a folder.
_SUMMARIES = ("run.json", "summary.json", "outputs.json")
_COST = ("wall_s", "cpu_s", "peak_rss_mb")
_QUALITY = (
    *("poses", "statuses", "reasons", "quality", "truth", "samples", "outputs", "degraded", "failed"),
    *("dropped", "errors", "last_error", "last_failure", "out_of_order", "answered", "stored", "gated"),
    *("samples_by_port", "outputs_by_port", "path_length_m", "duration_s", "dem", "dfpcs", "requests"),
)

#: Names of the configuration of a DFPC whose results are among those of another.
_CONFIGURATION = frozenset({"parameters", "config_hash", "dfpc", "implementation"})
#: Largest number of points whose nearest neighbours are searched; more points are subsampled evenly.
_MAX_POINTS = 200_000


def compare_runs(a: Path, b: Path) -> dict[str, Any]:
    """Return the differences of two runs.

    Returns
    -------
    dict
        ``configuration``, ``quality`` and ``cost``: values of both by name, where they differ (costs always);
        ``trajectories`` and ``maps``: differences of the files that both have, without alignment;
        ``requests``: answers that differ, and times to the answers; ``only_in_a``, ``only_in_b``: files.

    Raises
    ------
    InputError
        If a folder holds no summary of a run.
    """
    first, second = _flat(_summary(a)), _flat(_summary(b))
    names = sorted({*first, *second})
    values = {name: [first.get(name), second.get(name)] for name in names}
    differing = {name: pair for name, pair in values.items() if pair[0] != pair[1]}
    files_a, files_b = _files(a), _files(b)
    common = sorted(files_a & files_b)
    return {
        "a": str(a),
        "b": str(b),
        "configuration": {n: p for n, p in differing.items() if _part(n) == "configuration"},
        "quality": {n: p for n, p in differing.items() if _part(n) == "quality"},
        "cost": {n: p for n, p in values.items() if n in _COST},
        "trajectories": _each(a, b, [f for f in common if f.endswith(".tum")], _trajectory),
        "maps": _each(a, b, [f for f in common if f.endswith(".tif")], _map)
        | _each(a, b, [f for f in common if f.endswith(".ply")], _cloud),
        "requests": _requests(a, b),
        "only_in_a": sorted(files_a - files_b),
        "only_in_b": sorted(files_b - files_a),
    }


def _part(name: str) -> str:
    """Return the part of the comparison to which a value of a summary belongs, by its name."""
    words = name.split(".")
    if words[0] in _COST:
        return "cost"
    return "quality" if words[0] in _QUALITY and not _CONFIGURATION.intersection(words) else "configuration"


def _summary(folder: Path) -> dict[str, Any]:
    path = next((folder / name for name in _SUMMARIES if (folder / name).is_file()), None)
    if path is None:
        raise InputError(
            f"{folder}: no run: expected a folder with {', '.join(_SUMMARIES[:-1])} or outputs.json"
        )
    summary: dict[str, Any] = _json(path, dict)
    return summary


def _json(path: Path, kind: type) -> Any:
    try:
        document = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a JSON file: {error}") from error
    if not isinstance(document, kind):
        raise InputError(f"{path}: a {type(document).__name__}, expected a {kind.__name__}")
    return document


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested mappings by names with dots; long lists are omitted."""
    flat: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        elif not (isinstance(value, list) and len(str(value)) > 200):
            flat[f"{prefix}{name}"] = value
    return flat


def _files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def _each(
    a: Path, b: Path, names: list[str], compare: Callable[[Path, Path], dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the comparison of each file, or the reason why the file cannot be compared."""
    results: dict[str, dict[str, Any]] = {}
    for name in names:
        try:
            results[name] = compare(a / name, b / name)
        except CdffError as error:
            results[name] = {"error": str(error)}
    return results


def _trajectory(a: Path, b: Path) -> dict[str, Any]:
    """Return the differences between the trajectories of two runs, without alignment."""
    results = compare_trajectories(read_track(a), read_track(b), align="none").results
    ate = results["ate"]
    return {
        "poses": list(results["poses"].values()),
        "rmse_m": ate["translation_m"]["rmse"],
        "max_m": ate["translation_m"]["max"],
        "max_deg": ate["rotation_deg"]["max"],
        "path_length_m": results["path_length_m"],
    }


def _map(a: Path, b: Path) -> dict[str, Any]:
    second = read_dem(str(b))
    results = elevation.compare(read_dem(str(a), frame=second.frame), second)
    return {name: results[name] for name in ("cells", "completeness", "bias_m", "rmse_m", "max_m")}


def _cloud(a: Path, b: Path) -> dict[str, Any]:
    """Return the numbers of points, and the distances of the points of A to the nearest ones of B."""
    first, second = (read_cloud(load(path), "ply").points_m for path in (a, b))
    if not len(first) or not len(second):
        return {"points": [len(first), len(second)]}
    chosen = first[:: -(-len(first) // _MAX_POINTS)]
    distances_m, _ = cKDTree(second).query(chosen)
    return {
        "points": [len(first), len(second)],
        "median_m": float(np.median(distances_m)),
        "p95_m": float(np.percentile(distances_m, 95.0)),
        "max_m": float(distances_m.max()),
    }


def _requests(a: Path, b: Path) -> dict[str, Any]:
    """Return the answers that differ and the times to the answers, of replays of missions."""
    if not all((folder / "answers.json").is_file() for folder in (a, b)):
        return {}
    first, second = (
        {str(answer["request"]): answer for answer in _json(folder / "answers.json", list)}
        for folder in (a, b)
    )
    names = [name for name in first if name in second]
    states = {name: [_state(answers[name]) for answers in (first, second)] for name in names}
    return {
        "count": [len(first), len(second)],
        "different": {name: pair for name, pair in states.items() if pair[0] != pair[1]},
        "after_s": [_times([answer["after_s"] for answer in run.values()]) for run in (first, second)],
    }


def _state(answer: Mapping[str, Any]) -> str:
    remarks = answer.get("code") or " ".join(answer["delivered"].get("differences", []))
    return f"{answer['answer']} {remarks}".strip()


def _times(values_s: list[float]) -> dict[str, float]:
    if not values_s:
        return {}
    return {"median": float(np.median(values_s)), "max": float(np.max(values_s))}
