# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from services.dpm.settings import parse_settings


def test_an_argument_replaces_the_environment_variable(tmp_path: Path) -> None:
    environment = {"CDFF_DATA_DIR": "/somewhere", "CDFF_HTTP": "127.0.0.1:9"}
    settings = parse_settings(["--data-dir", str(tmp_path)], environment)
    assert (settings.data_dir, settings.host, settings.port) == (tmp_path, "127.0.0.1", 9)


@pytest.mark.parametrize("address", ["0.0.0.0:8080", "192.0.2.1:80", "[::]:80", "some.host:80"])
def test_other_addresses_than_loopback_require_a_key_file(address: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="key"):
        parse_settings(["--http", address], {})
    assert parse_settings(["--http", address, "--keys", str(tmp_path / "keys")], {}).keys_file is not None
    parse_settings(["--http", address], {"CDFF_HTTP_PUBLISHED_ON_LOOPBACK": "1"})


@pytest.mark.parametrize("address", ["8080", "localhost", ":8080", "localhost:x", "localhost:70000"])
def test_an_address_without_host_or_valid_port_is_refused(address: str) -> None:
    with pytest.raises(ConfigurationError, match="host:port"):
        parse_settings(["--http", address], {})


@pytest.mark.parametrize(
    ("store", "url"),
    [
        ("", "sqlite:////data"),
        ("postgresql+psycopg://a@h/b", "postgresql+psycopg://a@h/b?directory=/data"),
        (
            "postgresql+psycopg://a@h/b?payloads=s3://c",
            "postgresql+psycopg://a@h/b?payloads=s3://c&directory=/data",
        ),
        ("postgresql+psycopg://a@h/b?directory=/other", "postgresql+psycopg://a@h/b?directory=/other"),
    ],
)
def test_a_database_on_a_server_uses_the_data_directory_for_local_files(store: str, url: str) -> None:
    settings = parse_settings(["--data-dir", "/data"], {"CDFF_STORE": store})
    assert settings.store_url == url
