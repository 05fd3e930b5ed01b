# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Validation of the map merging section of a profile."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import load_profile


def profile(folder: Path, merging: str) -> Path:
    path = folder / "profile.yaml"
    path.write_text(f"name: p\nrobots: [{{id: mana}}]\n{merging}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("merging", "parameter"),
    [("{search_radius: 5}", "search_radius"), ("{trials: 0}", "trials"), ("12", "merging")],
)
def test_unknown_merging_parameters_are_refused_and_named(
    tmp_path: Path, merging: str, parameter: str
) -> None:
    with pytest.raises(ConfigurationError, match=parameter):
        load_profile(profile(tmp_path, f"merging: {merging}\n"))


def test_merging_without_parameters_has_defaults_and_is_absent_without_an_entry(tmp_path: Path) -> None:
    merging = load_profile(profile(tmp_path, "merging: {trials: 3}\n")).merging
    assert merging is not None
    assert (merging.trials, merging.candidates) == (3, 2)
    assert load_profile(profile(tmp_path, "")).merging is None
