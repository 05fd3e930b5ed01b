# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions around a robot that moves on while they are looked at; the DPM is a script."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.request import parse_request
from services.orchestrator.product_finder import ProductFinder

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
S = 1_000_000_000


class DpmClient:
    """Holds nothing at the first search; a product of a second ago from the next search on."""

    def __init__(self) -> None:
        self.searches: list[dict[str, Any]] = []

    def search(self, until_s: float, **parameters: Any) -> list[dict[str, Any]]:
        self.searches.append(parameters)
        if len(self.searches) == 1:
            return []
        return [{"id": "one", "frame": "site", "t1_ns": 9 * S, "quality": {"status": "OK"}, "dfpc": "a_dfpc"}]

    def pose(
        self, robot: str, parent: str, child: str, t_ns: int | None, until_s: float
    ) -> UncertainTransform:
        assert t_ns is None, "nothing is there whose time could be asked for"
        return UncertainTransform.exact(se3.transform(np.eye(3), [4.0, 0.0, 0.0]))

    def value(self, product_id: str, robot: str, until_s: float) -> object:
        raise AssertionError("a product inserted during the pose query was used with the wrong region")

    def window(self, until_s: float, **parameters: object) -> object:
        raise AssertionError("a product inserted during the pose query was used with the wrong region")


@pytest.mark.parametrize("product", ["pointcloud", "dem", "navigation_map"])
def test_changes_during_a_position_query_wait_for_the_next_one(product: str) -> None:
    clock = ManualClock()
    clock.set_ns(10 * S)
    finder = ProductFinder(DpmClient(), clock, load_profile(PROFILE))  # type: ignore[arg-type]  # a script
    asked = {
        "type": product,
        "robot": "mana",
        "region": "near:mana/base,6",
        "request": "00000000-0000-4000-8000-000000000001",
    }
    result, why = finder.find(parse_request(asked, "mana"), ["mana"], 1e9)
    assert result is None
    assert "holds no" in why
