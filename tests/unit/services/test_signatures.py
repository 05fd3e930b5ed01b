# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Signatures of products: keys of both kinds, changed products, other producers and authorities."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cryptography")

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.x509.oid import NameOID

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.product import Header, Quality
from dpm_store import open_store
from services.dpm.cli.commands import run_verify
from services.dpm.operations.dpm import Dpm
from services.signatures import SignatureVerifier, Signer
from services.signing import sign_of_environment
from tests.support.dpm_products import cloud, put_arguments

Identity = Callable[..., Path]


class Mission:
    """An authority that issues identity folders like ``cdff keys``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "CDFF test")])
        self.authority = folder / "ca.crt"
        self.authority.write_bytes(self._certificate(self._name, self._key.public_key()))

    def identity(self, common_name: str, key: Any = None) -> Path:
        """Return the folder of a new identity."""
        key = key or ec.generate_private_key(ec.SECP256R1())
        folder = self.folder / common_name
        folder.mkdir()
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
        (folder / "identity.crt").write_bytes(self._certificate(subject, key.public_key()))
        pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
        (folder / "identity.key").write_bytes(key.private_bytes(pem, pkcs8, serialization.NoEncryption()))
        return folder

    def _certificate(self, subject: x509.Name, public_key: Any) -> bytes:
        now = datetime.now(UTC)
        builder = x509.CertificateBuilder(self._name, subject, public_key, x509.random_serial_number())
        builder = builder.not_valid_before(now).not_valid_after(now + timedelta(days=1))
        return builder.sign(self._key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


@pytest.fixture
def mission(tmp_path: Path) -> Mission:
    return Mission(tmp_path / "keys")


NAMES, PAYLOAD, ENCODING, ATTACHMENT = put_arguments(cloud(), "pointcloud", resolution_m=1)
HEADER = Header.from_attachment(ATTACHMENT)


@pytest.mark.parametrize("key", [None, ed25519.Ed25519PrivateKey.generate()], ids=["P-256", "Ed25519"])
def test_a_signed_product_is_valid_after_its_transport(mission: Mission, key: Any) -> None:
    signed = Signer(mission.identity("mana.1", key)).sign(
        NAMES, ENCODING, replace(HEADER, resolution_m=1), PAYLOAD
    )
    received = Header.from_attachment(signed.to_attachment(), strict=True)
    assert received.signature
    with_box = replace(received, box_m=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    verifier = SignatureVerifier(mission.authority)
    assert verifier.problem(NAMES, ENCODING, received) == ""
    assert verifier.problem(NAMES, ENCODING, with_box) == "", "the DPM may add the box"


@pytest.mark.parametrize(
    "change",
    [
        {"seq": 7},
        {"frame": "mana/slam"},
        {"quality": Quality.from_reasons(["few_inliers"])},
        {"sha256": "0" * 64},
        {"config_hash": "d"},
        {"inputs": ("x",)},
    ],
)
def test_a_changed_header_is_noticed(mission: Mission, change: dict[str, Any]) -> None:
    signed = Signer(mission.identity("mana.1")).sign(NAMES, ENCODING, HEADER, PAYLOAD)
    problem = SignatureVerifier(mission.authority).problem(NAMES, ENCODING, replace(signed, **change))
    assert "was changed" in problem


def test_names_and_encoding_are_signed(mission: Mission) -> None:
    signed = Signer(mission.identity("mana.1")).sign(NAMES, ENCODING, HEADER, PAYLOAD)
    verifier = SignatureVerifier(mission.authority)
    assert "was changed" in verifier.problem({**NAMES, "product": "scan"}, ENCODING, signed)
    assert "was changed" in verifier.problem(NAMES, "application/other", signed)


def test_robots_sign_their_own_products_and_the_ground_signs_all(mission: Mission) -> None:
    verifier = SignatureVerifier(mission.authority)
    minnie = Signer(mission.identity("minnie.1")).sign(NAMES, ENCODING, HEADER, PAYLOAD)
    assert "signed by minnie, expected mana or ground" in verifier.problem(NAMES, ENCODING, minnie)
    ground = Signer(mission.identity("ground.2")).sign(NAMES, ENCODING, HEADER, PAYLOAD)
    assert verifier.problem(NAMES, ENCODING, ground) == ""


def test_signatures_of_another_authority_and_malformed_ones_are_invalid(
    mission: Mission, tmp_path: Path
) -> None:
    other = Mission(tmp_path / "other")
    signed = Signer(other.identity("mana.1")).sign(NAMES, ENCODING, HEADER, PAYLOAD)
    verifier = SignatureVerifier(mission.authority)
    assert "another authority" in verifier.problem(NAMES, ENCODING, signed)
    for text in ("", "x", "a.b", "AAAA.AAAA"):
        assert "malformed" in verifier.problem(NAMES, ENCODING, replace(HEADER, signature=text))


def test_without_the_library_a_profile_that_signs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    monkeypatch.delitem(sys.modules, "services.signatures")
    with pytest.raises(ConfigurationError, match="pip install cryptography"):
        sign_of_environment()


def test_missing_identities_are_reported(
    mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CDFF_IDENTITY", raising=False)
    with pytest.raises(ConfigurationError, match="CDFF_IDENTITY is not set"):
        Signer.of_environment()
    monkeypatch.setenv("CDFF_IDENTITY", str(tmp_path / "nobody"))
    with pytest.raises(ConfigurationError, match="cdff keys"):
        Signer.of_environment()
    with pytest.raises(ConfigurationError, match="authority"):
        SignatureVerifier(tmp_path / "ca.crt")


def test_verify_reports_products_with_forged_signatures(
    mission: Mission, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signer = Signer(mission.identity("mana.1"))
    data = tmp_path / "data"
    with open_store(f"sqlite:///{data}") as store:
        dpm = Dpm(store)
        for seq in range(3):
            names, payload, encoding, attachment = put_arguments(cloud(), "pointcloud", seq)
            header = Header.from_attachment(attachment)
            if seq:
                header = signer.sign(names, encoding, header, payload)
            if seq == 2:
                header = replace(header, config_hash="forged")
            dpm.writer.put(names, payload, encoding, header.to_attachment())
            again = header if seq == 2 else signer.sign(names, encoding, header, payload)
            (insertion, _) = dpm.writer.put(names, payload, encoding, again.to_attachment())
            assert str(insertion) == "already", "another signature of the same product is no conflict"
    arguments = argparse.Namespace(data_dir=data, authority=mission.authority, json=False)
    assert run_verify(arguments) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "one of them was changed" in lines[0]
    assert lines[1] == "2 of 3 products are signed"
