# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A product inserted while the position of a robot is queried is not used for a region around that robot."""

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
    """DPM double that finds nothing in the first search, and a product of one second ago in later ones."""

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
        assert t_ns is None, "the first search finds no product whose time could be used"
        return UncertainTransform.exact(se3.transform(np.eye(3), [4.0, 0.0, 0.0]))

    def value(self, product_id: str, robot: str, until_s: float) -> object:
        raise AssertionError("a product inserted during the pose query was used with the wrong region")

    def window(self, until_s: float, **parameters: object) -> object:
        raise AssertionError("a product inserted during the pose query was used with the wrong region")


@pytest.mark.parametrize("product", ["pointcloud", "dem", "navigation_map"])
def test_a_product_inserted_during_the_position_query_is_not_used(product: str) -> None:
    clock = ManualClock()
    clock.set_ns(10 * S)
    finder = ProductFinder(DpmClient(), clock, lambda: load_profile(PROFILE))  # type: ignore[arg-type]  # double
    parameters = {
        "type": product,
        "robot": "mana",
        "region": "near:mana/base,6",
        "request": "00000000-0000-4000-8000-000000000001",
    }
    result, reason = finder.find(parse_request(parameters, "mana"), ["mana"], 1e9)
    assert result is None
    assert "holds no" in reason
