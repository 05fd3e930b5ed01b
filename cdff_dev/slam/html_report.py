# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Report of an estimation as one HTML file without external resources."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from cdff_dev.compare.trajectory.compare import Comparison
from cdff_dev.compare.trajectory.plot import ALIGNMENTS
from cdff_dev.slam.estimation import Estimation
from cdff_dev.slam.pictures import error_picture, timing_picture

_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;"
    "color:#222;background:#fff}"
    "img{max-width:100%}table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.2rem .6rem;"
    "text-align:left}pre{background:#f4f4f4;padding:1rem;overflow:auto}"
)
#: Pictures of a run that the report contains, with their headings.
_PICTURES = (("Trajectory", "trajectory.png"), ("Map", "map.png"), ("Elevation", "dem.png"))


def run_report(
    run: Mapping[str, Any], estimation: Estimation, comparison: Comparison | None, folder: Path
) -> bytes:
    """Return the report of a run as HTML.

    Parameters
    ----------
    run : mapping
        Content of ``run.json``.
    folder : Path
        Folder with the pictures of the run.
    """
    title = f"{run['dfpc']} on {run['log']}"
    sections = [_table("Result", _result_rows(run))]
    sections += [
        _picture(heading, (folder / name).read_bytes())
        for heading, name in _PICTURES
        if (folder / name).is_file()
    ]
    if comparison is None:
        sections.append(f"<h2>Errors</h2><p>{escape(str(run['truth']))}</p>")
    else:
        sections.append(_table("Errors after alignment", _error_rows(comparison.results)))
        sections.append(_picture("Errors along the path", error_picture(comparison)))
    if len(estimation.step_s):
        sections.append(_picture("Timing", timing_picture(estimation.step_s)))
    if run["reasons"]:
        counts = sorted(run["reasons"].items(), key=lambda item: -item[1])
        sections.append(_table("Reasons of poses that are not OK", counts))
    sections.append(f"<h2>Configuration</h2><pre>{escape(_configuration(run))}</pre>")
    body = "\n".join(sections)
    page = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n"
        f"<body><h1>{escape(title)}</h1>\n{body}\n</body></html>\n"
    )
    return page.encode()


def _result_rows(run: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the table of results."""
    statuses = ", ".join(f"{count} {status}" for status, count in sorted(run["statuses"].items()))
    return [
        ("Poses", f"{run['poses']} ({statuses})"),
        ("Path length", f"{run['path_length_m']:.2f} m"),
        ("Duration", f"{run['duration_s']:.2f} s"),
        ("Computation", f"{run['cpu_s']:.1f} s CPU, {run['wall_s']:.1f} s elapsed"),
        ("Streams", ", ".join(f"{port}: {stream}" for port, stream in run["streams"].items())),
        ("Version", f"cdff {run['cdff']}, {run['implementation']}, configuration {run['config_hash']}"),
        ("Libraries", ", ".join(f"{name} {version}" for name, version in run["versions"].items())),
    ]


def _error_rows(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the table of errors against the true poses."""
    position, rotation = results["ate"]["translation_m"], results["ate"]["rotation_aligned_deg"]
    alignment = ALIGNMENTS[results["alignment"]["mode"]]
    poses, share = results["poses"], results["ate"]["rmse_percent_of_path"]
    rows = [
        ("Poses compared", f"{poses['compared']} of {poses['estimate']}"),
        ("Estimate", f"{alignment}; orientations by their mean rotation"),
        ("Position", f"RMSE {position['rmse']:.3f} m, largest {position['max']:.3f} m"),
        ("Orientation", f"RMSE {rotation['rmse']:.3f} degrees, largest {rotation['max']:.3f} degrees"),
    ]
    if share is not None:
        rows.append(("RMSE by path length", f"{share:.2f} %"))
    drift = results["drift"]
    if drift["segments"]:
        lengths_m = [segment["length_m"] for segment in drift["segments"]]
        rows.append(
            (
                f"Drift over {min(lengths_m):g} to {max(lengths_m):g} m",
                f"{drift['translation_percent']:.2f} %, {drift['rotation_deg_per_m']:.4f} degrees/m",
            )
        )
    return rows


def _configuration(run: Mapping[str, Any]) -> str:
    return json.dumps(run["parameters"], indent=1, sort_keys=True)


def _table(heading: str, rows: Iterable[tuple[str, Any]]) -> str:
    cells = "".join(f"<tr><th>{escape(k)}</th><td>{escape(str(v))}</td></tr>" for k, v in rows)
    return f"<h2>{escape(heading)}</h2><table>{cells}</table>"


def _picture(heading: str, png: bytes) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<h2>{escape(heading)}</h2><img alt="{escape(heading)}" src="data:image/png;base64,{data}">'
