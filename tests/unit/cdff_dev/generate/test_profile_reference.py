# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reference page of the profile: every field has a meaning and an example, and the example is valid."""

from __future__ import annotations

import shutil
from pathlib import Path

from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.profile_checks.check import check_profile
from cdff_common.resources import deploy_folder
from cdff_dev.generate.python_source import render
from cdff_dev.generate.reference.profile import model_sections, page, rows, unit


def test_every_field_has_a_meaning_and_an_example() -> None:
    tables = {
        section.partition("\n")[0]: [line.split(" | ") for line in section.splitlines() if line[:3] == "| `"]
        for section in page().split("\n## ")[1:]
    }
    for name, section in model_sections(Profile):
        fields = {cells[0].strip("| `"): cells for cells in tables[name]}
        for field, _, _, meaning in rows(section):
            assert meaning, f"{name}.{field} has no meaning"
            assert fields[field][4].strip(), f"{name}.{field} has no example"
            assert (fields[field][2] == "–") == (not unit(field))


def test_the_complete_example_is_a_profile_without_faults(tmp_path: Path) -> None:
    (tmp_path / "valley.yaml").write_text(render("profile_example.yaml"), encoding="utf-8")
    shutil.copy(deploy_folder() / "profiles" / "rover_mast.urdf", tmp_path)
    for mask in ("left_mask.png", "right_mask.png"):
        (tmp_path / mask).write_bytes(b"\x89PNG\r\n\x1a\n")
    checked = check_profile(tmp_path / "valley.yaml")
    assert checked.faults == ()
    assert checked.profile is not None


def test_units_are_those_at_the_end_of_a_name() -> None:
    assert [unit(name) for name in ("max_speed_m_s", "linger_s", "sigma_deg", "seed")] == [
        "m/s",
        "s",
        "°",
        "",
    ]
