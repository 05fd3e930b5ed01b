# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors, their RPC codes and their HTTP statuses."""

import inspect

import pytest

from cdff_common import errors


def all_errors() -> list[type[errors.CdffError]]:
    classes = [c for _, c in inspect.getmembers(errors, inspect.isclass)]
    return [c for c in classes if issubclass(c, errors.CdffError) and c is not errors.CdffError]


@pytest.mark.parametrize("cls", all_errors())
def test_every_error_has_an_rpc_code_and_a_status(cls: type[errors.CdffError]) -> None:
    code, _ = errors.rpc_code(cls("x"))
    assert code in errors.ERROR_OF_CODE
    assert 400 <= errors.http_status(cls("x")) < 600


def test_an_unknown_exception_is_internal() -> None:
    assert errors.rpc_code(ValueError("x")) == ("INTERNAL", False)
    assert errors.http_status(ValueError("x")) == 500


def test_a_degenerate_geometry_error_lists_its_directions() -> None:
    error = errors.DegenerateGeometryError("plane", directions=["x", "rz"])
    assert error.directions == ("x", "rz")
    assert error.reasons == ("degenerate:x", "degenerate:rz")
