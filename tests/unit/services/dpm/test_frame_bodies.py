# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message bodies of frame revisions on the bus."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.contract.limits import LATEST_NS
from cdff_common.errors import InputError
from dpm_store.frames.frames import FARTHEST_FRAME_M
from services.dpm.queries.bodies import FrameRevisionBody, NewAnchor, parse_revision

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


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_edge_is_accepted_up_to_the_largest_distance(sign: float) -> None:
    def x_m(value: float) -> float:
        T = np.eye(4)
        T[0, 3] = sign * value
        return float(FrameRevisionBody.parse({**EDGE, "T": T.tolist()}).transform().matrix[0, 3])

    assert x_m(FARTHEST_FRAME_M) == sign * FARTHEST_FRAME_M
    with pytest.raises(InputError, match=r"T: a number of 1.1e\+12, expected at most 1e\+12 m"):
        x_m(1.1 * FARTHEST_FRAME_M)
    with pytest.raises(InputError, match="expected a finite number"):
        x_m(np.nan)


ANCHOR: dict[str, Any] = {"body": "mars", "lon_deg": 77.0, "lat_deg": 18.0}


def test_an_anchor_is_exact_at_height_zero_towards_north_by_default() -> None:
    anchor = NewAnchor.parse(ANCHOR)
    assert (anchor.height_m, anchor.azimuth_deg, anchor.sigma_m, anchor.sigma_deg) == (0.0, 0.0, 0.0, 0.0)
    assert anchor.expected_revision is None


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("field", ["lon_deg", "lat_deg", "height_m", "azimuth_deg", "sigma_m", "sigma_deg"])
def test_an_anchor_with_a_number_that_is_not_finite_is_refused(field: str, value: float) -> None:
    with pytest.raises(InputError, match=field):
        NewAnchor.parse(ANCHOR | {field: value})


@pytest.mark.parametrize(
    ("field", "limits", "beyond"),
    [
        ("lon_deg", (-360, 360), (-361, 361)),
        ("lat_deg", (-90, 90), (-91, 91)),
        ("azimuth_deg", (-360, 360), (-361, 361)),
        ("sigma_m", (0, 1e9), (-0.1, 1.1e9)),
        ("sigma_deg", (0, 1e9), (-0.1, 1.1e9)),
        ("expected_revision", (0, (1 << 31) - 1), (-1, 1 << 31)),
    ],
)
def test_numbers_of_an_anchor_are_accepted_up_to_their_limits(
    field: str, limits: tuple[float, ...], beyond: tuple[float, ...]
) -> None:
    for value in limits:
        assert getattr(NewAnchor.parse(ANCHOR | {field: value}), field) == value
    for value in beyond:
        with pytest.raises(InputError, match=field):
            NewAnchor.parse(ANCHOR | {field: value})


@pytest.mark.parametrize(("text", "revision"), [("*", None), ('"r12"', 12), ("3", 3), (" 4 ", 4)])
def test_a_revision_is_a_number_an_etag_or_any(text: str, revision: int | None) -> None:
    assert parse_revision(text) == revision


@pytest.mark.parametrize("text", [None, "", "r3", '"3"', "1234567890", "-1"])
def test_a_missing_or_malformed_revision_is_refused(text: str | None) -> None:
    with pytest.raises(InputError, match="if_match"):
        parse_revision(text)
