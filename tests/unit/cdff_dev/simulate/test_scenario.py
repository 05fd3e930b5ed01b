# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenario files are read by name, and wrong files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_dev.simulate.scenario import SCENARIO_FOLDER, Scenario, load_scenario
from cdff_dev.simulate.scenario_files import load_any_scenario, scenario_names


def test_every_shipped_scenario_is_valid_and_marked_frozen() -> None:
    files = sorted(SCENARIO_FOLDER.glob("*.yaml"))
    assert files
    assert all("Frozen" in path.read_text(encoding="utf-8") for path in files)
    for name in scenario_names():
        assert load_any_scenario(name).name == name


def test_a_given_seed_replaces_that_of_the_file_and_changes_the_digest() -> None:
    assert load_scenario("rover_traverse", 5).seed == 5
    assert load_scenario("rover_traverse", 5).digest != load_scenario("rover_traverse").digest


def test_an_unknown_key_is_refused_by_name(tmp_path: Path) -> None:
    data = yaml.safe_load((SCENARIO_FOLDER / "rover_traverse.yaml").read_text(encoding="utf-8"))
    data["lidar"]["colour"] = "red"
    (tmp_path / "odd.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"lidar\.colour"):
        load_scenario(str(tmp_path / "odd.yaml"))


def test_a_scenario_that_extends_another_changes_only_its_own_values() -> None:
    base, sand = load_scenario("rover_traverse"), load_scenario("visual_sand")
    assert sand.terrain.surface.albedo_contrast == 0.06
    assert sand.terrain.surface.sun_elevation_deg == base.terrain.surface.sun_elevation_deg
    assert sand.navcam == base.navcam.model_copy(update={"rate_hz": sand.navcam.rate_hz})
    assert sand.robots == load_scenario("visual_rocks").robots


@pytest.mark.parametrize("value", ["odd", ["rover_traverse"]])
def test_a_scenario_cannot_extend_a_list_or_itself(tmp_path: Path, value: object) -> None:
    (tmp_path / "odd.yaml").write_text(yaml.safe_dump({"extends": value}), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="extends"):
        load_scenario(str(tmp_path / "odd.yaml"))


def test_an_unknown_scenario_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigurationError, match="rover_traverse"):
        load_scenario("moon_walk")


def test_the_camera_looks_forward_and_down_with_x_to_the_right(scenario: Scenario) -> None:
    T = scenario.navcam.T_base_left
    assert se3.is_transform(T)
    pitch_rad = np.radians(24.0)
    np.testing.assert_allclose(T[:3, 2], [np.cos(pitch_rad), 0, -np.sin(pitch_rad)], atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], [0, -1, 0], atol=1e-12)
    right = scenario.navcam.T_base_right[:3, 3] - T[:3, 3]
    np.testing.assert_allclose(right, [0, -scenario.navcam.baseline_m, 0], atol=1e-12)
