# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""By which names a DFN is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import Found, Registry


@pytest.fixture
def registry() -> Registry:
    made = Registry()
    for name in ("X1", "V2Filter", "LaserFilter"):
        description = DfnDescription(name=name)
        made.dfns[description.folder] = Found("nowhere", Path("dfn.yaml"), description)
    return made


@pytest.mark.parametrize("name", ["X1", "V2Filter", "LaserFilter"])
def test_class_name_and_folder_name_find_the_same(registry: Registry, name: str) -> None:
    by_class = registry.dfn(name)
    assert registry.dfn(by_class.folder) is by_class
    assert registry.resolve(by_class.folder) == ("dfn", by_class.folder)


def test_an_implementation_has_its_name_elsewhere_as_another_one() -> None:
    made = Registry.default().make_dfn("FeaturesDescription2D", "OrbDescriptor")
    assert type(made).__name__ == "Orb"
    assert type(Registry.default().make_dfn("FeaturesMatching2D", "FlannMatcher")).__name__ == "MutualRatio"
    with pytest.raises(ConfigurationError, match=r"expected one of .*Orb, OrbDescriptor"):
        Registry.default().make_dfn("FeaturesDescription2D", "Surf")


def test_every_class_name_finds_its_own_though_another_is_also_called_so() -> None:
    registry = Registry.default()
    for folder, found in registry.dfns.items():
        assert registry.dfn(found.description.name).folder == folder
    for folder, found in registry.dfpcs.items():
        assert registry.dfpc(found.description.name).folder == folder
        assert registry.resolve(found.description.name) == ("dfpc", folder)
