# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``docker-compose up``, tested from outside the containers; skipped if no Docker engine answers."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import UnavailableError
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(3000)]

#: User id in the containers.
USER = 10001


def compose_command() -> list[str]:
    """Return ``docker compose`` or ``docker-compose``; skip the test if neither can be used."""
    if (
        shutil.which("docker") is None
        or subprocess.run(["docker", "info"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no Docker engine answers")
    if not subprocess.run(["docker", "compose", "version"], capture_output=True, check=False).returncode:
        return ["docker", "compose"]
    if shutil.which("docker-compose") is None:
        pytest.skip("neither docker compose nor docker-compose is installed")
    return ["docker-compose"]


class ComposeProject:
    """The system in containers, with the ports of its router and its HTTP server on loopback.

    With the folder of the identities of a mission its bus is secured.
    """

    def __init__(self, name: str, secrets: Path | None = None, override: str | None = None) -> None:
        self.router_port, self.http_port = free_port(), free_port()
        self.endpoint = f"{'tcp' if secrets is None else 'tls'}/127.0.0.1:{self.router_port}"
        files = ["docker-compose.yml", *([override] if override else [])]
        self._command = [*compose_command(), "-p", name, *(word for file in files for word in ("-f", file))]
        self._environment = {
            **os.environ,
            "CDFF_ROUTER_PORT": str(self.router_port),
            "CDFF_HTTP_PORT": str(self.http_port),
            "CDFF_SECRETS": str(secrets or ""),
            "CDFF_DATABASE_PASSWORD": "database",
            "CDFF_OBJECTS_SECRET": "objects",
        }

    def __call__(self, *arguments: str) -> str:
        """Run compose and return its output."""
        result = subprocess.run(
            [*self._command, *arguments],
            cwd=ROOT,
            env=self._environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    def container(self, service: str) -> str:
        """Return the id of a service's container."""
        return self("ps", "-q", service).strip()

    def inspect(self, service: str, template: str) -> str:
        """Return a field of ``docker inspect``."""
        command = ["docker", "inspect", "-f", template, self.container(service)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    def get(self, path: str) -> Any:
        """Return the JSON that the published HTTP server serves at a path."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.http_port}{path}", timeout=10) as response:
            return json.load(response)


@pytest.fixture(scope="module")
def composed() -> Iterator[ComposeProject]:
    yield from running(ComposeProject("cdfftest"))


@pytest.fixture(scope="module")
def secrets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Identities of a mission, owned by the user of the containers."""
    if os.geteuid() != 0:
        pytest.skip("only root can give the identities to the user of the containers")
    folder = tmp_path_factory.mktemp("secrets")
    for arguments in (
        ("init", "--profile", "rover_traverse", "--host", "router", "--host", "dpm"),
        ("robot", "mana"),
        ("robot", "minnie"),
        ("player", "player"),
        ("client", "autonomy"),
    ):
        command = [sys.executable, "-m", "cdff_common.cli", "keys", *arguments, "--folder", str(folder)]
        subprocess.run(command, check=True)
    for path in (folder, *folder.rglob("*")):
        os.chown(path, USER, USER)
    return folder


@pytest.fixture(scope="module")
def secured(secrets: Path) -> Iterator[ComposeProject]:
    yield from running(ComposeProject("cdffsecured", secrets, "docker-compose.secure.yml"))


@pytest.fixture(scope="module")
def scaled() -> Iterator[ComposeProject]:
    yield from running(ComposeProject("cdffscaled", override="deploy/scale/compose.yml"))


def running(compose: ComposeProject) -> Iterator[ComposeProject]:
    """Build and start a project, and remove it at the end."""
    compose("build")
    try:
        compose("up", "-d")
        yield compose
    finally:
        compose("down", "-v")


def wait_until(condition: Callable[[], object], timeout_s: float, description: str) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, f"{description}: not within {timeout_s:g} s"
        time.sleep(0.5)


def assert_all_requests_are_answered(compose: ComposeProject) -> None:
    wait_until(
        lambda: compose.inspect("operator", "{{.State.Status}}") == "exited", 1200, "the operator ends"
    )
    logs = compose("logs", "operator")
    assert compose.inspect("operator", "{{.State.ExitCode}}") == "0", logs
    assert "8 of 8 requests were answered as asked" in logs


def test_the_operator_container_receives_every_answer(composed: ComposeProject) -> None:
    assert_all_requests_are_answered(composed)


def test_every_service_with_a_health_check_is_healthy(composed: ComposeProject) -> None:
    services = [s for s in composed("config", "--services").split() if s not in {"player", "operator"}]
    for service in services:
        wait_until(
            lambda s=service: composed.inspect(s, "{{.State.Health.Status}}") == "healthy", 120, service
        )


def test_http_and_product_requests_work_from_outside(composed: ComposeProject) -> None:
    assert {robot["id"] for robot in composed.get("/api/v1/robots")["items"]} >= {"mana", "minnie"}
    with Client(composed.endpoint) as client:
        assert client.request("pose", robot="mana").header.child == "mana/base"
        assert client.request("dem", robot="mana", resolution_m=0.2).value.geometry.frame == "site"


def test_ports_are_published_on_loopback_only(composed: ComposeProject) -> None:
    for service in ("router", "dpm"):
        bindings = json.loads(composed.inspect(service, "{{json .NetworkSettings.Ports}}"))
        assert {b["HostIp"] for published in bindings.values() if published for b in published} == {
            "127.0.0.1"
        }


def test_a_killed_service_is_restarted_and_products_survive(composed: ComposeProject) -> None:
    count_before = composed.get("/api/v1/status")["products"]
    pid = composed.inspect("dpm", "{{.State.Pid}}")
    os.kill(int(pid), 9)
    with Bus.open(composed.endpoint, name="test", wait_s=10) as bus:
        token = keys.alive("ground", "dpm")
        wait_until(
            lambda: composed.inspect("dpm", "{{.State.Pid}}") not in {pid, "0"}, 30, "dpm is restarted"
        )
        wait_until(lambda: token in bus.alive(token), 30, "dpm is alive again")
    wait_until(
        lambda: composed.get("/api/v1/status")["products"] >= count_before, 30, "products are stored again"
    )


@pytest.mark.parametrize("service", ["router", "dpm", "orchestrator", "icu"])
def test_light_images_contain_no_algorithm_libraries(composed: ComposeProject, service: str) -> None:
    code = "import importlib.util as u; print(any(u.find_spec(m) for m in ('open3d', 'cv2', 'cdff_dev')))"
    command = ["docker", "exec", composed.container(service), "python", "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_secured_containers_answer_every_request_and_admit_no_stranger(
    secured: ComposeProject, secrets: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_all_requests_are_answered(secured)
    with (
        pytest.raises(UnavailableError),
        Client(secured.endpoint.replace("tls", "tcp")) as client,
    ):
        client.request("pose", robot="mana")
    monkeypatch.setenv("CDFF_IDENTITY", str(secrets / "autonomy"))
    with Client(secured.endpoint) as client:
        assert client.request("pose", robot="mana").header.child == "mana/base"


def test_a_store_on_servers_answers_every_request_and_a_killed_worker_returns(scaled: ComposeProject) -> None:
    assert_all_requests_are_answered(scaled)
    pids = {s: scaled.inspect(s, "{{.State.Pid}}") for s in ("dpm_1", "database", "objects")}
    for pid in pids.values():
        os.kill(int(pid), 9)
    for service, pid in pids.items():
        wait_until(
            lambda s=service, p=pid: scaled.inspect(s, "{{.State.Pid}}") not in {p, "0"},
            60,
            f"{service} is restarted",
        )
    with Bus.open(scaled.endpoint, name="test", wait_s=10) as bus:
        token = keys.alive("ground", "dpm_1")
        wait_until(lambda: token in bus.alive(token), 120, "the worker returns")
    wait_until(lambda: has_poses(scaled), 120, "the store answers again")


def has_poses(compose: ComposeProject) -> bool:
    """Return whether the DPM finds stored poses."""
    try:
        return len(compose.get("/api/v1/products?type=pose&limit=5")["items"]) == 5
    except OSError:
        return False
