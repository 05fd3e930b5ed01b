# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All operations of the OpenAPI document with generated requests: every answer is documented, none is 5xx.

The fast tests send few requests per operation, the slow ones more, also in sequences; ``python -m evaluation
http_contract`` sends many.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("schemathesis", reason="schemathesis is not installed")
from evaluation.runs import http_contract

OPERATIONS = http_contract.operations()


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The OpenAPI document of a server with products, read from the application by schemathesis."""
    with http_contract.application(tmp_path_factory.mktemp("store")) as app:
        yield http_contract.document_of(app)


@pytest.mark.req("CDFF-SUP-161")
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_operation_conforms_to_its_openapi_document(document: Any, method: str, path: str) -> None:
    http_contract.check_operation(document, method, path, 8)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_generated_requests_conform_to_the_openapi_document(document: Any, method: str, path: str) -> None:
    http_contract.check_operation(document, method, path, 20)


@pytest.mark.slow
def test_sequences_of_requests_conform_to_the_openapi_document(tmp_path: Path) -> None:
    answers = http_contract.check_sequences(tmp_path, count=30, steps=12)
    followed = [label for label, by_status in answers.items() if "{" in label and by_status[200]]
    assert len(followed) >= 8, answers
