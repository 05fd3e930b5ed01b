# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check that each covariance that is called calibrated has a record of its errors on real data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.description import DfpcDescription

#: Minimum number of pairs of clouds or maps in all data sets; fewer do not show whether a covariance is too
#: small.
_LEAST_PAIRS = 6
#: Largest mean of e' P^-1 e per degree of freedom on each data set, since a covariance that is too small is
#: dangerous wherever it occurs, and smallest mean over the pairs of all data sets; 1 is expected. A single
#: data set may be below: halves of one scan lack the differences between two views.
_LARGEST_RATIO, _SMALLEST_RATIO = 2.5, 0.1


def calibration_faults(root: Path, dfpc: DfpcDescription) -> list[str]:
    """Return a fault for each implementation called calibrated without agreement on real data.

    The record ``docs/evaluation/{name}.json`` holds under ``figures.real`` for each implementation and data
    set ``squared_error`` (mean of e' P^-1 e), ``degrees_of_freedom``, ``trials`` and, if some trials differ
    only in the guess, ``pairs``: the number of different pairs of clouds or maps.
    """
    found_faults = []
    for implementation, name in dfpc.calibrated.items():
        try:
            data_sets = _real_data_sets(root / "docs" / "evaluation" / f"{name}.json", implementation)
        except InputError as error:
            found_faults.append(f"{implementation} is called calibrated: {error}")
            continue
        faults = [
            f"{implementation} is called calibrated, but on {data_set} {fault}"
            for data_set, figures in data_sets.items()
            if (fault := _fault(figures))
        ]
        if not faults and (fault := _joint_fault(list(data_sets.values()))):
            faults = [f"{implementation} is called calibrated, but in record {name!r} {fault}"]
        found_faults += faults
    return found_faults


def _real_data_sets(path: Path, implementation: str) -> dict[str, dict[str, Any]]:
    """Return the figures of an implementation on each real data set; raises InputError."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"record {path.stem!r}: {error}") from error
    data_sets: dict[str, dict[str, Any]] = record.get("figures", {}).get("real", {}).get(implementation, {})
    if not data_sets:
        raise InputError(
            f"record {path.stem!r} has no figures.real.{implementation}: expected real data sets, or no "
            "entry in calibrated of the dfpc.yaml"
        )
    return data_sets


def _fault(figures: dict[str, Any]) -> str:
    """Return why the figures on a data set do not show a calibrated covariance, or an empty string."""
    missing = {"squared_error", "degrees_of_freedom", "trials"} - figures.keys()
    if missing:
        return f"{', '.join(sorted(missing))} is missing"
    largest = _LARGEST_RATIO * figures["degrees_of_freedom"]
    if not figures["squared_error"] <= largest:
        return f"the NEES is {figures['squared_error']}: expected at most {largest:g}"
    return ""


def _joint_fault(data_sets: list[dict[str, Any]]) -> str:
    """Return why the figures on all data sets together do not suffice, or an empty string."""
    pairs = [figures.get("pairs", figures["trials"]) for figures in data_sets]
    if sum(pairs) < _LEAST_PAIRS:
        return f"there are {sum(pairs)} pairs of data: expected at least {_LEAST_PAIRS}"
    ratios = [figures["squared_error"] / figures["degrees_of_freedom"] for figures in data_sets]
    ratio = sum(n * r for n, r in zip(pairs, ratios, strict=True)) / sum(pairs)
    if ratio < _SMALLEST_RATIO:
        return (
            f"the NEES per degree of freedom is {ratio:.3g}: expected at least "
            f"{_SMALLEST_RATIO:g}; the covariance is too large"
        )
    return ""
