# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parsing and validation of request parameters."""

from __future__ import annotations

import math

import pytest

from cdff_common.contract.products import requestable_products
from cdff_common.errors import InputError
from cdff_core.orchestration.request import parse_request, parse_robot


def test_each_parameter_of_a_request_is_read() -> None:
    request = parse_request(
        {
            "type": "dem",
            "robot": "mana",
            "region": "bbox:-10,-5,10,5",
            "frame": "site",
            "max_age_s": "60",
            "resolution_m": "0.05",
            "format": "uper",
            "deadline_ms": "20000",
            "request": "a-b",
        },
        "ground",
    )
    assert (request.product, request.robot, request.frame, request.id) == ("dem", "mana", "site", "a-b")
    assert request.region is not None
    assert request.region.bounds == (-10.0, -5.0, 10.0, 5.0)
    assert (request.max_age_s, request.resolution_m, request.deadline_s) == (60.0, 0.05, 20.0)
    assert request.type_name == "Map"


def test_a_dem_in_another_encoding_or_by_name_keeps_all_its_layers() -> None:
    assert parse_request({"type": "dem", "format": "ber"}, "mana").type_name == "ElevationMap"
    assert parse_request({"type": "dem", "as": "ElevationMap"}, "mana").type_name == "ElevationMap"


def test_omitted_parameters_impose_no_limits() -> None:
    request = parse_request({"type": "pose"}, "mana")
    assert math.isinf(request.max_age_s)
    assert request.region is None
    assert request.robot == "mana"
    assert request.deadline_s < 10.0, "Zenoh ends a query after 10 s by default"


def test_under_a_robot_the_robot_must_match_and_under_ground_it_is_required() -> None:
    assert parse_request({"type": "pose", "robot": "mana"}, "mana").robot == "mana"
    assert parse_request({"type": "pose", "robot": "any"}, "ground").robot == "any"
    for parameters, scope in (({"type": "pose", "robot": "minnie"}, "mana"), ({"type": "pose"}, "ground")):
        with pytest.raises(InputError, match="robot"):
            parse_request(parameters, scope)


@pytest.mark.parametrize(
    ("parameters", "fault"),
    [
        ({}, "type"),
        ({"type": "painting"}, "painting"),
        ({"type": "dem", "colour": "red"}, "colour"),
        ({"type": "dem", "region": "circle:0,0"}, "circle:0,0"),
        ({"type": "dem", "region": "bbox:0,0,-1,1"}, "bbox"),
        ({"type": "dem", "resolution_m": "0"}, "resolution_m"),
        ({"type": "dem", "max_age_s": "nan"}, "max_age_s"),
        ({"type": "dem", "max_age_s": "soon"}, "soon"),
        ({"type": "pose", "t0": "1000"}, "t1 is missing"),
        ({"type": "pose", "t1": "1000"}, "t0 is missing"),
        ({"type": "pose", "t0": "2000", "t1": "1000"}, "later than t0"),
        ({"type": "pose", "t0": "1000", "t1": "2000", "t": "1000"}, "has no t"),
        ({"type": "dem", "min_coverage": "0.5"}, "region"),
        ({"type": "dem", "min_coverage": "2", "region": "circle:0,0,1"}, "min_coverage"),
        ({"type": "dem", "format": "bmp"}, "bmp"),
        ({"type": "dem", "format": "tif", "as": "Map"}, "Map"),
        ({"type": "dem", "as": "RigidBodyState"}, "RigidBodyState"),
        ({"type": "dem", "child": "mana/base"}, "child"),
        ({"type": "pose", "region": "circle:0,0,1"}, "region"),
        ({"type": "pose", "frame": "Site"}, "Site"),
        ({"type": "pose", "t": "yesterday"}, "yesterday"),
        ({"type": "pose", "deadline_ms": "1"}, "deadline_ms"),
        ({"type": "pose", "deliver": "pigeon"}, "pigeon"),
        ({"type": "pose", "request": "a b"}, "a b"),
    ],
)
def test_a_wrong_parameter_is_named_in_the_error(parameters: dict[str, str], fault: str) -> None:
    with pytest.raises(InputError, match=fault.replace("(", "\\(")):
        parse_request(parameters, "mana")


@pytest.mark.parametrize("product", sorted(requestable_products()))
def test_every_product_can_be_requested_in_every_codec(product: str) -> None:
    for codec in requestable_products()[product].formats:
        assert parse_request({"type": product, "format": codec}, "mana").format == codec


@pytest.mark.parametrize(
    "parameters",
    [
        {"type": "pose", "t": "1700000000000001000", "child": "mana/lidar", "status": "OK"},
        {"type": "dem", "region": "near:mana/base,3", "min_coverage": "0.25", "every_s": "0.5"},
        {"type": "pointcloud", "deliver": "none", "max_age_s": "2.5", "progress": "false", "priority": "9"},
        {"type": "track", "t0": "1000", "t1": "2000", "max_sigma_m": "0.1", "covariance_kind": "formal"},
    ],
)
def test_the_parameters_of_a_request_make_an_equal_request(parameters: dict[str, str]) -> None:
    request = parse_request({"deadline_ms": "1234.5", **parameters}, "mana")
    again = parse_request({name: str(value) for name, value in request.parameters().items()}, "ground")
    assert again == request


def test_a_description_of_a_request_is_plain_data() -> None:
    description = parse_request({"type": "dem", "region": "near:mana/base,5"}, "mana").describe()
    assert description["region"] == "near:mana/base,5"
    assert description["max_age_s"] is None


def test_priority_is_one_digit_and_explain_is_true_or_false() -> None:
    assert parse_request({"type": "pose"}, "mana").priority == 5
    assert parse_request({"type": "pose", "priority": "9", "explain": "true"}, "mana").explain
    for name, value in (("priority", "10"), ("priority", "-1"), ("priority", ""), ("explain", "yes")):
        with pytest.raises(InputError, match=name):
            parse_request({"type": "pose", name: value}, "mana")


def test_any_robot_is_only_accepted_where_supported() -> None:
    for robot in (None, "any"):
        with pytest.raises(InputError) as refused:
            parse_robot(robot, "ground")
        assert str(refused.value).rstrip(")").endswith("a robot id")
    assert parse_robot("any", "ground", any_robot=True) == "any"
    with pytest.raises(InputError, match="a robot id, or any"):
        parse_robot(None, "ground", any_robot=True)
