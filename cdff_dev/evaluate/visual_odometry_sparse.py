# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on a KITTI drive (real), over simulated traverses, and a gallery of what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_dev.evaluate._chart import Panel, chart
from cdff_dev.evaluate._visual_gallery import gallery
from cdff_dev.evaluate._visual_kitti import kitti
from cdff_dev.evaluate._visual_traverses import traverses


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """All figures, real and simulated apart."""
    return {"real": kitti(data, progress), "simulated": traverses(progress), "gallery": gallery(progress)}


def draw(figures: dict[str, Any]) -> bytes:
    """End errors over the simulated drives by scenario, and the mean squared error in its band."""
    found = figures["simulated"]
    names = list(found["scenarios"])
    errors = [found["scenarios"][n]["end_error_percent"] for n in names]
    nees = [found["scenarios"][n]["mean_nees"] for n in names] + [found["all"]["mean_nees"]]
    return chart(
        [
            Panel(
                "end error, % of the way: median, least to greatest", names,
                {"visual_odometry_sparse": [(e["median"], e["min"], e["max"]) for e in errors]},
                1.2 * max(e["max"] for e in errors),
            ),
            Panel(
                "mean squared pose error by covariance", [*names, "all"],
                {"visual_odometry_sparse": [(v, v, v) for v in nees]}, 1.3 * max(nees), tuple(found["nees_band"]),
            ),
        ]
    )  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """Real drive, simulated drives and gallery as tables."""
    real, simulated = figures["real"], figures["simulated"]
    end, rest = real["end_error_percent"], real["end_error_turned_percent"]
    part, start = real["measured_end_error_percent"], real["unmeasured_start_percent"]
    lines = [
        f"**Real**: {real['data']}, {real['path_m']} m, {end['count']} seeds: end error {end['median']:.2f} % in the "
        f"median, {end['max']:.2f} % at worst; with a constant rotation to the truth taken out {rest['median']:.2f} %.",
        "",
        f"The first {real['measured_from']} steps of the truth are interpolated; over the {real['measured_m']} m that "
        f"were measured: {part['median']:.2f} % in the median, {part['max']:.2f} % at worst. Moving as the images say "
        f"before, and exactly as the truth where it was measured, would end {start['median']:.2f} % off.",
        "",
        "| segments | " + " | ".join(real["segments_percent"]) + " |",
        "|---" * (1 + len(real["segments_percent"])) + "|",
        "| error, % | " + " | ".join(f"{v:.2f}" for v in real["segments_percent"].values()) + " |",
        "| of that common to all ways below at full rate | "
        + " | ".join(f"{v:.2f}" for v in real["segments_floor_percent"].values())
        + " |",
        "",
        "| way of looking at the images | end error | right, down, forward | measured part | by the start alone "
        "| without constant rotation |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {way['end_error_percent']:.2f} % | {', '.join(f'{v:+.2f}' for v in way['end_error_m'])} m "
        f"| {way['measured_percent']:.2f} % | {way['unmeasured_start_percent']:.2f} % | {way['turned_percent']:.2f} % |"
        for name, way in real["ways"].items()
    ]
    lines += [
        "",
        f"**Simulated** (seeds {', '.join(str(s) for s in simulated['seeds'])}):",
        "",
        "| traverse | drives, way | end error, median / worst | FAILED, DEGRADED | mean squared error | of halves |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in [*simulated["scenarios"].items(), ("all", simulated["all"])]:
        e = row["end_error_percent"]
        lines.append(
            f"| {name} | {row['drives']}, {row['way_m']:.0f} m | {e['median']:.3f} / {e['max']:.3f} % "
            f"| {row['failed']}, {row['degraded']} of {row['pairs']} | {row['mean_nees']:.2f} "
            f"| {row['mean_half_nees']:.2f} |"
        )
    (low, high), (half_low, half_high) = simulated["nees_band"], simulated["half_nees_band"]
    lines += [
        "",
        f"The mean of {simulated['all']['drives']} consistent squared errors lies between {low} and {high} in 95 %, "
        f"that of their {2 * simulated['all']['drives']} halves between {half_low} and {half_high}.",
        "",
        f"**Gallery** ({figures['gallery']['data']}; pictures in the order of the rows):",
        "",
        "![The left images of the table below](visual_odometry_failures.jpg)",
        "",
        "| the seventh pair is | answer | reasons | two pairs later: error (one sigma) |",
        "|---|---|---|---|",
    ]
    for row in figures["gallery"]["cases"]:
        later = f"{row['end_error_mm']} ({row['end_sigma_mm']}) mm" if "end_error_mm" in row else "no pose"
        reasons = ", ".join(f"`{reason}`" for reason in row["reasons"]) or "none"
        lines.append(f"| {row['case']} | {row['status']} | {reasons} | {row['status_at_the_end']}: {later} |")
    return "\n".join(lines)
