# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import pytest
from pydantic import ValidationError

from services.gateway_dds.settings import DdsSettings


def settings(**fields: Any) -> DdsSettings:
    return DdsSettings.model_validate({"robot": "mana", **fields})


def test_discovery_uses_the_stated_interface_and_peers_without_multicast() -> None:
    root = ElementTree.fromstring(settings(interface="eth1", peers=["10.0.0.2", "robot.local"]).configuration)
    interfaces = root.findall("Domain/General/Interfaces/NetworkInterface")
    assert [i.attrib for i in interfaces] == [{"name": "eth1", "multicast": "false"}]
    assert root.findtext("Domain/General/AllowMulticast") == "false"
    peers = [peer.attrib["address"] for peer in root.iter("Peer")]
    assert peers == ["10.0.0.2", "robot.local"]
    assert root.findtext("Domain/Discovery/MaxAutoParticipantIndex") == "31"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"requests": [{"name": "/a", "type": "cdff_msgs/action/Request", "products": ["dem"]}]},
            "request /a: expected a service",
        ),
        ({"parameters": {"position_manager": ["x"]}}, "parameters: expected none"),
        ({"peers": []}, "expected the addresses of the robot's machines, or multicast: true"),
        ({"peers": ['a"/><x y="']}, "String should match pattern"),
        ({"interface": "lo<"}, "String should match pattern"),
        ({"domain": 233}, "less than or equal to 232"),
    ],
)
def test_settings_that_cannot_work_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        settings(**fields)
