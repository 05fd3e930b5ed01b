# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Headers at and beyond each limit, and values that contradict their header."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from cdff_common.errors import ClockSkewError, FrameNotFoundError, InputError
from cdff_common.interfaces.product import Header, Quality, Status
from services.dpm.operations.checks import check_header, check_value
from services.dpm.operations.dpm import Dpm

from .conftest import S, cloud, elevation, put_arguments

NOW_NS = 100 * S
HEADER = Header(
    id="00000000-0000-5000-8000-00000000000a",
    seq=0,
    t0_ns=0,
    t1_ns=10 * S,
    frame="site",
    producer="test",
    config_hash="c",
)


def quality(**fields: Any) -> Quality:
    return Quality(Status.DEGRADED, **fields)


@pytest.mark.parametrize(
    "fields",
    [
        {"t0_ns": 0},
        {"t1_ns": NOW_NS + 60 * S},
        {"inputs": ("i",) * 10_000},
        {"inputs": ("i" * 64,)},
        {"producer": "p" * 256},
        {"config_hash": "c" * 256},
        {"quality": quality(reasons=("r" * 256,) * 64)},
        {"quality": quality(reasons=("r",), metrics={f"{k:0256}": 1.0 for k in range(256)})},
        {"resolution_m": 1e-9},
        {"resolution_m": None},
    ],
)
def test_a_header_at_a_limit_is_accepted(fields: dict[str, Any]) -> None:
    check_header(replace(HEADER, **fields), NOW_NS)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"t0_ns": -1000}, "t0_ns=-1000"),
        ({"inputs": ("i",) * 10_001}, "10001 ids"),
        ({"inputs": ("i", "i" * 65)}, "expected an id"),
        ({"inputs": ("i", "a/b")}, "expected an id"),
        ({"producer": "p" * 257}, "producer="),
        ({"config_hash": "c\n"}, "config_hash="),
        ({"quality": quality(reasons=("r",) * 65)}, "65 reasons"),
        ({"quality": quality(reasons=("r", "r" * 257))}, "2 reasons"),
        ({"quality": quality(reasons=("r",), metrics={str(k): 1.0 for k in range(257)})}, "257 metrics"),
        ({"quality": quality(reasons=("r",), metrics={"m" * 257: 1.0})}, "1 metrics"),
        ({"resolution_m": 0.0}, "resolution_m=0.0"),
        ({"resolution_m": float("inf")}, "resolution_m=inf"),
    ],
)
def test_a_header_beyond_a_limit_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_header(replace(HEADER, **fields), NOW_NS)


def test_a_capture_more_than_a_minute_ahead_of_the_mission_clock_may_be_sent_again() -> None:
    check_header(replace(HEADER, t1_ns=NOW_NS + 60 * S), NOW_NS)
    with pytest.raises(ClockSkewError, match="after the mission clock's now, expected at most 60 s"):
        check_header(replace(HEADER, t1_ns=NOW_NS + 60 * S + 1000), NOW_NS)


def test_a_value_in_another_frame_than_its_header_is_refused() -> None:
    check_value(cloud(), HEADER)
    with pytest.raises(InputError, match="in frame 'site', its header names mana/odom"):
        check_value(cloud(), replace(HEADER, frame="mana/odom"))


@pytest.mark.parametrize("axis", range(6))
def test_a_box_may_be_too_small_by_a_millimetre_only(axis: int) -> None:
    extent = list(cloud().extent_m())
    inwards = 1.0 if axis < 3 else -1.0
    for shift_m, accepted in ((0.0, True), (0.9e-3, True), (1.2e-3, False)):
        box = [v + inwards * shift_m * (i == axis) for i, v in enumerate(extent)]
        header = replace(HEADER, box_m=tuple(box))
        if accepted:
            check_value(cloud(), header)
        else:
            with pytest.raises(InputError, match="does not contain the content"):
                check_value(cloud(), header)


def test_frames_of_products_and_of_the_own_robot_are_known(dpm: Dpm) -> None:
    names = dpm.retrieval._frame_names
    names.check_known("site")
    with pytest.raises(FrameNotFoundError, match="mana/map"):
        names.check_known("mana/map")
    names.check_of_robot("mana/map", "mana")
    with pytest.raises(InputError, match=r"a product of mana: .*minnie/map"):
        names.check_of_robot("minnie/map", "mana")
    dpm.writer.put(*put_arguments(cloud_in("mana/map"), "pointcloud", 1, frame="mana/map"))
    names.check_known("mana/map")
    names.check_of_robot("mana/map", "minnie")


def cloud_in(frame: str) -> Any:
    points = cloud().points_m
    return type(cloud()).from_points(points, frame=frame, stamp_ns=S)


def test_a_flat_map_has_no_heights_and_its_box_may_have_some() -> None:
    flat = elevation(0.0)
    x0, y0, _, x1, y1, _ = flat.extent_m()
    check_value(flat, replace(HEADER, box_m=(x0, y0, -2.0, x1, y1, 5.0)))
    with pytest.raises(InputError, match="does not contain"):
        check_value(flat, replace(HEADER, box_m=(x0 + 0.1, y0, -2.0, x1, y1, 5.0)))
