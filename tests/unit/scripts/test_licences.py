# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Packages that ship have a licence, and none is under the GPL."""

from __future__ import annotations

import pytest

from scripts.licences import is_allowed, licence_of, shipped_packages


def test_every_installed_package_that_ships_has_an_allowed_licence() -> None:
    licences = {package: licence_of(package) for package in shipped_packages()}
    installed = {package: licence for package, licence in licences.items() if licence is not None}
    assert installed.keys() >= {"numpy", "eclipse-zenoh", "fastapi", "open3d-cpu"}
    assert [package for package, licence in installed.items() if not is_allowed(licence)] == []


@pytest.mark.parametrize(
    ("licence", "allowed"),
    [
        ("MIT", True),
        ("LGPL-3.0-only", True),
        ("GPL-3.0-or-later", False),
        ("GNU General Public License v3 (GPLv3)", False),
        ("GNU Lesser General Public License v3 (LGPLv3)", True),
        ("", False),
    ],
)
def test_the_gpl_and_a_missing_licence_are_refused(licence: str, allowed: bool) -> None:
    assert is_allowed(licence) is allowed
