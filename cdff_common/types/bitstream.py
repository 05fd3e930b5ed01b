# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/bitstream.asn by cdff generate; do not edit.

"""Types of ``asn1/bitstream.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Asn1Bitstream(Message):
    """Encoded message and its type.

    Attributes
    ----------
    type : str, at most 256 bytes
        ASN.1 type of data, e.g. Pointcloud; robots also write asn1SccPointcloud.
    serialization_method : int, 0..4294967295
        0 uPER, 1 BER, 2 XER, 3 MessagePack.
    data : NDArray[np.uint8], shape (n,)
        may be padded with zeros.
    """

    ASN1_NAME: ClassVar[str] = "Asn1Bitstream"
    type: str = ""
    serialization_method: int = 0
    data: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
