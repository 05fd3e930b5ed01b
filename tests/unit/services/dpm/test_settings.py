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


def test_a_worker_has_a_directory_of_its_own_and_shares_the_port() -> None:
    store = "postgresql+psycopg://a@h/b?payloads=s3://c"
    worker = parse_settings(["--data-dir", "/data", "--worker", "2"], {"CDFF_STORE": store})
    assert (worker.service, worker.shares_port) == ("dpm_2", True)
    assert worker.store_url == f"{store}&directory=/data/dpm_2"
    named = parse_settings(["--worker", "1"], {"CDFF_STORE": f"{store}&directory=/other"})
    assert named.store_url == f"{store}&directory=/other/dpm_1"
    dpm = parse_settings(["--data-dir", "/data", "--share-port"], {"CDFF_STORE": store})
    assert (dpm.service, dpm.shares_port, dpm.worker) == ("dpm", True, 0)
    assert not parse_settings(["--data-dir", "/data"], {"CDFF_STORE": store}).shares_port


@pytest.mark.parametrize(
    ("options", "store", "reason"),
    [
        (["--worker", "1"], "", "--worker: expected --store URL of a database on a server"),
        (["--share-port"], "", "--share-port: expected --store URL of a database on a server"),
        (["--worker", "-1"], "postgresql+psycopg://h/b?payloads=s3://c", "--worker -1: expected a number"),
        (["--worker", "1"], "postgresql+psycopg://h/b", "with payloads=s3://… that all processes read"),
        (["--worker", "1", "--new"], "postgresql+psycopg://h/b?payloads=s3://c", "options of the DPM itself"),
    ],
)
def test_workers_need_a_store_that_they_can_share(options: list[str], store: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        parse_settings(options, {"CDFF_STORE": store})
