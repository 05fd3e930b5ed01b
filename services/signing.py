# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access to the signatures of products, which need the library cryptography only if they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.product import Header

#: ``Signer.sign``: names, encoding, header and payload of a product to its signed header.
Sign = Callable[[Mapping[str, str], str, Header, bytes], Header]


def sign_of_environment() -> Sign:
    """Return the function that signs with the identity of this process; raises ConfigurationError."""
    try:
        from services.signatures import Signer
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"the profile has `sign: true`: {error}; pip install {error.name}"
        ) from error
    return Signer.of_environment().sign
