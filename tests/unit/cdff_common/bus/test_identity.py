# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.bus.identity import VARIABLE, Identity
from cdff_common.bus.session import DEFAULT_ENDPOINT, SECURE_ENDPOINT, check_endpoint, endpoint
from cdff_common.errors import ConfigurationError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("ca.crt", "identity.crt", "identity.key"):
        (tmp_path / name).touch(0o600)
    return tmp_path


def test_an_identity_lists_its_files_for_both_ends_of_a_link(folder: Path) -> None:
    settings = Identity.read(folder).settings(listens=True)
    assert settings["transport/link/tls/enable_mtls"] is True
    assert settings["transport/link/tls/connect_private_key"] == str(folder / "identity.key")
    assert settings["transport/link/tls/listen_certificate"] == str(folder / "identity.crt")
    assert "transport/link/tls/listen_certificate" not in Identity.read(folder).settings(listens=False)


def test_a_missing_file_and_a_key_that_others_may_read_are_refused(folder: Path) -> None:
    (folder / "identity.key").chmod(0o640)
    with pytest.raises(ConfigurationError, match="mode 640, expected 600"):
        Identity.read(folder)
    (folder / "identity.key").unlink()
    with pytest.raises(ConfigurationError, match=r"identity\.key: cannot be read"):
        Identity.read(folder)


def test_a_mounted_key_of_root_may_be_readable_by_the_group(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = folder / "identity.key"
    if key.stat().st_uid != 0:
        pytest.skip("only root can make a file of root")
    monkeypatch.setattr("os.geteuid", lambda: 10001)
    key.chmod(0o440)
    assert Identity.read(folder).folder == folder.resolve()
    for mode in (0o460, 0o444):
        key.chmod(mode)
        with pytest.raises(ConfigurationError, match=f"mode {mode:o}, expected 600"):
            Identity.read(folder)


def test_a_router_needs_an_access_control_list(folder: Path) -> None:
    with pytest.raises(ConfigurationError, match="the identity of the ground or of a robot"):
        Identity.read(folder).access_control()


def test_the_environment_selects_the_identity_and_the_default_endpoint(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CDFF_CONNECT", raising=False)
    monkeypatch.delenv(VARIABLE, raising=False)
    assert (Identity.of_environment(), endpoint()) == (None, DEFAULT_ENDPOINT)
    monkeypatch.setenv(VARIABLE, str(folder))
    assert endpoint() == SECURE_ENDPOINT
    assert Identity.of_environment() == Identity(folder.resolve())


@pytest.mark.parametrize(
    ("address", "is_secure", "remedy"),
    [("tcp/a:1", True, "use tls/HOST:PORT"), ("tls/a:1", False, "set CDFF_IDENTITY")],
)
def test_an_identity_without_tls_and_tls_without_an_identity_are_refused(
    address: str, is_secure: bool, remedy: str
) -> None:
    check_endpoint("tls/a:1", is_secure=True)
    with pytest.raises(ConfigurationError, match=remedy):
        check_endpoint(address, is_secure=is_secure)
