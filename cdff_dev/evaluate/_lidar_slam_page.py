# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The figures of lidar_slam as a drawing and as tables of its page."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_dev.trajectory.plot import panel

PEER = "kiss-icp 1.3.0"
_HEAD = ("| drive | what | drift over 50 / 100 / 400 m | ATE | ATE of the way | NEES |", "|---" * 6 + "|")
_OURS = ("odometry", "pose as published", "trajectory at the end")


def draw(figures: dict[str, Any]) -> bytes:
    """SVG: the first traverse from above, true and estimated, and the errors along it."""
    ours = next(v for k, v in figures["simulated"].items() if k.startswith("lidar_traverse, seed"))
    final = ours["trajectory at the end"]["along"]
    curves = {"#c0392b": final, "#2c7fb8": ours["odometry"]["along"]}
    plan = [np.column_stack([final[f"{of}x_m"], final[f"{of}y_m"]]) for of in ("", "estimated_")]
    errors_m = [np.column_stack([c["way_m"], c["error_m"]]) for c in curves.values()]
    above = panel(0.0, plan, ("#777777", "#c0392b"), ("x m", "y m"), equal=True)
    along = panel(520.0, errors_m, tuple(curves), ("way m", "error m"), equal=False)
    names = ("trajectory at the end", "odometry")
    legend = "".join(
        f'<text x="{572 + 150 * i}" y="18" fill="{colour}">{name}</text>'
        for i, (name, colour) in enumerate(zip(names, curves, strict=True))
    )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1040 360" font-family="sans-serif" font-size="12">'
        f'<rect width="100%" height="100%" fill="white"/>{legend}{above}{along}</svg>\n'
    ).encode()


def table(figures: dict[str, Any]) -> str:
    """Traverses, loops, and real sweeps."""
    rows = {k: v for k, v in figures["simulated"].items() if k.startswith("lidar_traverse, seed")}
    lines = list(_HEAD)
    for name, row in rows.items():
        lines += [_errors(f"{name}, {row['way_m']:.0f} m", of, row[of]) for of in _OURS]
    lines += ["", *(_traverse(name, row) for name, row in rows.items()), ""]
    lines += [*_loops(figures["simulated"]["loops"]), *_real(figures["real"]["kitti_velodyne"])]
    return "\n".join(lines) + "\n"


def peer_table(figures: dict[str, Any]) -> str:
    """The peer on each traverse."""
    if not figures:
        return "kiss-icp did not run: no interpreter had it (`CDFF_PEER_PYTHON`).\n"
    lines = [*_HEAD, *(_errors(name, PEER, row) for name, row in figures.items()), ""]
    for name, row in figures.items():
        cpu = row["cpu_s_per_sweep"]
        lines.append(f"- {PEER}, {name}: {1e3 * cpu['mean']:.0f} ms of CPU a sweep on one thread.")
    return "\n".join(lines) + "\n"


def _errors(drive: str, what: str, row: dict[str, Any]) -> str:
    drift = " / ".join(f"{row['drift_percent'][length]:.3f}" for length in _lengths(row["drift_percent"], 50, 100, 400))
    nees = f"{row['nees']['mean']:.1f}" if row["nees"]["count"] else "–"
    ate, share = row["ate_rmse_m"], row["ate_percent_of_way"]
    return f"| {drive} | {what} | {drift} % | {100.0 * ate:.1f} cm | {share:.4f} % | {nees} |"


def _lengths(drift: dict[Any, float], *lengths_m: int) -> list[Any]:
    """Keys of the lengths, which are numbers before and text after they were written."""
    return [key for key in drift if int(key) in lengths_m]


def _traverse(name: str, row: dict[str, Any]) -> str:
    loops, cpu, wall = row["loops"], row["cpu_s_per_sweep"], row["wall_s_per_sweep"]
    worst = (
        f"the worst {100.0 * loops['error_m']['max']:.1f} cm and {loops['error_deg']['max']:.2f}° from the truth, "
        if loops["loops"]
        else ""
    )
    return (
        f"- {name}: {loops['loops']} loops in the graph, {worst}{loops['loops_rejected']} rejected; {row['keyframes']} "
        f"key frames, {row['cloud_mb']:.1f} MB; of {row['sweeps']} sweeps {row['degraded']} DEGRADED, "
        f"{row['failed']} FAILED; "
        f"{1e3 * cpu['mean']:.0f} ms of CPU a sweep on one thread ({1.0 / cpu['mean']:.0f} a CPU second; 95 % below "
        f"{1e3 * cpu['p95']:.0f} ms, the worst {cpu['max']:.2f} s), {1e3 * wall['mean']:.0f} ms of wall time."
    )


def _rate(counted: dict[str, Any], of: str = "flagged") -> str:
    low, high = counted["interval_95"]
    return f"{counted[of]} of {counted['trials']} ({100.0 * low:.1f} to {100.0 * high:.1f} %)"


