# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wirings of input ports to their sources."""

from __future__ import annotations

import pytest

from cdff_common.contract.wiring import Source, Wiring, mode_names
from cdff_common.errors import InputError


def test_a_wiring_survives_parsing_and_formatting() -> None:
    text = "sensor/lidar/scan|product/dem/map|dpm/orbiter/dem"
    wiring = Wiring.parse(text)
    assert str(wiring) == text
    assert wiring.default == Source("sensor", "lidar", "scan")
    assert [source.kind for source in wiring.sources] == ["sensor", "product", "dpm"]


@pytest.mark.parametrize(
    "text", ["", "sensor/lidar", "sensor/lidar/scan/x", "wire/a/b", "sensor/Lidar/scan", "a|"]
)
def test_a_malformed_wiring_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected sensor/"):
        Wiring.parse(text)


def test_modes_are_listed_in_order_of_preference() -> None:
    assert mode_names("nominal|fast") == ("nominal", "fast")
