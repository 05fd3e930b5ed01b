# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All operations of the OpenAPI document with generated requests: every answer is documented, none is 5xx.

The fast tests send few requests per operation, the slow ones many.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from cdff_common.bus import Reply
from cdff_common.clock import ManualClock
from cdff_common.errors import NoAnswerError
from cdff_common.geodesy import Anchor, body
from dpm_store import open_store
from services.dpm.http.app import create_app, openapi
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import S, cloud, elevation, navigation, pose, put_arguments

schemathesis = pytest.importorskip("schemathesis", reason="schemathesis is not installed")
conformance = pytest.importorskip("schemathesis.specs.openapi.checks")

CHECKS = [
    schemathesis.checks.not_a_server_error,
    conformance.status_code_conformance,
    conformance.content_type_conformance,
    conformance.response_headers_conformance,
    conformance.response_schema_conformance,
]
HEADERS = {"Host": "localhost"}
#: The endless stream of events, which has its own tests.
ENDLESS = "/api/v1/events"
OPERATIONS = [
    (verb.upper(), path) for path, verbs in openapi()["paths"].items() for verb in verbs if path != ENDLESS
]


class Orchestrator:
    """Bus double that answers like an orchestrator."""

    def call(self, key: str, parameters: dict[str, str], **_: Any) -> Reply:
        """Return an empty list of jobs, or a reference."""
        if key.endswith("/jobs"):
            return Reply.of({"jobs": []})
        if key.endswith("/request"):
            return Reply.of({}, kind="reference", id="0" * 36, job="j", final=True)
        raise NoAnswerError(f"{key}: no answer")

    def alive(self, _key: str) -> set[str]:
        """Return the liveliness tokens: none."""
        return set()


@pytest.fixture(scope="module")
def application(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A server with a store that has products of each kind on an anchored site."""
    directory = tmp_path_factory.mktemp("store")
    with open_store(f"sqlite:///{directory}", ManualClock(100 * S)) as store:
        dpm = Dpm(store, max_payload_bytes=1 << 20)
        store.anchors.anchor("site", Anchor(body("mars"), 77.45, 18.44))
        dpm.writer.put(*put_arguments(elevation(0.0), "dem", 0, resolution_m=0.1))
        dpm.writer.put(*put_arguments(navigation(), "navigation_map", 1, resolution_m=0.1))
        dpm.writer.put(*put_arguments(cloud(), "pointcloud", 2))
        for second in range(3):
            dpm.writer.put(*put_arguments(pose(second, float(second)), "pose", second + 3, child="mana/base"))
        yield create_app(Context(dpm, Settings(directory, max_body_bytes=1 << 20), bus=Orchestrator()))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def document(application: Any) -> Any:
    """The OpenAPI document, read from the application by schemathesis."""
    return schemathesis.openapi.from_asgi("/openapi.json", application, headers=HEADERS)


def check_operation(document: Any, method: str, path: str, count: int) -> None:
    """Send generated requests to an operation and validate each answer by the document."""

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=document[path][method].as_strategy())
    def call(case: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            case.call_and_validate(headers=HEADERS, checks=CHECKS)

    call()


@pytest.mark.req("CDFF-SUP-161")
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_every_operation_conforms_to_its_openapi_document(document: Any, method: str, path: str) -> None:
    check_operation(document, method, path, 8)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "path"), OPERATIONS)
def test_generated_requests_conform_to_the_openapi_document(document: Any, method: str, path: str) -> None:
    check_operation(document, method, path, 50)