def _loops(row: dict[str, Any]) -> list[str]:
    detection, near, far = row["detection"], row["verification"]["near"], row["verification"]["far"]
    recall, precision = detection["recall_95"], detection["precision_95"]
    return [
        f"**Loops**, all {row['pairs']} pairs of {row['keyframes']} key frames. Detection by looks alone: of "
        f"{detection['pairs_within_5_m']} pairs within 5 m {detection['named']} named ({100 * recall[0]:.1f} to "
        f"{100 * recall[1]:.1f} %); of {detection['named_in_all']} named {detection['of_these_within_10_m']} lie "
        f"within 10 m ({100 * precision[0]:.1f} to {100 * precision[1]:.1f} %). Verification without the graph: of "
        f"{near['trials']} pairs within 5 m {near['right']} right, {near['wrong']} wrong, {near['refused']} refused; "
        f"of {far['trials']} pairs more than 20 m apart {far['wrong']} accepted ({100 * far['wrong_95'][0]:.1f} to "
        f"{100 * far['wrong_95'][1]:.2f} %).",
        "",
    ]


def covariance_table(row: dict[str, Any]) -> str:
    """Squared error by covariance at the end of short drives."""
    low, high = row["band_95"]
    return (
        f"**Covariance**, {row['drives']} drives of {row['seconds']:.0f} s on ground of their own: the last pose of "
        f"`odometry` has a mean NEES of {row['mean_nees']:.2f} (median {row['nees']['median']:.2f}, greatest "
        f"{row['nees']['max']:.1f}; the two-sided 95 % band of the mean is {low:.2f} to {high:.2f}), mean sigma "
        f"{1e3 * row['mean_sigma_m']:.1f} mm and {row['mean_sigma_deg']:.3f}°.\n"
    )


def _plains(row: dict[str, Any]) -> list[str]:
    lines = [
        f"**Plains** without any relief, with wheels that slip: flagged on the plain "
        f"{_rate(row['sweeps_on_the_plain_flagged'])}, off it {_rate(row['sweeps_off_it_flagged'])}.",
        "",
        "| `lidar_plain` | drift over 50 / 100 m | ATE | NEES |",
        "|---|---|---|---|",
    ]
    for name, entry in row.items():
        if name.startswith("seed"):
            drift = " / ".join(f"{entry['drift_percent'][k]:.1f}" for k in _lengths(entry["drift_percent"], 50, 100))
            nees = f"{entry['nees']['mean']:.1f}" if entry["nees"]["count"] else "–"
            lines.append(f"| {name} | {drift} % | {entry['ate_rmse_m']:.2f} m | {nees} |")
    return [*lines, ""]


def ground_table(figures: dict[str, Any]) -> str:
    """Plains, and lidars with few points."""
    lines = _plains(figures["lidar_plain"])
    lines += ["| lidar | parameters of `tracking` | drift over 10 / 20 m | OK / DEGRADED / FAILED |", "|---" * 4 + "|"]
    for name, row in figures["sparse"].items():
        drift = " / ".join(f"{row['drift_percent'][k]:.2f}" for k in _lengths(row["drift_percent"], 10, 20))
        said = " / ".join(str(row["sweeps"].get(status, 0)) for status in ("OK", "DEGRADED", "FAILED"))
        lines.append(f"| {name} | {row['tracking'] or 'defaults'} | {drift} % | {said} |")
    return "\n".join(lines) + "\n"


def laps_table(figures: dict[str, Any]) -> str:
    """What is kept after each lap."""
    lines = [
        f"**Laps** of one circle of {figures['lap_m']:.0f} m, {figures['loops']} loops in the graph, ATE at the end "
        f"{100.0 * figures['trajectory at the end']['ate_rmse_m']:.1f} cm:",
        "",
        "| after lap | way | key frames | edges of the graph | clouds |",
        "|---" * 5 + "|",
    ]
    for lap, row in sorted(figures["after_lap"].items(), key=lambda item: int(item[0])):
        lines.append(
            f"| {lap} | {row['way_m']:.0f} m | {row['keyframes']} | {row['edges']} | {row['cloud_mb']:.1f} MB |"
        )
    return "\n".join(lines) + "\n"


def _real(row: dict[str, Any]) -> list[str]:
    told = []
    for name, entry in row.items():
        moved = f", moved {entry['moved_m']:.2f} m" if "moved_m" in entry else ""
        off = (
            f", {1e3 * entry['error_m']:.0f} mm and {entry['error_deg']:.3f}° from its truth"
            if "error_m" in entry
            else ""
        )
        told.append(f"{name}: {entry['status']}{moved}{off}")
    return [f"**Real**, KITTI's sweeps without times of points: {'; '.join(told)}."]
