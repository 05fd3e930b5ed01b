# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names under which the registry finds DFNs, DFPCs and implementations."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import DiscoveredPackage, Registry


@pytest.fixture
def registry() -> Registry:
    result = Registry()
    for name in ("X1", "V2Filter", "LaserFilter"):
        description = DfnDescription(name=name)
        result.dfns[description.folder] = DiscoveredPackage("nowhere", Path("dfn.yaml"), description)
    return result


@pytest.mark.parametrize("name", ["X1", "V2Filter", "LaserFilter"])
def test_class_name_and_folder_name_select_the_same_entry(registry: Registry, name: str) -> None:
    by_class = registry.dfn(name)
    assert registry.dfn(by_class.folder) is by_class
    assert registry.resolve(by_class.folder) == ("dfn", by_class.folder)


def test_implementations_of_different_dfns_may_share_a_name() -> None:
    dfn = Registry.default().make_dfn("FeaturesDescription2D", "OrbDescriptor")
    assert type(dfn).__name__ == "Orb"
    assert type(Registry.default().make_dfn("FeaturesMatching2D", "FlannMatcher")).__name__ == "MutualRatio"
    with pytest.raises(ConfigurationError, match=r"expected one of .*Orb, OrbDescriptor"):
        Registry.default().make_dfn("FeaturesDescription2D", "Surf")


def test_a_class_name_selects_the_entry_of_its_own_folder() -> None:
    registry = Registry.default()
    for folder, package in registry.dfns.items():
        assert registry.dfn(package.description.name).folder == folder
    for folder, package in registry.dfpcs.items():
        assert registry.dfpc(package.description.name).folder == folder
        assert registry.resolve(package.description.name) == ("dfpc", folder)
