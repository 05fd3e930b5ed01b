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
