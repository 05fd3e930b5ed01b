# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access of every role to every HTTP route, and refusals in the history."""

import hashlib
import json
import logging
import re
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
from fastapi.routing import APIRoute
from fastapi.testclient import TestClient

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.product import Header
from dpm_store.history.events import ROLES
from services.dpm.http.app import MODULES, create_app
from services.dpm.http.context import Context, jsonable
from services.dpm.http.middleware.roles import SAFE, Keys, Rule, allowed, rules_of
from services.dpm.operations import refusals
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import cloud, elevation, put_arguments

RULES = rules_of(module.router for module in MODULES)
#: Routes that need no key.
OPEN = {"/healthz", "/readyz", "/", "/docs", "/static/{name}"}
#: Routes with an endless answer.
STREAMS = {"/api/v1/events"}
READ = sorted(
    {
        route.path
        for module in MODULES
        for route in module.router.routes
        if isinstance(route, APIRoute) and "GET" in route.methods and route.path not in STREAMS
    }
)
WRITES = [(method, rule) for rule in RULES for method in sorted(rule.methods)]
NAMES = {"reader": "anna", "robot": "mana", "operator": "olaf", "admin": "ada"}


def key_of(role: str) -> dict[str, str]:
    return {"Authorization": f"Bearer key of {role}"}


@pytest.fixture
def guarded(dpm: Dpm, tmp_path: Path) -> Iterator[TestClient]:
    """A server off loopback with one key of each role."""
    keys = tmp_path / "keys"
    lines = [
        f"{hashlib.sha256(f'key of {role}'.encode()).hexdigest()} {role} {NAMES[role]}  # comment"
        for role in ROLES
    ]
    keys.write_text("# keys\n\n" + "\n".join(lines))
    settings = Settings(
        tmp_path, host="0.0.0.0", hosts=("dpm.example",), keys_file=keys, max_body_bytes=2 << 20
    )
    app = create_app(Context(dpm, settings))
    with TestClient(app, base_url="http://dpm.example", raise_server_exceptions=False) as client:
        yield client


def concrete(path: str) -> str:
    """Return a route's path with a value for each path parameter."""
    return re.sub(r"\{\w+(:path)?\}", "x", path)


@pytest.mark.parametrize(("method", "rule"), WRITES, ids=lambda v: v.path if isinstance(v, Rule) else v)
def test_every_writing_route_names_its_roles_including_admin(method: str, rule: Rule) -> None:
    assert rule.roles, f"{method} {rule.path}: give it openapi_extra=allowed(…)"
    assert "admin" in rule.roles


@pytest.mark.req("CDFF-SUP-163")
@pytest.mark.parametrize(("method", "rule"), WRITES, ids=lambda v: v.path if isinstance(v, Rule) else v)
@pytest.mark.parametrize("role", ROLES)
def test_a_role_may_use_exactly_its_routes(guarded: TestClient, method: str, rule: Rule, role: str) -> None:
    answer = guarded.request(method, concrete(rule.path), headers=key_of(role))
    assert rule.roles is not None
    assert (answer.status_code in (401, 403)) == (role not in rule.roles), answer.text


@pytest.mark.parametrize("path", READ)
def test_reading_requires_a_key_of_any_role(guarded: TestClient, path: str) -> None:
    url = concrete(path)
    for role in ROLES:
        assert guarded.get(url, headers=key_of(role)).status_code not in (401, 403)
    for wrong in ({}, {"Authorization": "Bearer nonsense"}, {"Authorization": "Basic key of admin"}):
        answer = guarded.get(url, headers=wrong)
        assert (answer.status_code == 401) == (path not in OPEN)
        assert path in OPEN or answer.headers["www-authenticate"] == "Bearer"


def test_a_writing_route_without_roles_is_forbidden(guarded: TestClient, dpm: Dpm, tmp_path: Path) -> None:
    from fastapi import APIRouter

    from services.dpm.http.middleware.guard import Guard
    from services.dpm.operations.refusals import RefusalLog

    router = APIRouter()
    router.post("/new")(lambda: None)
    guard = Guard(
        create_app(Context(dpm, Settings(tmp_path))), Settings(tmp_path), rules_of([router]), RefusalLog(dpm)
    )
    assert TestClient(guard, base_url="http://localhost").post("/new").status_code == 403


def test_a_reading_post_is_not_a_write() -> None:
    (search,) = [rule for rule in RULES if rule.path == "/stac/search"]
    assert not search.changes
    assert all(rule.changes for rule in RULES if rule is not search)


def test_the_openapi_document_names_the_roles_of_writing_routes(guarded: TestClient) -> None:
    document = guarded.get("/openapi.json", headers=key_of("reader")).json()
    for path, verbs in document["paths"].items():
        for verb, operation in verbs.items():
            assert verb.upper() in SAFE or operation["x-cdff-roles"], path


