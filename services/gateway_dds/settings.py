# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway that connects a robot whose ROS 2 uses DDS."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from services.gateways.request_types import ACTIONS
from services.gateways.settings import GatewaySettings

#: Vendor id of Fast DDS. Cyclone DDS refuses its descriptions of types with arrays, so that topics would not
#: match; without the descriptions it compares the names of the types.
_FAST_DDS = "1.15"
Address = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9.:-]*$", max_length=255)]


class DdsSettings(GatewaySettings):
    """Settings of one gateway.

    Attributes
    ----------
    domain : int
        ``ROS_DOMAIN_ID`` of the robot.
    interface : str
        Network interface of the robot's network, such as ``eth0``; no other is used.
    peers : list of str
        Addresses of the machines of the robot, for discovery without multicast.
    participants : int
        Largest number of participants (processes with ROS 2) on each machine.
    multicast : bool
        Discovery by multicast as well.
    """

    domain: Annotated[int, Field(ge=0, le=232)] = 0
    interface: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.:@-]*$", max_length=64)] = "lo"
    peers: tuple[Address, ...] = ("127.0.0.1",)
    participants: Annotated[int, Field(ge=1, le=120)] = 32
    multicast: bool = False

    @model_validator(mode="after")
    def _is_possible(self) -> DdsSettings:
        actions = [entry.name for entry in self.requests if entry.type in ACTIONS]
        if actions:
            raise ValueError(f"request {actions[0]}: expected a service; actions need the gateway to Zenoh")
        if self.parameters:
            raise ValueError(
                "parameters: expected none, since implementations of DDS do not share the correlation of "
                "requests; use the gateway to ROS 2 over Zenoh, or the HTTP interface"
            )
        if not self.peers and not self.multicast:
            raise ValueError("peers: expected the addresses of the robot's machines, or multicast: true")
        return self

    @property
    def configuration(self) -> str:
        """Configuration of Cyclone DDS."""
        multicast = str(self.multicast).lower()
        peers = "".join(f'<Peer address="{address}"/>' for address in self.peers)
        return (
            f"<CycloneDDS><Domain><Compatibility><IgnoreTypeInformation>{_FAST_DDS}</IgnoreTypeInformation>"
            "</Compatibility>"
            "<General><Interfaces>"
            f'<NetworkInterface name="{self.interface}" multicast="{multicast}"/></Interfaces>'
            f"<AllowMulticast>{multicast}</AllowMulticast></General>"
            "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{self.participants - 1}</MaxAutoParticipantIndex>"
            f"<Peers>{peers}</Peers></Discovery></Domain></CycloneDDS>"
        )
