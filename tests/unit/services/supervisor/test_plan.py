# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Processes that the supervisor starts on each machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import load_profile
from services.supervisor.plan import ProcessSpec, plan

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "two_rovers.yaml"
GROUND = ["router", "dpm", "orchestrator", "icu", "map_merging"]
ROVERS = ["mana_slam", "mana_mapping", "minnie_slam", "minnie_mapping"]


def planned(**options: Any) -> list[ProcessSpec]:
    return plan(
        load_profile(PROFILE), PROFILE, connect="tcp/a:1", http="b:2", data_dir=Path("data"), **options
    )


def test_a_whole_profile_runs_on_one_machine_by_default() -> None:
    assert [s.name for s in planned()] == GROUND + ROVERS


def test_a_robot_with_its_own_machine_has_its_own_router_linked_to_the_ground() -> None:
    ground, mana = planned(scopes=["ground", "minnie"]), planned(scopes=["mana"], uplink="tcp/c:3")
    assert [s.name for s in ground] == GROUND + ROVERS[2:]
    assert [s.name for s in mana] == ["router", *ROVERS[:2]]
    assert ground[0].tokens == (("ground", "router"),)
    assert mana[0].tokens == (("mana", "router"),)
    assert mana[0].argv[-4:] == ("--scope", "mana", "--uplink", "tcp/c:3")
    assert "--uplink" not in ground[0].argv


def test_each_robot_of_a_profile_with_several_orchestrators_has_one_and_a_control_unit() -> None:
    profile = load_profile(PROFILE).model_copy(update={"orchestration": "robots"})

    def names(*scopes: str) -> dict[str, tuple[str, ...]]:
        specs = plan(profile, PROFILE, connect="tcp/a:1", http="b:2", data_dir=Path("data"), scopes=scopes)
        return {s.name: s.argv[3:] for s in specs}

    ground, mana = names("ground"), names("mana")
    assert ground["orchestrator"] == ("--scope", "ground")
    assert "icu" not in ground
    assert list(mana) == ["router", "mana_orchestrator", "mana_icu", *ROVERS[:2]]
    assert mana["mana_orchestrator"] == mana["mana_icu"] == ("--scope", "mana")
    assert len(names()) == len(GROUND) - 1 + 4 + len(ROVERS)


def test_workers_of_the_dpm_answer_on_its_address() -> None:
    specs = {s.name: s for s in planned(dpm_workers=2)}
    assert list(specs) == ["router", "dpm", "dpm_1", "dpm_2", *GROUND[2:], *ROVERS]
    assert specs["dpm"].argv[3:] == ("--http", "b:2", "--share-port")
    assert specs["dpm_2"].argv[3:] == ("--http", "b:2", "--worker", "2")
    assert specs["dpm_2"].tokens == (("ground", "dpm_2"),)
    assert "--share-port" not in next(s for s in planned() if s.name == "dpm").argv


def test_an_unknown_scope_is_refused() -> None:
    with pytest.raises(
        ConfigurationError, match="scope 'manna': profile two_rovers has ground, mana, minnie"
    ):
        planned(scopes=["manna"])


def test_a_secured_plan_gives_each_process_the_identity_of_its_scope(tmp_path: Path) -> None:
    for name in ("ground", "mana", "minnie"):
        (tmp_path / name).mkdir()
        for file in ("ca.crt", "identity.crt", "identity.key"):
            (tmp_path / name / file).touch(0o600)
    specs = planned(secrets=tmp_path)
    identities = {s.name: Path(s.environment["CDFF_IDENTITY"]).name for s in specs}
    assert {identities[name] for name in GROUND} == {"ground"}
    assert identities["mana_slam"] == "mana"
    assert identities["minnie_mapping"] == "minnie"
    (tmp_path / "mana" / "identity.key").unlink()
    with pytest.raises(ConfigurationError, match=r"mana/identity\.key: cannot be read"):
        planned(secrets=tmp_path)


def test_the_gateways_of_a_robot_run_on_its_machine_with_the_settings_of_its_profile(tmp_path: Path) -> None:
    profile = load_profile(PROFILE)
    mana, minnie = profile.robots
    mana = mana.model_copy(update={"gateways": {"gateway_ros2": "gateway.yaml"}})
    with_gateway = profile.model_copy(update={"robots": (mana, minnie)})

    def specs(*scopes: str) -> list[ProcessSpec]:
        path = tmp_path / "profile.yaml"
        return plan(with_gateway, path, connect="tcp/a:1", http="b:2", data_dir=tmp_path, scopes=scopes)

    with pytest.raises(ConfigurationError, match=r"mana\.gateways\.gateway_ros2: no file .*gateway\.yaml"):
        specs("mana")
    (tmp_path / "gateway.yaml").touch()
    (gateway,) = [s for s in specs("mana") if s.name == "mana_gateway_ros2"]
    assert gateway.argv[-4:] == ("--robot", "mana", "--settings", str(tmp_path / "gateway.yaml"))
    assert gateway.tokens == (("mana", "gateway_ros2"),)
    assert "mana_gateway_ros2" not in [s.name for s in specs("ground", "minnie")]
