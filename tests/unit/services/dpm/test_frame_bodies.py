# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message bodies of frame revisions on the bus."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.contract.limits import LATEST_NS
from cdff_common.errors import InputError
from services.dpm.queries.bodies import FrameRevisionBody

EDGE: dict[str, Any] = {"frame": "mana/odom", "parent": "site", "T": np.eye(4).tolist()}


@pytest.mark.parametrize("stamp_ns", [0, 5, 1_763_843_285_123_456_789, LATEST_NS])
def test_the_start_of_validity_is_exact_to_the_nanosecond(stamp_ns: int) -> None:
    assert FrameRevisionBody.parse({**EDGE, "valid_from_ns": stamp_ns}).valid_from_ns == stamp_ns


@pytest.mark.parametrize(
    "change", [{"valid_from_ns": LATEST_NS + 1}, {"expected_revision": -1}, {"revision": 3}, {"T": [[1.0]]}]
)
def test_an_invalid_body_is_refused_with_the_name_of_the_field(change: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(change))):
        FrameRevisionBody.parse({**EDGE, **change})
