# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs

PORTS = ArrayPorts(
    {"image": "uint8[r,c]", "points": "float64[n,3]", "weights": "float64[n]", "noise": "float64[m,m]"},
    finite=["points"],
    positive=["weights", "edge_m"],
    optional=["image", "points", "weights", "noise", "edge_m"],
)


def check(**values: Any) -> None:
    without_values = {"image": None, "points": None, "weights": None, "noise": None, "edge_m": None}
    PORTS.check(SimpleNamespace(**without_values | values))


def test_inputs_that_fit_pass() -> None:
    check()
    check(
        image=np.zeros((4, 6), np.uint8),
        points=np.zeros((5, 3)),
        weights=np.ones(5),
        noise=np.eye(2),
        edge_m=0.1,
    )
    check(points=np.zeros((0, 3), np.float32), weights=np.ones(0))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"points": np.zeros((5, 2))}, r"points \(5, 2\): expected float64\[n,3\]$"),
        ({"points": np.zeros(3)}, r"points \(3,\): expected float64\[n,3\]$"),
        ({"points": np.zeros((5, 3)), "weights": np.ones(4)}, r"weights \(4,\): .* with n=5 of points"),
        ({"noise": np.zeros((2, 3))}, r"noise \(2, 3\): expected float64\[m,m\]$"),
        ({"image": np.zeros((4, 6))}, r"image \(4, 6\) of float64: expected uint8\[r,c\]"),
        ({"points": np.full((1, 3), np.nan)}, r"points: nan \(3 of 3\), expected finite numbers"),
        ({"weights": np.array([1.0, 0.0])}, r"weights: 0 \(1 of 2\), expected finite numbers above 0"),
        ({"edge_m": np.inf}, r"edge_m: inf \(1 of 1\), expected"),
        ({"edge_m": -0.5}, r"edge_m: -0.5 .* above 0"),
        ({"edge_m": "1"}, r"edge_m: 1, expected finite numbers above 0"),
        ({"points": [[1.0, 2.0, 3.0]]}, r"points: list, expected an array float64\[n,3\]"),
    ],
)
def test_an_input_that_does_not_fit_is_refused_by_name(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check(**values)


def test_none_is_refused_where_a_port_is_not_optional() -> None:
    ports = ArrayPorts({"points": "float64[n,3]"}, positive=["edge_m"])
    with pytest.raises(InputError, match=r"points: None, expected float64\[n,3\]"):
        ports.check(SimpleNamespace(points=None, edge_m=1.0))
    with pytest.raises(InputError, match=r"edge_m: None, expected finite numbers above 0"):
        ports.check(SimpleNamespace(points=np.zeros((2, 3)), edge_m=None))


def test_a_message_with_a_large_array_is_short() -> None:
    with pytest.raises(InputError) as refusal:
        check(points=np.full((100_000, 3), np.nan))
    assert len(str(refusal.value)) < 200


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WeightedPoints(DfnInputs):
    ARRAYS = ArrayPorts({"points": "float64[n,3]", "weights": "float64[n]"}, optional=["weights"])

    points: np.ndarray
    weights: np.ndarray | None = None


def test_inputs_are_checked_at_construction() -> None:
    points = np.zeros((5, 3))
    assert WeightedPoints(points=points).points is points
    with pytest.raises(InputError, match=r"weights \(4,\): .* with n=5 of points"):
        WeightedPoints(points=points, weights=np.ones(4))
