# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Signatures of products by the key of their producer's identity.

A signature covers the names of the product, the encoding and SHA-256 of the payload, and all header fields
except ``box_m``, which the DPM adds. It contains the certificate of the producer, so that it can be checked
with that of the mission's authority after the identity was renewed; its form is
``base64(certificate DER).base64(signature)``.
Keys on elliptic curves sign with ECDSA and SHA-256, Ed25519 keys as in RFC 8032.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgpack
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.x509.oid import NameOID

from cdff_common.bus.identity import CERTIFICATE, KEY, VARIABLE, Identity
from cdff_common.bus.keys import GROUND
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.product import Header

_NAMES = ("robot", "dfpc", "port", "product")
_ALGORITHM = ec.ECDSA(hashes.SHA256())


class Signer:
    """Signer with the key of an identity folder; raises ConfigurationError."""

    def __init__(self, folder: Path) -> None:
        try:
            key = serialization.load_pem_private_key((folder / KEY).read_bytes(), password=None)
            certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
        except (OSError, ValueError, TypeError) as error:
            raise ConfigurationError(f"identity {folder}: {error}; write it with `cdff keys`") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey | ed25519.Ed25519PrivateKey):
            raise ConfigurationError(
                f"identity {folder}: a {type(key).__name__}, expected one of an elliptic curve or Ed25519"
            )
        self._key = key
        self._certificate = certificate.public_bytes(serialization.Encoding.DER)

    @classmethod
    def of_environment(cls) -> Signer:
        """Return the signer of ``CDFF_IDENTITY``; raises ConfigurationError."""
        identity = Identity.of_environment()
        if identity is None:
            raise ConfigurationError(
                f"the profile has `sign: true`, but {VARIABLE} is not set: name the folder of this identity"
            )
        return cls(identity.folder)

    def sign(self, names: Mapping[str, str], encoding: str, header: Header, payload: bytes) -> Header:
        """Return the header of a product with its digest and signature."""
        header = replace(header, sha256=hashlib.sha256(payload).hexdigest())
        header = Header.from_attachment(header.to_attachment())  # numbers have the types of the receiver
        data = signed_bytes(names, encoding, header)
        if isinstance(self._key, ed25519.Ed25519PrivateKey):
            signature = self._key.sign(data)
        else:
            signature = self._key.sign(data, _ALGORITHM)
        parts = (base64.b64encode(part).decode() for part in (self._certificate, signature))
        return replace(header, signature=".".join(parts))


class SignatureVerifier:
    """Verifier of signatures; raises ConfigurationError without the certificate of the authority."""

    def __init__(self, authority: Path) -> None:
        try:
            self._authority = x509.load_pem_x509_certificate(authority.read_bytes())
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"{authority}: {error}; expected the certificate of the authority"
            ) from error

    def problem(self, names: Mapping[str, str], encoding: str, header: Header) -> str:
        """Return why the signature of a product is not valid; empty if it is.

        The digest in the header is to be compared with the payload separately.
        """
        try:
            der, signature = (base64.b64decode(p, validate=True) for p in (header.signature or "").split("."))
            certificate = x509.load_der_x509_certificate(der)
            certificate.verify_directly_issued_by(self._authority)
        except (ValueError, TypeError, binascii.Error) as error:
            return f"its signature is malformed: {error}"
        except InvalidSignature:
            return "it is signed with a certificate of another authority"
        (common_name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        signer = str(common_name.value).split(".")[0]  # without the number of the certificate
        if signer not in (names["robot"], GROUND):
            return f"it is signed by {signer[:64]}, expected {names['robot']} or {GROUND}"
        key, data = certificate.public_key(), signed_bytes(names, encoding, header)
        try:
            if isinstance(key, ed25519.Ed25519PublicKey):
                key.verify(signature, data)
            elif isinstance(key, ec.EllipticCurvePublicKey):
                key.verify(signature, data, _ALGORITHM)
            else:
                return f"it is signed with a {type(key).__name__}"
        except InvalidSignature:
            return "its signature does not fit payload and header: one of them was changed"
        return ""


def signed_bytes(names: Mapping[str, str], encoding: str, header: Header) -> bytes:
    """Return the MessagePack list that a signature covers."""
    fields = sorted((k, v) for k, v in header.to_dict().items() if k not in ("box_m", "signature"))
    return bytes(msgpack.packb(["cdff-product-1", [names[n] for n in _NAMES], encoding, fields]))
