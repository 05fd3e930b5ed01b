# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A secured router refuses strangers and messages that an identity may not send, and reports both."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest
import zenoh

from cdff_common.bus import Bus, Reply, keys
from cdff_common.errors import ConfigurationError, NoAnswerError, UnavailableError
from cdff_dev.ports import free_port
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys
from tests.integration.conftest import process_starter, wait_until
from tests.support.identities import PROFILE, open_as
from tests.support.secured_mission import Mission, secured_mission

pytestmark = [pytest.mark.integration, pytest.mark.slow]

FORGED = b"forged"


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    with secured_mission(tmp_path_factory.mktemp("secured")) as running:
        yield running


def raw(bus: Bus) -> zenoh.Session:
    """Return the Zenoh session of a bus, with which a program can send what ``Bus`` does not."""
    return bus._session


@contextmanager
def collected(bus: Bus, key: str) -> Iterator[list[tuple[str, str]]]:
    """Yield the keys and kinds of the messages that ``bus`` receives on ``key``."""
    received: list[tuple[str, str]] = []
    subscriber = raw(bus).declare_subscriber(key, lambda s: received.append((str(s.key_expr), str(s.kind))))
    yield received
    subscriber.undeclare()


def forged_identity(folder: Path, *, trusted: Path) -> Path:
    """Return a certificate for mana of another authority with the same name; it trusts the real router."""
    forged = MissionKeys.create(folder, PROFILE, ())
    forged.issue("mana", Kind.ROBOT)
    (folder / "mana" / "ca.crt").write_bytes(trusted.read_bytes())
    return folder / "mana"


def test_a_forged_certificate_of_another_authority_is_refused(mission: Mission, tmp_path: Path) -> None:
    trusted = mission.keys.folder / "ca" / "ca.crt"
    forged = forged_identity(tmp_path / "forged", trusted=trusted)
    with pytest.raises(UnavailableError, match="refuses the certificate"):
        open_as(forged, mission.endpoint, wait_s=0)
    mission.expect_refusal("", "connect")
    assert any("BadSignature" in r["reason"] or "UnknownIssuer" in r["reason"] for r in mission.refused)
    wait_until(lambda: any(a["kind"] == "refused_identity" and a["active"] for a in mission.alarms), 5)


def test_a_router_of_another_authority_is_refused_by_clients(mission: Mission, tmp_path: Path) -> None:
    other = MissionKeys.create(tmp_path / "other", PROFILE, ())
    with pytest.raises(UnavailableError, match="refuses the certificate"):
        open_as(other.folder / "ground", mission.endpoint, wait_s=0)


def test_an_expired_certificate_is_refused(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.keys.authority._CLOCK_MARGIN", timedelta(days=10))
    mission.keys.issue("late", Kind.OPERATOR, days=-1)
    with pytest.raises(UnavailableError, match="refuses the certificate"):
        open_as(mission.keys.folder / "late", mission.endpoint, wait_s=0)
    wait_until(lambda: any("expired" in r["reason"] for r in mission.refused), 5)


def test_no_certificate_and_plain_tcp_are_refused(mission: Mission) -> None:
    port = mission.endpoint.rsplit(":", 1)[1]
    for address in (mission.endpoint, f"tcp/127.0.0.1:{port}"):
        config = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [address],
            "connect/timeout_ms": 500,
            "scouting/multicast/enabled": False,
            "transport/link/tls/root_ca_certificate": str(mission.keys.folder / "ca" / "ca.crt"),
        }.items():
            config.insert_json5(key, json.dumps(value))
        with pytest.raises(zenoh.ZError):
            zenoh.open(config)
    wait_until(lambda: any("corrupt message" in r["reason"] for r in mission.refused), 5)
    with pytest.raises(ConfigurationError, match="use tls/HOST:PORT"):
        open_as(mission.keys.folder / "mana", f"tcp/127.0.0.1:{port}")


