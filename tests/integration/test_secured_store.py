# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM of a secured mission: revocation without loss, audit of refusals, and HTTP with the same roles."""

from __future__ import annotations

import json
import ssl
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

from cdff_common.bus import keys
from cdff_common.errors import UnavailableError
from cdff_dev.ports import free_port
from services.keys.access_control import Kind
from tests.integration.conftest import process_starter, wait_until
from tests.support.dpm_products import pose, put_arguments
from tests.support.identities import PROFILE
from tests.support.secured_mission import Mission, secured_mission

pytestmark = [pytest.mark.integration, pytest.mark.slow]


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    with secured_mission(tmp_path_factory.mktemp("secured")) as running:
        yield running


@pytest.fixture(scope="module")
def store(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The DPM of the mission; its HTTP address."""
    folder = tmp_path_factory.mktemp("store")
    profile = folder / "profile.yaml"
    profile.write_text("name: test\nrobots: [{id: mana}, {id: minnie}]\n")
    address = f"127.0.0.1:{free_port()}"
    identity = str(mission.keys.folder / "ground")
    with process_starter(mission.endpoint, folder, CDFF_IDENTITY=identity) as start:
        start("services.dpm", "--profile", str(profile), "--http", address)
        expected = {keys.alive(scope, "dpm") for scope in ("ground", *PROFILE.robot_ids)}
        alice = mission.bus("alice")
        wait_until(lambda: alice.alive(keys.alive("*", "dpm")) == expected, 40, "the DPM")
        yield address


def test_no_product_is_lost_when_an_identity_is_revoked_and_refusals_are_audited(
    mission: Mission, store: str
) -> None:
    mission.keys.issue("carol", Kind.OPERATOR)
    stored: set[str] = set()
    stop = threading.Event()

    def insert() -> None:
        for seq in range(60):
            names, payload, encoding, attachment = put_arguments(
                pose(seq, 0.0), "pose", seq, child="mana/base"
            )
            while not stop.is_set():  # as an outbox does
                with suppress(UnavailableError):
                    reply = mission.bus("mana").call(
                        keys.dpm_rpc("mana", "put"),
                        names,
                        payload=payload,
                        encoding=encoding,
                        attachment=attachment,
                        timeout_s=5.0,
                    )
                    stored.add(reply.body()["id"])
                    break

    writer = threading.Thread(target=insert)
    writer.start()
    wait_until(lambda: len(stored) > 5, 20)
    mission.keys.revoke("carol")
    writer.join(60)
    stop.set()
    assert len(stored) == 60
    page = _ask(mission, "search", {"type": "pose", "limit": 100})
    assert {item["id"] for item in page["items"]} == stored

    mission.bus("mana").publish(keys.product("minnie", "audit", "out"), b"forged")

    def is_audited() -> bool:
        return "minnie/product/audit" in json.dumps(_ask(mission, "history", {"kind": "refused"}))

    wait_until(is_audited, 10, "the refusal in the history of the DPM")


def test_http_has_the_same_identities_and_roles(mission: Mission, store: str) -> None:
    products = f"https://{store}/api/v1/products"
    assert _get(products, _client_context(mission, "eve"))[0] == 200
    assert _get(products, _client_context(mission, None))[0] == 401
    missing = f"{products}/00000000-0000-5000-8000-000000000000"
    assert _get(missing, _client_context(mission, "eve"), "DELETE")[0] == 403
    assert _get(missing, _client_context(mission, "alice"), "DELETE")[0] == 404
    mission.keys.issue("dave", Kind.OPERATOR)
    assert _get(products, _client_context(mission, "dave"))[0] == 200
    mission.keys.revoke("dave")
    assert _get(products, _client_context(mission, "dave"))[0] == 401
    with pytest.raises(OSError, match=r"HTTP|closed|reset|Remote end|BadStatusLine|status line"):
        urllib.request.urlopen(products.replace("https", "http"), timeout=5)


def _ask(mission: Mission, operation: str, parameters: dict[str, object]) -> dict[str, Any]:
    """Return the answer of the DPM; the call is repeated while the router restarts after a revocation."""
    for _ in range(20):
        with suppress(UnavailableError):
            return dict(mission.bus("alice").call(keys.dpm_rpc("ground", operation), parameters).body())
        time.sleep(0.5)
    raise AssertionError(f"the DPM does not answer {operation}")


def _client_context(mission: Mission, name: str | None) -> ssl.SSLContext:
    folder = mission.keys.folder
    context = ssl.create_default_context(cafile=str(folder / "ca" / "ca.crt"))
    if name is not None:
        context.load_cert_chain(folder / name / "identity.crt", folder / name / "identity.key")
    return context


def _get(url: str, context: ssl.SSLContext, method: str = "GET") -> tuple[int, Any]:
    try:
        request = urllib.request.Request(url, method=method)
        with urllib.request.urlopen(request, timeout=10, context=context) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, None
