# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bounds of query parameters."""

from __future__ import annotations

import pytest

from cdff_common.contract.limits import MAX_AGE_S
from cdff_common.contract.queries import RequestParameters
from cdff_common.errors import InputError


@pytest.mark.parametrize("text", ["1e300", "inf", "nan", "-1", str(2 * MAX_AGE_S)])
def test_an_age_outside_its_bounds_is_refused_with_the_parameter_named(text: str) -> None:
    with pytest.raises(InputError, match="max_age_s"):
        RequestParameters.parse({"type": "pose", "robot": "mana", "max_age_s": text})


def test_the_largest_age_is_accepted() -> None:
    parsed = RequestParameters.parse({"type": "pose", "robot": "mana", "max_age_s": str(MAX_AGE_S)})
    assert parsed.max_age_s == MAX_AGE_S