def test_a_robot_publishes_below_its_own_scope_only(mission: Mission) -> None:
    mana, alice = mission.bus("mana"), mission.bus("alice")
    with collected(alice, "cdff/@v1/*/product/**") as received:
        own_key, foreign = keys.product("mana", "test", "out"), keys.product("minnie", "test", "out")
        wait_until(lambda: (mana.publish(own_key, b"1"), received)[1], 5)
        mana.publish(foreign, FORGED)
        raw(mana).delete(foreign)
        raw(mana).declare_publisher(foreign).put(FORGED)
        mission.expect_refusal("mana.", "Put", foreign)
        mission.expect_refusal("mana.", "Delete", foreign)
        assert {key for key, _ in received} == {own_key}
        raw(mana).delete(own_key)
        wait_until(lambda: (own_key, "SampleKind.DELETE") in received or len({k for _, k in received}) > 1, 5)


def test_a_robot_answers_below_its_own_scope_only(mission: Mission) -> None:
    mana, minnie, client = mission.bus("mana"), mission.bus("minnie"), mission.bus("autonomy")
    own_key, foreign = (keys.dfpc_rpc(robot, "test", "call/ask") for robot in ("mana", "minnie"))
    mana.serve(own_key, lambda _: Reply(b"mine"))
    mana.serve(foreign, lambda _: Reply(FORGED))
    mana.declare_alive("minnie", "forged")
    mana.declare_alive("mana", "test")
    minnie.declare_alive("minnie", "test")
    wait_until(
        lambda: client.alive(keys.alive("*", "test")) == {keys.alive(r, "test") for r in PROFILE.robot_ids}
    )
    assert client.call(own_key).payload == b"mine"
    with pytest.raises(NoAnswerError):
        client.call(foreign)
    assert not client.alive(keys.alive("*", "forged"))
    mission.expect_refusal("mana.", "Declare Queryable", "cdff/@v1/minnie")
    mission.expect_refusal("mana.", "Liveliness Token", keys.alive("minnie", "forged"))


def test_only_the_named_identity_publishes_the_mission_clock(mission: Mission) -> None:
    tick = {"now_ns": 1_000_000_000, "rate": 1.0}
    with collected(mission.bus("autonomy"), keys.CLOCK) as received:
        for name in ("mana", "ground", "alice"):
            mission.bus(name).publish_map(keys.CLOCK, tick)
            mission.expect_refusal(f"{name}.", "Put", keys.CLOCK)
        assert not received
        wait_until(lambda: (mission.bus("player").publish_map(keys.CLOCK, tick), received)[1], 5)


@pytest.mark.parametrize(
    ("name", "key", "is_answered"),
    [
        ("autonomy", keys.orchestrator_rpc("mana", "request"), True),
        ("autonomy", keys.dpm_rpc("ground", "search"), True),
        ("autonomy", keys.dpm_rpc("ground", "put"), False),
        ("autonomy", keys.icu_rpc("mana", "set_mode"), False),
        ("mana", keys.dpm_rpc("mana", "put"), True),
        ("mana", keys.dpm_rpc("minnie", "put"), False),
        ("mana", keys.dpm_rpc("ground", "delete"), False),
        ("mana", keys.dpm_rpc("ground", "retention"), False),
        ("mana", keys.dfpc_rpc("minnie", "other", "deactivate"), False),
        ("eve", keys.dpm_rpc("ground", "search"), True),
        ("eve", keys.orchestrator_rpc("ground", "request"), False),
        ("alice", keys.dpm_rpc("ground", "delete"), True),
        ("alice", keys.icu_rpc("mana", "set_mode"), True),
    ],
)
def test_calls_follow_the_role(mission: Mission, name: str, key: str, is_answered: bool) -> None:
    server = "minnie" if "/minnie/dfpc/" in key else "ground"
    mission.serve_once(server, key)
    if is_answered:
        wait_until(lambda: _answer(mission.bus(name), key) == b"done", 5, f"{key} for {name}")
    else:
        operator = mission.bus("alice")
        wait_until(lambda: _answer(operator, key) == b"done", 5, f"{key} for an operator")
        assert _answer(mission.bus(name), key) is None
        mission.expect_refusal(f"{name}.", "Query", key)


