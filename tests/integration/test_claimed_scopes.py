# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A second ground or profile of a robot ends at the terminal with a message, before any process starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.cli import EXIT_ERROR, main
from cdff_common.interfaces.profile import load_profile
from cdff_dev.ports import free_port
from services.supervisor import vacancy
from services.supervisor.profile_link import serve_profile, served_profiles
from tests.support.small_profile import SMALL_PROFILE, with_mistake, written


@pytest.mark.parametrize(
    ("scope", "service", "options", "message"),
    [
        (
            "pico",
            "lidar_slam",
            ["--scopes", "pico"],
            "robot pico runs there already (lidar_slam); end it, or give",
        ),
        (
            keys.GROUND,
            "dpm",
            [],
            "a ground runs there already (dpm); start a robot only, with --scopes ROBOT",
        ),
    ],
)
def test_a_scope_that_runs_at_the_uplink_is_refused_at_the_terminal(
    scope: str,
    service: str,
    options: list[str],
    message: str,
    endpoint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(vacancy, "_ENDED_S", 0.5)
    for name in ("CDFF_CONNECT", "CDFF_LISTEN", "CDFF_PROFILE", "CDFF_DATA_DIR"):
        monkeypatch.setenv(name, "")  # the command sets them for its children
    profile = tmp_path / "pico.yaml"
    profile.write_text(SMALL_PROFILE)
    with Bus.open_router(endpoint) as router:
        router.declare_token(keys.alive(scope, service))
        command = ["up", "--profile", str(profile), "--uplink", endpoint, *options]
        command += ["--connect", f"tcp/127.0.0.1:{free_port()}", "--http", f"127.0.0.1:{free_port()}"]
        assert main([*command, "--data-dir", str(tmp_path / "data")]) == EXIT_ERROR
    assert message in capsys.readouterr().err


def test_a_robot_on_another_body_than_the_ground_is_refused_at_the_terminal(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("CDFF_CONNECT", "CDFF_LISTEN", "CDFF_PROFILE", "CDFF_DATA_DIR"):
        monkeypatch.setenv(name, "")  # the command sets them for its children
    profile, robot = tmp_path / "pico.yaml", load_profile(written(tmp_path))
    profile.write_text(with_mistake("body: {name: moon}", "body: {name: mars}"))
    with Bus.open_router(endpoint) as router, Bus.open(endpoint, name="ground") as ground:
        router.declare_alive(keys.GROUND, "router")
        serve_profile(ground, keys.GROUND, served_profiles(robot, ())[keys.GROUND])
        command = ["up", "--profile", str(profile), "--uplink", endpoint, "--scopes", "pico"]
        command += ["--connect", f"tcp/127.0.0.1:{free_port()}", "--data-dir", str(tmp_path / "data")]
        assert main(command) == EXIT_ERROR
    assert "robot pico: body.name is 'mars', but 'moon' in the profile small of the ground" in (
        capsys.readouterr().err
    )


def test_free_scopes_and_an_uplink_that_is_not_reachable_are_no_conflict(endpoint: str) -> None:
    tokens = {keys.alive("pico", "lidar_slam")}
    vacancy.check_joins(endpoint, tokens, {})
    with Bus.open_router(endpoint) as router:
        router.declare_token(keys.alive("mana", "lidar_slam"))
        vacancy.check_joins(endpoint, tokens, {})