def test_an_unknown_role_of_a_route_is_refused() -> None:
    with pytest.raises(ValueError, match="king"):
        allowed("king")


def insertion(robot: str) -> dict:
    """Return the arguments of the POST request with which robot mana inserts a product of a robot."""
    names, payload, encoding, attachment = put_arguments(cloud(), "pointcloud", robot=robot)
    header = jsonable(Header.from_attachment(attachment).to_dict())
    return {
        "params": names,
        "content": payload,
        "headers": {"Content-Type": encoding, "CDFF-Header": json.dumps(header), **key_of("robot")},
    }


def test_a_robot_writes_its_own_products_only(guarded: TestClient, dpm: Dpm) -> None:
    assert guarded.post("/api/v1/products", **insertion("mana")).status_code == 201
    other = guarded.post("/api/v1/products", **insertion("minnie"))
    assert other.status_code == 403
    assert "own products" in other.json()["detail"]
    assert dpm.store.statistics().count == 1
    names = ("encoding", "attachment", "payload")
    mixed = [
        {**key, **dict(zip(names, (encoding, attachment, payload), strict=True))}
        for key, payload, encoding, attachment in (
            put_arguments(elevation(0.0), "dem", 1, robot="mana"),
            put_arguments(elevation(0.0), "dem", 1, robot="minnie"),
        )
    ]
    answer = guarded.post("/api/v1/products/batch", content=msgpack.packb(mixed), headers=key_of("robot"))
    assert answer.status_code == 403
    assert dpm.store.statistics().count == 1


@pytest.mark.req("CDFF-SUP-163")
def test_the_history_names_writers_and_refused_clients(guarded: TestClient, dpm: Dpm) -> None:
    stored_id = guarded.post("/api/v1/products", **insertion("mana")).json()["id"]
    url = f"/api/v1/products/{stored_id}"
    guarded.patch(url, json={"tags": ["a"]}, headers=key_of("operator") | {"If-Match": "*"})
    guarded.delete(url, headers=key_of("reader"))
    guarded.delete(url, headers={"Authorization": "Bearer nonsense"})
    guarded.post("/api/v1/products", **insertion("minnie"))
    guarded.delete(url, headers=key_of("admin"))
    records = [
        (e.kind, e.body["by"], e.body["status"] if e.kind == "refused" else None)
        for e in dpm.store.events.since()
    ]
    assert records == [
        ("inserted", "http/robot/mana", None),
        ("updated", "http/operator/olaf", None),
        ("refused", "http/reader/anna", 403),
        ("refused", "unknown", 401),
        ("refused", "http/robot/mana", 403),
        ("deleted", "http/admin/ada", None),
    ]
    assert all(
        "key of" not in str(e.body) and "nonsense" not in str(e.body) for e in dpm.store.events.since()
    )


def test_repeated_refusals_are_counted_instead_of_recorded(
    guarded: TestClient, dpm: Dpm, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(refusals, "monotonic_s", lambda: now_s[0])
    with caplog.at_level(logging.WARNING, "services.dpm.operations.refusals"):
        for _ in range(50):
            guarded.delete("/api/v1/products/x", headers={"Authorization": "Bearer secret-of-mine"})
        now_s[0] += 61.0
        guarded.delete("/api/v1/products/x", headers={"Authorization": "Bearer secret-of-mine"})
    first, last = (e.body for e in dpm.store.events.since(kind="refused"))
    assert (first["left_out"], last["left_out"]) == (0, 49)
    assert len([r for r in caplog.records if r.name == "services.dpm.operations.refusals"]) == 2
    assert "secret" not in caplog.text


def test_keys_are_stored_as_hashes_and_malformed_lines_are_refused_without_being_shown(
    tmp_path: Path,
) -> None:
    path = tmp_path / "keys"
    digest = hashlib.sha256(b"k").hexdigest()
    path.write_text(f"{digest.upper()} robot mana\n")
    actor = Keys(path).actor("bearer k ")
    assert actor is not None
    assert (actor.name, actor.role) == ("mana", "robot")
    malformed = (
        f"{digest} robot",
        f"{digest} robot Mana!",
        f"{digest} king mana",
        f"{digest[:-1]} admin a",
        "plainkey",
    )
    for line in malformed:
        path.write_text(line)
        with pytest.raises(ConfigurationError, match="keys:1") as refusal:
            Keys(path)
        assert digest[:10] not in str(refusal.value)
        assert "plainkey" not in str(refusal.value)
    with pytest.raises(ConfigurationError):
        Keys(tmp_path / "absent")
