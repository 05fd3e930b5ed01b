# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Diagram and tables of the page of lidar_slam."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_dev.compare.diagrams import plan_and_errors

PEER = "kiss-icp 1.3.0"
_HEAD = (
    "| drive | output | drift over 50 / 100 / 400 m | ATE | ATE / path length | NEES |",
    "|---" * 6 + "|",
)
_OUTPUTS = ("odometry", "pose as published", "trajectory at the end")


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: true and estimated path of the first traverse, and the errors along it, as SVG."""
    first_traverse = next(v for k, v in figures["simulated"].items() if k.startswith("lidar_traverse, seed"))
    final = first_traverse["trajectory at the end"]["along"]
    prefixes = {"truth": "", "trajectory at the end": "estimated_"}
    plan = {
        name: np.column_stack([final[f"{prefix}x_m"], final[f"{prefix}y_m"]])
        for name, prefix in prefixes.items()
    }
    curves = {"trajectory at the end": final, "odometry": first_traverse["odometry"]["along"]}
    errors = {name: np.column_stack([c["path_length_m"], c["error_m"]]) for name, c in curves.items()}
    return plan_and_errors(plan, ("x", "y"), errors).encode()


def table(figures: dict[str, Any]) -> str:
    """Return the tables of traverses, loops and real sweeps."""
    rows = {k: v for k, v in figures["simulated"].items() if k.startswith("lidar_traverse, seed")}
    lines = list(_HEAD)
    for name, row in rows.items():
        lines += [
            _errors(f"{name}, {row['path_length_m']:.0f} m", output, row[output]) for output in _OUTPUTS
        ]
    lines += ["", *(_traverse(name, row) for name, row in rows.items()), ""]
    lines += [*_loops(figures["simulated"]["loops"]), *_real(figures["real"]["kitti_velodyne"])]
    return "\n".join(lines) + "\n"


def peer_table(figures: dict[str, Any]) -> str:
    """Return the table of kiss-icp on each traverse."""
    if not figures:
        return "kiss-icp did not run: it is not installed (`CDFF_PEER_PYTHON`).\n"
    lines = [*_HEAD, *(_errors(name, PEER, row) for name, row in figures.items()), ""]
    for name, row in figures.items():
        cpu = row["cpu_s_per_sweep"]
        lines.append(f"- {PEER}, {name}: {1e3 * cpu['mean']:.0f} ms of CPU per sweep on one thread.")
    return "\n".join(lines) + "\n"


def _errors(drive: str, output: str, row: dict[str, Any]) -> str:
    drift = " / ".join(
        f"{row['drift_percent'][length]:.3f}" for length in _lengths(row["drift_percent"], 50, 100, 400)
    )
    nees = f"{row['nees']['mean']:.1f}" if row["nees"]["count"] else "–"
    ate_m, ate_percent = row["ate_rmse_m"], row["ate_percent_of_path"]
    return f"| {drive} | {output} | {drift} % | {100.0 * ate_m:.1f} cm | {ate_percent:.4f} % | {nees} |"


def _lengths(drift: dict[Any, float], *lengths_m: int) -> list[Any]:
    """Return the keys of the lengths; they are numbers in memory and text in JSON."""
    return [key for key in drift if int(key) in lengths_m]


def _traverse(name: str, row: dict[str, Any]) -> str:
    loops, cpu, wall = row["loops"], row["cpu_s_per_sweep"], row["wall_s_per_sweep"]
    largest_error = (
        f"largest error {100.0 * loops['error_m']['max']:.1f} cm and {loops['error_deg']['max']:.2f}°, "
        if loops["loops"]
        else ""
    )
    return (
        f"- {name}: {loops['loops']} loops in the graph, {largest_error}{loops['loops_rejected']} rejected; "
        f"{row['keyframes']} keyframes, {row['cloud_mb']:.1f} MB; of {row['sweeps']} sweeps "
        f"{row['degraded']} DEGRADED, {row['failed']} FAILED; {1e3 * cpu['mean']:.0f} ms of CPU per sweep "
        f"on one thread ({1.0 / cpu['mean']:.0f} sweeps per CPU second; 95 % below {1e3 * cpu['p95']:.0f} ms, "
        f"maximum {cpu['max']:.2f} s), {1e3 * wall['mean']:.0f} ms of wall time."
    )


def _rate(rate: dict[str, Any]) -> str:
    low, high = rate["interval_95"]
    return f"{rate['degenerate']} of {rate['trials']} ({100.0 * low:.1f} to {100.0 * high:.1f} %)"


def _loops(row: dict[str, Any]) -> list[str]:
    detection, near, far = row["detection"], row["verification"]["near"], row["verification"]["far"]
    recall, precision = detection["recall_95"], detection["precision_95"]
    return [
        f"**Loops**, all {row['pairs']} pairs of {row['keyframes']} keyframes (95 % intervals). Detection by appearance "
        f"alone: of {detection['pairs_within_5_m']} pairs within 5 m, {detection['proposed']} were proposed "
        f"({100 * recall[0]:.1f} to {100 * recall[1]:.1f} %); of {detection['proposed_in_total']} proposed, "
        f"{detection['of_these_within_10_m']} lie within 10 m ({100 * precision[0]:.1f} to "
        f"{100 * precision[1]:.1f} %). Verification without the graph: of {near['trials']} pairs within "
        f"5 m, {near['correct']} were matched correctly, {near['wrong']} wrongly, {near['refused']} refused; "
        f"of {far['trials']} pairs more than 20 m apart, {far['wrong']} were accepted ({100 * far['wrong_95'][0]:.1f} to "
        f"{100 * far['wrong_95'][1]:.2f} %).",
        "",
    ]


def covariance_table(row: dict[str, Any]) -> str:
    """Return the text on the NEES at the end of short drives."""
    low, high = row["band_95"]
    return (
        f"**Covariance**, {row['drives']} drives of {row['seconds']:.0f} s, each on its own terrain: the "
        f"last pose of `odometry` has a mean NEES of {row['mean_nees']:.2f} (median "
        f"{row['nees']['median']:.2f}, greatest {row['nees']['max']:.1f}; the two-sided 95 % band of the "
        f"mean is {low:.2f} to {high:.2f}), mean sigma "
        f"{1e3 * row['mean_sigma_m']:.1f} mm and {row['mean_sigma_deg']:.3f}°.\n"
    )


def _plains(row: dict[str, Any]) -> list[str]:
    lines = [
        f"**Plains** without relief, slipping wheels: sweeps reported as degenerate on the plain "
        f"{_rate(row['degenerate_on_the_plain'])}, outside it {_rate(row['degenerate_outside_the_plain'])}.",
        "",
        "| `lidar_plain` | drift over 50 / 100 m | ATE | NEES |",
        "|---|---|---|---|",
    ]
    for name, entry in row.items():
        if name.startswith("seed"):
            drift = " / ".join(
                f"{entry['drift_percent'][k]:.1f}" for k in _lengths(entry["drift_percent"], 50, 100)
            )
            nees = f"{entry['nees']['mean']:.1f}" if entry["nees"]["count"] else "–"
            lines.append(f"| {name} | {drift} % | {entry['ate_rmse_m']:.2f} m | {nees} |")
    return [*lines, ""]


def ground_table(figures: dict[str, Any]) -> str:
    """Return the tables of plains and of lidars with few points."""
    lines = _plains(figures["lidar_plain"])
    lines += [
        "| lidar | parameters of `tracking` | drift over 10 / 20 m | OK / DEGRADED / FAILED |",
        "|---" * 4 + "|",
    ]
    for name, row in figures["sparse"].items():
        drift = " / ".join(f"{row['drift_percent'][k]:.2f}" for k in _lengths(row["drift_percent"], 10, 20))
        counts = " / ".join(str(row["sweeps"].get(status, 0)) for status in ("OK", "DEGRADED", "FAILED"))
        lines.append(f"| {name} | {row['tracking'] or 'defaults'} | {drift} % | {counts} |")
    return "\n".join(lines) + "\n"


def laps_table(figures: dict[str, Any]) -> str:
    """Return the table of map and graph sizes after each lap."""
    lines = [
        f"**Laps** of one circle of {figures['lap_m']:.0f} m, {figures['loops']} loops in the graph, ATE "
        f"at the end {100.0 * figures['trajectory at the end']['ate_rmse_m']:.1f} cm:",
        "",
        "| after lap | path length | keyframes | edges of the graph | clouds |",
        "|---" * 5 + "|",
    ]
    for lap, row in sorted(figures["after_lap"].items(), key=lambda item: int(item[0])):
        lines.append(
            f"| {lap} | {row['path_length_m']:.0f} m | {row['keyframes']} | {row['edges']} | "
            f"{row['cloud_mb']:.1f} MB |"
        )
    return "\n".join(lines) + "\n"


def _real(row: dict[str, Any]) -> list[str]:
    answers = []
    for name, entry in row.items():
        displacement = f", moved {entry['moved_m']:.2f} m" if "moved_m" in entry else ""
        error = (
            f", {1e3 * entry['error_m']:.0f} mm and {entry['error_deg']:.3f}° from the reference"
            if "error_m" in entry
            else ""
        )
        answers.append(f"{name}: {entry['status']}{displacement}{error}")
    return [f"**Real**, KITTI sweeps without point times: {'; '.join(answers)}."]


def thinned_table(figures: dict[str, Any]) -> str:
    """Return the tables of sweeps with few points or rings, and of fast turns."""
    lines = [
        "| sweeps | points | error | NEES (6 expected) | CPU | OK / DEGRADED / FAILED "
        f"| {PEER}: error | CPU |",
        "|---" * 8 + "|",
    ]
    for name, row in (figures["real"] | figures["simulated"]).items():
        ours, peer = row["lidar_slam"], row.get("kiss_icp")
        counts = " / ".join(str(ours["sweeps"].get(status, 0)) for status in ("OK", "DEGRADED", "FAILED"))
        peer_cells = "– | –" if peer is None else f"{_rmse(peer)} | {1e3 * peer['cpu_s']:.0f} ms"
        lines.append(
            f"| {name} | {row['points']} | {_rmse(ours)} | {ours['squared_error']['mean']:.1f} | "
            f"{1e3 * ours['cpu_s']:.0f} ms | {counts} | {peer_cells} |"
        )
    return "\n".join(lines) + "\n"


def _rmse(row: dict[str, float]) -> str:
    return f"{100.0 * row['rmse_m']:.1f} cm, {row['last_deg']:.3f}°"
