# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate visual odometry on a real KITTI drive, on simulated traverses, and on images with faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from evaluation.chart import Panel, chart
from evaluation.data_sets.kitti import kitti
from evaluation.runs.visual_gallery import gallery
from evaluation.runs.visual_traverses import traverses


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on the real drive, the simulated drives and the faulty images."""
    return {"real": kitti(data, progress), "simulated": traverses(progress), "gallery": gallery(progress)}


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: end error and mean NEES of the simulated drives by scenario, as SVG."""
    result = figures["simulated"]
    names = list(result["scenarios"])
    errors = [result["scenarios"][n]["end_error_percent"] for n in names]
    nees = [result["scenarios"][n]["mean_nees"] for n in names] + [result["all"]["mean_nees"]]
    return chart(
        [
            Panel(
                "end error, % of path length: median, minimum to maximum",
                names,
                {"visual_odometry_sparse": [(e["median"], e["min"], e["max"]) for e in errors]},
                1.2 * max(e["max"] for e in errors),
            ),
            Panel(
                "mean NEES",
                [*names, "all"],
                {"visual_odometry_sparse": [(v, v, v) for v in nees]},
                1.3 * max(nees),
                tuple(result["nees_band"]),
            ),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page: real drive, simulated drives, gallery."""
    real, simulated = figures["real"], figures["simulated"]
    end, aligned_end = real["end_error_percent"], real["end_error_aligned_percent"]
    measured_end, start = real["measured_end_error_percent"], real["unmeasured_start_percent"]
    lines = [
        f"**Real**: {real['data']}, {real['path_m']} m, {end['count']} seeds: end error "
        f"{end['median']:.2f} % in the median, {end['max']:.2f} % at most; after removal of a constant "
        f"rotation to the reference {aligned_end['median']:.2f} %.",
        "",
        f"The first {real['measured_from']} steps of the reference are interpolated. Over the remaining "
        f"{real['measured_m']} m, where the reference is measured, the end error is "
        f"{measured_end['median']:.2f} % in the median, {measured_end['max']:.2f} % at most. With exact "
        f"motion after the interpolated start, the end error would be {start['median']:.2f} %.",
        "",
        "| segments | " + " | ".join(real["segments_percent"]) + " |",
        "|---" * (1 + len(real["segments_percent"])) + "|",
        "| error, % | " + " | ".join(f"{v:.2f}" for v in real["segments_percent"].values()) + " |",
        "| error common to all methods of the next table at full rate | "
        + " | ".join(f"{v:.2f}" for v in real["segments_floor_percent"].values())
        + " |",
        "",
        "| odometry of the same images | end error | right, down, forward | measured part | caused by "
        "the start | without constant rotation |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {method['end_error_percent']:.2f} % | "
        f"{', '.join(f'{v:+.2f}' for v in method['end_error_m'])} m | {method['measured_percent']:.2f} % "
        f"| {method['unmeasured_start_percent']:.2f} % | {method['aligned_percent']:.2f} % |"
        for name, method in real["methods"].items()
    ]
    lines += [
        "",
        f"**Simulated** (seeds {', '.join(str(s) for s in simulated['seeds'])}):",
        "",
        "| traverse | drives, path length | end error, median / maximum | FAILED, DEGRADED | mean "
        "NEES | mean NEES of half drives |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in [*simulated["scenarios"].items(), ("all", simulated["all"])]:
        end_error = row["end_error_percent"]
        lines.append(
            f"| {name} | {row['drives']}, {row['path_length_m']:.0f} m | {end_error['median']:.3f} / "
            f"{end_error['max']:.3f} % | {row['failed']}, {row['degraded']} of {row['pairs']} | "
            f"{row['mean_nees']:.2f} | {row['mean_half_nees']:.2f} |"
        )
    (low, high), (half_low, half_high) = simulated["nees_band"], simulated["half_nees_band"]
    lines += [
        "",
        f"95 % band of the mean NEES of {simulated['all']['drives']} drives: {low} to "
        f"{high}; of the {2 * simulated['all']['drives']} half drives: {half_low} to "
        f"{half_high}.",
        "",
        f"**Gallery** ({figures['gallery']['data']}; images in the order of the table rows):",
        "",
        "![Left camera image of the seventh pair, for each row of the table below](visual_odometry_failures.jpg)",
        "",
        "| seventh pair | answer | reasons | two pairs later: error (1σ) |",
        "|---|---|---|---|",
    ]
    for row in figures["gallery"]["cases"]:
        later = f"{row['end_error_mm']} ({row['end_sigma_mm']}) mm" if "end_error_mm" in row else "no pose"
        reasons = ", ".join(f"`{reason}`" for reason in row["reasons"]) or "none"
        lines.append(f"| {row['case']} | {row['status']} | {reasons} | {row['status_at_the_end']}: {later} |")
    return "\n".join(lines)
