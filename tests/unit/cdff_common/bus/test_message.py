# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters, errors and keys as sent over Zenoh."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdff_common.bus import keys
from cdff_common.bus.message import (
    encoding_argument,
    error_body,
    error_of,
    format_parameters,
    key_argument,
    parameters_of_malformed,
    parse_parameters,
    unpack,
)
from cdff_common.errors import CdffError, CodecError, DeadlineError, InputError, OverloadedError, StorageError

names = st.from_regex(r"[a-z_][a-z0-9_]{0,10}", fullmatch=True)


@given(st.dictionaries(names, st.text(max_size=30), max_size=8))
def test_parameters_survive_a_round_trip(parameters: dict[str, str]) -> None:
    assert parse_parameters(format_parameters(parameters)) == parameters


def test_a_request_with_a_region_needs_no_escapes() -> None:
    text = "type=dem;region=bbox:-10,-5,10,5;frame=mana/base;max_age_s=60"
    assert format_parameters(parse_parameters(text)) == text


@pytest.mark.parametrize("text", ["a=1;a=2", "=1", "a=%ff", ";".join(f"a{i}=1" for i in range(100))])
def test_malformed_parameters_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_parameters(text)


def test_an_encoding_that_zenoh_cannot_send_is_refused() -> None:
    assert encoding_argument("e" * 255) == "e" * 255
    assert encoding_argument("") is None
    with pytest.raises(InputError, match="256 bytes, expected at most 255"):
        encoding_argument("e" * 256)


def test_a_key_that_zenoh_cannot_send_is_refused() -> None:
    assert key_argument("k" * 4096) == "k" * 4096
    with pytest.raises(InputError, match="4097 bytes, expected at most 4096"):
        key_argument("k" * 4097)
    with pytest.raises(InputError, match="empty"):
        key_argument("")


def test_text_that_is_no_unicode_is_refused() -> None:
    surrogate = "\udc80"  # a byte of a file name that is not UTF-8
    for refused in (
        lambda: encoding_argument(surrogate),
        lambda: key_argument(surrogate),
        lambda: format_parameters({"id": surrogate}),
    ):
        with pytest.raises(InputError, match="UTF-8"):
            refused()


def test_an_error_keeps_its_class_and_detail() -> None:
    error = error_of(error_body(DeadlineError("too slow"), {"request": "r1"}))
    assert type(error) is DeadlineError
    assert str(error) == "too slow"


def test_an_overload_states_when_to_retry() -> None:
    error = error_of(error_body(OverloadedError("full", retry_after_s=2.5)))
    assert isinstance(error, OverloadedError)
    assert error.retry_after_s == 2.5


def test_a_full_disk_of_a_service_is_a_storage_error_of_the_client() -> None:
    error = error_of(error_body(StorageError("disk full")))
    assert (type(error), str(error), error.retriable) == (StorageError, "disk full", True)
    assert type(error_of(error_body(RuntimeError("bug")))) is CdffError


def test_an_unexpected_exception_becomes_internal_with_its_class_name() -> None:
    body = error_body(ZeroDivisionError("secret"))
    assert body["code"] == "INTERNAL"
    assert "ZeroDivisionError" in body["detail"]
    assert "secret" not in body["detail"]


@pytest.mark.parametrize("data", [b"\xc1", b"\x91", b"\x91" * 2000, b"", b"\x81\x90\x01"])
def test_bytes_that_are_not_messagepack_are_refused(data: bytes) -> None:
    with pytest.raises(CodecError):
        unpack(data)


def test_keys_follow_the_contract() -> None:
    assert keys.sensor("mana", "navcam", "pair") == "cdff/@v1/mana/sensor/navcam/pair"
    assert keys.source("mana", "product/vo/pose") == "cdff/@v1/mana/product/vo/pose"
    assert keys.dfpc_rpc("mana", "vo", "call/get_pose") == "cdff/@v1/mana/dfpc/vo/@rpc/call/get_pose"
    assert keys.orchestrator_rpc("ground", "request") == "cdff/@v1/ground/orchestrator/@rpc/request"
    assert keys.alive("ground", "dpm") == "cdff/@v1/ground/@alive/dpm"


@pytest.mark.parametrize("robot", ["", "Mana", "a/b", "**", "@v1", "a$*"])
def test_a_key_chunk_that_would_change_the_key_is_refused(robot: str) -> None:
    with pytest.raises(InputError):
        keys.sensor(robot, "navcam", "pair")


def test_an_error_states_its_request_id_even_if_parameters_are_invalid() -> None:
    error = InputError("no")
    error.request = "generated"
    assert error_body(error)["request"] == "generated"
    assert error_body(error, {"request": "sent"})["request"] == "sent"
    assert parameters_of_malformed("type=pose;type=dem;request=a%2Fb")["request"] == "a/b"
    assert "request" not in parameters_of_malformed("type=pose;my_request=7")
