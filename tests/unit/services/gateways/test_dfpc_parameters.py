# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DFPCs keep the values that another client sets at the same time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from cdff_common.bus.message import Reply, unpack
from cdff_common.errors import InputError
from services.gateways.dfpc_parameters import DfpcParameters


class _DfpcBus:
    """A bus with one inactive DFPC, which another client configures just before each of the first calls."""

    def __init__(self, other_values: list[float]) -> None:
        self.parameters: dict[str, Any] = {"voxel_m": 0.5, "other": 0.0}
        self._other_values, self._changes = other_values, 0
        self.refused = 0

    def call(
        self, key: str, query: Mapping[str, Any] | None = None, *, payload: bytes = b"", timeout_s: float
    ) -> Reply:
        if key.endswith("/describe"):
            body = {"state": "inactive", "config_hash": str(self._changes), "parameters": self.parameters}
            return Reply.of(body)
        if self._other_values:
            self.parameters = {**self.parameters, "other": self._other_values.pop(0)}
            self._changes += 1
        assert query is not None
        new = unpack(payload)
        if query["if_match"] != str(self._changes) or new["voxel_m"] < 0.0:
            self.refused += 1
            raise InputError("refused")
        self.parameters, self._changes = new, self._changes + 1
        return Reply.of({})


def _parameters(bus: _DfpcBus) -> DfpcParameters:
    return DfpcParameters("mana", {"slam": ("voxel_m",)}, bus)  # type: ignore[arg-type]


def test_values_of_another_client_are_kept() -> None:
    bus = _DfpcBus([1.0, 2.0])
    _parameters(bus).set({"slam.voxel_m": 0.25})
    assert bus.parameters == {"voxel_m": 0.25, "other": 2.0}
    assert bus.refused == 2


def test_a_dfpc_that_others_configure_all_the_time_is_reported() -> None:
    bus = _DfpcBus([float(i) for i in range(100)])
    with pytest.raises(InputError, match="refused"):
        _parameters(bus).set({"slam.voxel_m": 0.25})
    assert bus.refused == 4


def test_a_value_that_the_dfpc_refuses_is_sent_once() -> None:
    bus = _DfpcBus([])
    with pytest.raises(InputError, match="refused"):
        _parameters(bus).set({"slam.voxel_m": -1.0})
    assert bus.refused == 1
