# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figures of a comparison as lines of text."""

from __future__ import annotations

from typing import Any

_COLUMNS = ("rmse", "mean", "median", "std", "min", "max")


def table(figures: dict[str, Any]) -> str:
    """Lines for a terminal."""
    poses, rpe = figures["poses"], figures["rpe"]
    apart = f"{rpe['delta']:g} {rpe['unit']}" + (", all pairs" if rpe["all_pairs"] else "")
    lines = [
        f"{poses['compared']} poses compared ({poses['estimate']} estimated, {poses['reference']} of the reference), "
        f"{figures['way_m']:.3f} m, {figures['duration_s']:.3f} s, aligned: {figures['alignment']['mode']}",
        "",
        f"{'':24}" + "".join(f"{name:>12}" for name in _COLUMNS),
        _row("ATE m", figures["ate"]["translation_m"]),
        _row("ATE deg", figures["ate"]["rotation_deg"]),
        _row(f"RPE m ({apart})", rpe["translation_m"]),
        _row(f"RPE deg ({apart})", rpe["rotation_deg"]),
    ]
    if figures["drift"]["segments"]:
        lines += ["", f"{'segment m':>12}{'count':>8}{'drift %':>12}{'deg/m':>12}"]
        lines += [
            f"{s['length_m']:12g}{s['count']:8d}{s['translation_percent']:12.4f}{s['rotation_deg_per_m']:12.6f}"
            for s in figures["drift"]["segments"]
        ]
        drift = figures["drift"]
        lines.append(f"{'all':>12}{'':8}{drift['translation_percent']:12.4f}{drift['rotation_deg_per_m']:12.6f}")
    nees = figures["nees"]
    if nees and nees["count"]:
        low, high = nees["band_95"]
        lines += [
            "",
            f"NEES of {nees['count']} poses: mean {nees['mean']:.3f}, median {nees['median']:.3f} (6 expected; "
            f"95 % of the mean, were they independent: {low:.3f}..{high:.3f}); {100 * nees['inside_95']:.1f} % of "
            "poses inside their own 95 %",
        ]
    return "\n".join(lines)


def _row(name: str, statistics: dict[str, Any]) -> str:
    return f"{name:24}" + "".join(f"{statistics[column]:12.6f}" for column in _COLUMNS)
