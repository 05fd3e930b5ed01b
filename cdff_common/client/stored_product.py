# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A product that a search of the DPM returns: its metadata, without the value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Self

from cdff_common.clock import to_datetime
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.product import Header


@dataclass(frozen=True, slots=True, eq=False)
class StoredProduct(Mapping[str, Any]):
    """Metadata of a stored product; also a read-only mapping of the fields as the DPM sends them.

    Attributes
    ----------
    id : str
    robot, dfpc, port : str
        Origin.
    product : str
        ``pose``, ``dem``, ….
    type_name : str
        ASN.1 type of the payload.
    codec : str
    size : int
        Size of the payload, bytes.
    inserted_ns : int
        Mission time of the insertion.
    header : Header
        Capture interval, frame, producer, inputs and quality.
    metadata : mapping
        All fields.
    """

    id: str
    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    codec: str
    size: int
    inserted_ns: int
    header: Header
    metadata: Mapping[str, Any]

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> Self:
        """Return the product of an item of a search; raises CodecError on a missing or wrong field."""
        try:
            return cls(
                id=str(item["id"]),
                robot=str(item["robot"]),
                dfpc=str(item["dfpc"]),
                port=str(item["port"]),
                product=str(item["product"]),
                type_name=str(item["type_name"]),
                codec=str(item["codec"]),
                size=int(item["size"]),
                inserted_ns=int(item["inserted_ns"]),
                header=Header.from_dict(item),
                metadata=item,
            )
        except (KeyError, TypeError, ValueError, InputError) as error:
            raise CodecError(
                f"an item of the search is no product: {type(error).__name__} {error}"
            ) from error

    @property
    def captured(self) -> datetime:
        """End of capture, UTC."""
        return to_datetime(self.header.t1_ns)

    @property
    def inserted(self) -> datetime:
        """Time of the insertion, UTC."""
        return to_datetime(self.inserted_ns)

    def __getitem__(self, name: str) -> Any:
        return self.metadata[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.metadata)

    def __len__(self) -> int:
        return len(self.metadata)

    def __repr__(self) -> str:
        return (
            f"StoredProduct({self.product} of {self.robot}, {self.captured:%Y-%m-%dT%H:%M:%S.%fZ}, "
            f"{self.size} bytes, {self.header.quality.status}, id={self.id!r})"
        )