def _answer(bus: Bus, key: str) -> bytes | None:
    try:
        return bus.call(key, timeout_s=2.0).payload
    except NoAnswerError:
        return None


def test_a_revoked_identity_is_refused_within_five_seconds_and_a_new_certificate_works(
    mission: Mission,
) -> None:
    mission.keys.issue("bob", Kind.OPERATOR)
    stolen = mission.keys.folder / "stolen"
    wait_until(lambda: _opens(mission, "bob"), 10)
    (mission.keys.folder / "bob").rename(stolen)
    with open_as(stolen, mission.endpoint) as bus:
        wait_until(lambda: bus.alive(keys.alive("ground", "router")), 5)
        revoked_s = time.monotonic()
        mission.keys.revoke("bob")
        wait_until(lambda: not _sees_router(bus), 5, "the refusal of the revoked certificate")
        assert time.monotonic() - revoked_s < 5.0
        mission.keys.issue("bob", Kind.OPERATOR)  # the same name again
        wait_until(lambda: _opens(mission, "bob"), 10)
        assert not _sees_router(bus)
    mission.expect_refusal("bob.1", "connect")


def _opens(mission: Mission, name: str) -> bool:
    with open_as(mission.keys.folder / name, mission.endpoint) as bus:
        return _sees_router(bus)


def _sees_router(bus: Bus) -> bool:
    return bool(bus.alive(keys.alive("ground", "router"), timeout_s=1.0))


def test_the_router_of_a_robot_links_to_that_of_the_ground(mission: Mission, tmp_path: Path) -> None:
    endpoint = f"tls/127.0.0.1:{free_port()}"
    identity = mission.keys.folder / "mana"
    with process_starter(endpoint, tmp_path, CDFF_IDENTITY=str(identity)) as start:
        start("services.router", "--scope", "mana", "--uplink", mission.endpoint)
        alice = mission.bus("alice")
        with (
            open_as(identity, endpoint, wait_s=20) as mana,
            collected(alice, "cdff/@v1/*/event/*") as received,
        ):
            mission.bus("ground").serve(keys.dpm_rpc("mana", "stat"), lambda _: Reply(b"done"))
            wait_until(
                lambda: _answer(mana, keys.dpm_rpc("mana", "stat")) == b"done", 10, "a call to the ground"
            )
            event = keys.event("mana", "activated")
            wait_until(lambda: (mana.publish_map(event, {}), received)[1], 10, "an event of the robot")
            mana.serve(keys.dfpc_rpc("mana", "board", "status"), lambda _: Reply(b"board"))
            status = keys.dfpc_rpc("mana", "board", "status")
            wait_until(lambda: _answer(alice, status) == b"board", 10, "a call to the robot")
            tokens = {keys.alive(scope, "router") for scope in ("ground", "mana")}
            for bus in (mana, alice):
                wait_until(lambda bus=bus: bus.alive(keys.alive("*", "router")) == tokens, 10, "both routers")
            mana.publish_map(keys.event("minnie", "activated"), {})
            time.sleep(0.5)
            assert {key for key, _ in received} == {event}


def test_the_last_access_control_list_stays_valid_while_its_file_is_lost_or_malformed(
    mission: Mission,
) -> None:
    path = mission.keys.folder / "ground" / "access.json"
    content = path.read_bytes()
    mana, alice = mission.bus("mana"), mission.bus("alice")
    own_key, foreign = keys.product("mana", "test", "out"), keys.product("minnie", "test", "out")
    try:
        for malformed in (None, b"{", b'{"enabled": "perhaps"}'):
            path.unlink() if malformed is None else path.write_bytes(malformed)
            time.sleep(2.5)
            with collected(alice, "cdff/@v1/*/product/**") as received:
                mana.publish(foreign, FORGED)
                wait_until(lambda: (mana.publish(own_key, b"1"), received)[1], 5)
            assert {key for key, _ in received} == {own_key}
    finally:
        path.write_bytes(content)
    wait_until(lambda: _sees_router(alice), 20)
