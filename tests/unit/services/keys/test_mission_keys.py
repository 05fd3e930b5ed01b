# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
import ssl
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509

from cdff_common.bus.identity import Identity
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.profile import Profile
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys
from tests.support.identities import PROFILE


@pytest.fixture
def keys(tmp_path: Path) -> MissionKeys:
    return MissionKeys.create(tmp_path / "secrets", PROFILE, ("ops.example",))


def subjects(keys: MissionKeys, folder: str = "ground") -> dict[str, list[str]]:
    content: dict[str, Any] = json.loads((keys.folder / folder / "access.json").read_text())
    return {s["id"]: s["cert_common_names"] for s in content["subjects"]}


def test_only_the_owner_may_read_private_keys(keys: MissionKeys) -> None:
    keys.issue("mana", Kind.ROBOT)
    for path in keys.folder.rglob("*.key"):
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.parent.stat().st_mode & 0o777 == 0o700


def test_certificates_load_as_a_pair_and_identities_are_complete(keys: MissionKeys) -> None:
    keys.issue("mana", Kind.ROBOT)
    context = ssl.create_default_context(cafile=str(keys.folder / "mana" / "ca.crt"))
    context.load_cert_chain(keys.folder / "mana" / "identity.crt", keys.folder / "mana" / "identity.key")
    assert Identity.read(keys.folder / "mana").access_control()["default_permission"] == "deny"


def test_a_new_certificate_is_valid_on_machines_whose_clock_is_hours_behind(keys: MissionKeys) -> None:
    keys.issue("mana", Kind.ROBOT)
    twelve_hours_ago = datetime.now(UTC) - timedelta(hours=12)
    for name in ("identity.crt", "ca.crt"):
        certificate = x509.load_pem_x509_certificate((keys.folder / "mana" / name).read_bytes())
        assert certificate.not_valid_before_utc < twelve_hours_ago


def test_a_rotation_admits_both_certificates_until_the_earlier_one_is_revoked(keys: MissionKeys) -> None:
    keys.issue("alice", Kind.OPERATOR)
    keys.issue("alice", Kind.OPERATOR)
    assert subjects(keys)["alice"] == ["alice.1", "alice.2"]
    assert [c.common_name for c in keys.revoke("alice", previous=True)] == ["alice.1"]
    assert subjects(MissionKeys.read(keys.folder))["alice"] == ["alice.2"]


def test_a_revoked_certificate_stays_revoked_when_its_name_is_issued_again(keys: MissionKeys) -> None:
    keys.issue("alice", Kind.OPERATOR)
    keys.revoke("alice")
    assert "alice" not in subjects(keys)
    keys.issue("alice", Kind.OPERATOR)
    assert subjects(keys)["alice"] == ["alice.2"]
    with pytest.raises(InputError, match="'bob' has no valid certificate; there are ones of alice, ground"):
        keys.revoke("bob")


def test_an_expired_certificate_is_not_admitted(keys: MissionKeys) -> None:
    keys.issue("alice", Kind.OPERATOR)
    keys.certificates[-1] = replace(keys.certificates[-1], expires="2020-01-01T00:00:00+00:00")
    assert [member.name for member in keys.members()] == ["ground"]
    assert keys.to_list()[-1]["state"] == "expired"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("rex", Kind.ROBOT),
        ("mana", Kind.OPERATOR),
        ("ground", Kind.CLIENT),
        ("../a", Kind.CLIENT),
        ("ca", Kind.CLIENT),
    ],
)
def test_names_that_do_not_fit_their_kind_are_refused(keys: MissionKeys, name: str, kind: Kind) -> None:
    with pytest.raises(InputError, match=r"expected|cannot be a"):
        keys.issue(name, kind)


def test_a_name_keeps_its_kind(keys: MissionKeys) -> None:
    keys.issue("alice", Kind.OPERATOR)
    with pytest.raises(InputError, match="alice is a operator"):
        keys.issue("alice", Kind.PLAYER)


def test_init_adopts_a_changed_profile_and_keeps_the_authority(keys: MissionKeys) -> None:
    authority = (keys.folder / "ca" / "ca.crt").read_bytes()
    wider = Profile.model_validate({"name": "wider", "robots": [{"id": "rex"}], "clock": "rex"})
    again = MissionKeys.create(keys.folder, wider, ())
    assert (keys.folder / "ca" / "ca.crt").read_bytes() == authority
    assert [c.common_name for c in again.certificates] == ["ground.1"]
    again.issue("rex", Kind.ROBOT)
    rules = json.loads((keys.folder / "ground" / "access.json").read_text())["rules"]
    (clock,) = (rule for rule in rules if rule["key_exprs"] == ["cdff/@v1/ground/clock"])
    assert clock["id"].startswith("rex-")
    assert clock["messages"] == ["put"]


def test_unchanged_files_are_not_replaced(keys: MissionKeys) -> None:
    path = keys.folder / "ground" / "access.json"
    before = path.stat().st_ino
    keys.write()
    assert path.stat().st_ino == before


def test_a_folder_without_a_register_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="expected the register of `cdff keys init`"):
        MissionKeys.read(tmp_path)
