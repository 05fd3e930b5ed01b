# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters and errors on the wire."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdff_common.bus import keys
from cdff_common.bus.message import error_body, error_of, format_parameters, parse_parameters, request_id_of, unpack
from cdff_common.errors import CodecError, DeadlineError, InputError, OverloadedError

names = st.from_regex(r"[a-z_][a-z0-9_]{0,10}", fullmatch=True)


@given(st.dictionaries(names, st.text(max_size=30), max_size=8))
def test_parameters_read_back_as_they_were_written(parameters: dict[str, str]) -> None:
    assert parse_parameters(format_parameters(parameters)) == parameters


def test_the_contract_s_example_needs_no_escapes() -> None:
    text = "type=dem;region=bbox:-10,-5,10,5;frame=mana/base;max_age_s=60"
    assert format_parameters(parse_parameters(text)) == text


@pytest.mark.parametrize("text", ["a=1;a=2", "=1", "a=%ff", ";".join(f"a{i}=1" for i in range(100))])
def test_parameters_that_cannot_be_meant_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_parameters(text)


def test_an_error_keeps_its_code_and_detail() -> None:
    error = error_of(error_body(DeadlineError("too slow"), "r1"))
    assert type(error) is DeadlineError
    assert str(error) == "too slow"


def test_an_overload_says_when_to_come_back() -> None:
    error = error_of(error_body(OverloadedError("full", retry_after_s=2.5)))
    assert isinstance(error, OverloadedError)
    assert error.retry_after_s == 2.5


def test_a_bug_is_internal_and_names_its_class() -> None:
    body = error_body(ZeroDivisionError("x"))
    assert body["code"] == "INTERNAL"
    assert "ZeroDivisionError" in body["detail"]


@pytest.mark.parametrize("data", [b"\xc1", b"\x91", b"\x91" * 2000, b""])
def test_bytes_that_are_not_messagepack_are_refused(data: bytes) -> None:
    with pytest.raises(CodecError):
        unpack(data)


def test_keys_are_those_of_the_contract() -> None:
    assert keys.sensor("mana", "navcam", "pair") == "cdff/@v1/mana/sensor/navcam/pair"
    assert keys.source("mana", "product/vo/pose") == "cdff/@v1/mana/product/vo/pose"
    assert keys.dfpc_rpc("mana", "vo", "call/get_pose") == "cdff/@v1/mana/dfpc/vo/@rpc/call/get_pose"
    assert keys.orchestrator_rpc("ground", "request") == "cdff/@v1/ground/orchestrator/@rpc/request"
    assert keys.alive("ground", "dpm") == "cdff/@v1/ground/@alive/dpm"


@pytest.mark.parametrize("robot", ["", "Mana", "a/b", "**", "@v1", "a$*"])
def test_a_key_chunk_that_would_change_the_key_is_refused(robot: str) -> None:
    with pytest.raises(InputError):
        keys.sensor(robot, "navcam", "pair")


def test_an_error_names_its_request_whoever_made_the_name_even_where_parameters_are_wrong() -> None:
    error = InputError("no")
    error.request = "made-for-you"
    assert error_body(error)["request"] == "made-for-you"
    assert error_body(error, "yours")["request"] == "yours"
    assert request_id_of("type=pose;type=dem;request=a%2Fb") == "a/b"
    assert request_id_of("type=pose;my_request=7") == ""
