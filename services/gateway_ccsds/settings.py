# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Data model of the settings file of the gateway to a ground segment."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat, model_validator

from cdff_common.contract.products import requestable_products
from cdff_common.interfaces.dfn import StrictModel
from services.gateways.stream_settings import GatewayRobot

Address = Annotated[str, Field(pattern=r"^[A-Za-z0-9.-]+:[0-9]{1,5}$", max_length=260)]
EntityId = Annotated[int, Field(ge=1, le=65535)]
#: Largest APID of a packet that is not an idle packet (CCSDS 133.0-B-2, 4.1.3.3.4.4).
_MAX_APID = 2046


class CfdpSettings(StrictModel):
    """Settings of the transfer of files by CFDP.

    Attributes
    ----------
    entity, remote : int
        CFDP entity ids of the robot and of the ground segment.
    listen, peer : str
        HOST:PORT on which PDUs are received, and to which PDUs are sent; each datagram contains one PDU.
    rate_bit_s : float
        Largest rate of sent PDUs, without the headers of UDP and IP, bit/s.
    segment_bytes : int
        Largest number of bytes of file data in a PDU.
    transaction_bytes : int
        Largest file, bytes; a larger product is split into several files.
    spool_bytes : int
        Total size of the files on disk above which further products wait in the DPM.
    """

    entity: EntityId
    remote: EntityId
    listen: Address
    peer: Address
    rate_bit_s: Annotated[float, Field(ge=1000.0, le=1e9)] = 1e6
    segment_bytes: Annotated[int, Field(ge=100, le=1400)] = 800
    transaction_bytes: Annotated[int, Field(ge=1000, le=1_000_000)] = 1_000_000
    spool_bytes: Annotated[int, Field(ge=1_000_000)] = 256_000_000


class PacketSettings(StrictModel):
    """Settings of telemetry and commands in space packets.

    Attributes
    ----------
    apid : int
        Application process identifier of telemetry and commands.
    listen, peer : str
        HOST:PORT on which commands are received, and to which telemetry is sent; each datagram contains one
        packet.
    housekeeping_s : float
        Period of the housekeeping report, seconds.
    """

    apid: Annotated[int, Field(ge=1, le=_MAX_APID)]
    listen: Address
    peer: Address
    housekeeping_s: PositiveFloat = 10.0


class ProductFile(StrictModel):
    """A product type that is sent as files.

    Attributes
    ----------
    type : str
        Product type, such as ``dem``.
    format : str or None
        File format or codec; None for the stored payload.
    every_s : float
        Shortest interval between the captures of two products of the same producer that are sent, seconds.
    """

    type: str
    format: Annotated[str, Field(pattern="^[a-z0-9]{2,8}$")] | None = None
    every_s: Annotated[float, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _check(self) -> ProductFile:
        product = requestable_products().get(self.type)
        if product is not None and self.format not in (None, *product.formats):
            raise ValueError(f"format {self.format!r} of {self.type}: expected {', '.join(product.formats)}")
        return self


class CcsdsSettings(GatewayRobot):
    """Settings of one gateway.

    Attributes
    ----------
    cfdp : CfdpSettings
    packets : PacketSettings
    products : tuple of ProductFile
        Product types that are sent, in order of priority.
    backlog : bool
        True to send also the products that were stored in the DPM before the first start.
    contact_plan : str or None
        File of the contact windows; None for permanent contact.
    command_key : str or None
        File of the key that authenticates commands; None to refuse all commands.
    """

    cfdp: CfdpSettings
    packets: PacketSettings
    products: Annotated[tuple[ProductFile, ...], Field(min_length=1)]
    backlog: bool = False
    contact_plan: str | None = None
    command_key: str | None = None

    @model_validator(mode="after")
    def _check(self) -> CcsdsSettings:
        types = [product.type for product in self.products]
        if len(set(types)) != len(types):
            raise ValueError(f"products: {', '.join(types)}: expected each type once")
        if self.cfdp.entity == self.cfdp.remote:
            raise ValueError("cfdp: entity and remote are the same")
        return self
