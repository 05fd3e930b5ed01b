# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The containers are those of the profile that they run, and nothing of them is reached from elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from cdff_common.interfaces.profile import load_profile

ROOT = Path(__file__).resolve().parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))
DOCKERFILE = (ROOT / "deploy" / "docker" / "Dockerfile").read_text(encoding="utf-8")
SERVICES: dict[str, Any] = COMPOSE["services"]
HOSTS = {name: s for name, s in SERVICES.items() if s["build"]["target"] == "dfpc_host"}
PROFILE = load_profile(ROOT / SERVICES["icu"]["environment"]["CDFF_PROFILE"])


def test_there_is_one_container_per_service_and_per_process_of_the_profile() -> None:
    assert set(SERVICES) == {"router", "dpm", "orchestrator", "icu", "player", "operator", *PROFILE.processes()}
    assert set(HOSTS) == set(PROFILE.processes())


@pytest.mark.parametrize("name", HOSTS)
def test_host_runs_its_process_and_is_healthy_when_all_its_dfpcs_are_there(name: str) -> None:
    assert HOSTS[name]["command"][-2:] == ["--process", name]
    tokens = {f"{robot}/{entry.name}" for robot, entry in PROFILE.processes()[name]}
    assert set(HOSTS[name]["healthcheck"]["test"][4:]) == tokens


def test_player_waits_for_every_dfpc_that_takes_sensor_data() -> None:
    waited = {key.removeprefix("cdff/@v1/") for key in SERVICES["player"]["command"][2:]}
    fed = {
        f"{robot.id}/@alive/{entry.name}"
        for robot in PROFILE.robots
        for entry in robot.dfpcs
        if any(source.startswith("sensor/") for source in entry.inputs.values())
    }
    assert waited == fed | {f"ground/@alive/{s}" for s in ("dpm", "orchestrator", "icu")}


def test_ports_are_published_on_loopback_only() -> None:
    published = [port for service in SERVICES.values() for port in service.get("ports", ())]
    assert len(published) == 2
    assert all(port.startswith("127.0.0.1:") for port in published)


def test_long_running_services_restart_and_all_but_the_player_have_a_health_check() -> None:
    for name, service in SERVICES.items():
        if name != "operator":
            assert service["restart"] == "unless-stopped", name
        if name not in ("player", "operator"):
            assert "healthcheck" in service, name


def test_products_outlive_their_container() -> None:
    assert SERVICES["dpm"]["volumes"] == ["cdff-data:/var/lib/cdff"]
    assert "cdff-data" in COMPOSE["volumes"]


@pytest.mark.parametrize("name", HOSTS)
def test_what_waits_for_the_dpm_and_states_outlive_the_container_of_a_host(name: str) -> None:
    assert HOSTS[name]["volumes"] == ["cdff-dfpc:/var/lib/cdff"]
    assert "cdff-dfpc" in COMPOSE["volumes"]


def test_every_target_is_a_stage_and_only_the_algorithms_carry_open3d() -> None:
    parents = {words[3]: words[1] for line in DOCKERFILE.splitlines() if (words := line.split()) and words[0] == "FROM"}
    for name, service in SERVICES.items():
        target = service["build"]["target"]
        ancestors = [target]
        while parents.get(ancestors[-1]) in parents:
            ancestors.append(parents[ancestors[-1]])
        heavy = "algorithm-libraries" in ancestors
        assert heavy == (target in ("dfpc_host", "player")), name


def test_nothing_runs_as_root() -> None:
    user = ""
    for line in DOCKERFILE.splitlines():
        words = line.split()
        if words[:1] == ["FROM"]:
            stage = words[3]
        elif words[:1] == ["USER"]:
            user = words[1]
        elif words[:1] == ["CMD"]:
            assert user == "cdff", stage
