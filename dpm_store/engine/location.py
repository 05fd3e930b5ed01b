# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The URL of a store: its engine, its database, its local directory and its payloads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, unquote, urlencode

from cdff_common.errors import ConfigurationError
from dpm_store.engine.database import DIALECTS
from dpm_store.engine.dialect import Dialect

#: Forms of the URL, for messages.
FORMS = (
    "sqlite:///directory or postgresql+psycopg://user@host/database?directory=/path[&payloads=s3://bucket]"
)
_SERVER = "postgresql+psycopg"


@dataclass(frozen=True, slots=True)
class StoreLocation:
    """The parts of the URL of a store.

    Attributes
    ----------
    dialect : Dialect
    directory : Path
        Directory of this process: payloads unless they are objects, tiles and samples that wait.
    database : str
        URL of the database on a server; empty for a file in the directory.
    payloads : str
        URL of the object store of the payloads; empty for files in the directory.
    cache_bytes : int
        Quota of the local copies of objects.
    """

    dialect: Dialect
    directory: Path
    database: str = ""
    payloads: str = ""
    cache_bytes: int = 1 << 30


def parse_url(url: str) -> StoreLocation:
    """Return the parts of a URL: ``sqlite:///dir`` (a fourth slash makes it absolute), or a server.

    ``directory``, ``payloads`` and ``cache_mb`` are options of the store; others are passed to the driver.

    Raises
    ------
    ConfigurationError
        If the URL names another engine or no directory, or the driver is not installed.
    """
    scheme, _, rest = url.partition("://")
    if scheme == "sqlite" and len(rest) > 1 and rest[0] == "/":
        return StoreLocation(DIALECTS[scheme], Path(unquote(rest[1:])))
    if scheme != _SERVER:
        raise ConfigurationError(f"store {url!r}: expected {FORMS}")
    address, _, query = rest.partition("?")
    options = dict(parse_qsl(query))
    directory, payloads = options.pop("directory", ""), options.pop("payloads", "")
    cache_mb = options.pop("cache_mb", "1024")
    if not cache_mb.isdecimal():
        raise ConfigurationError(f"store {scheme}://{_public(address)}: cache_mb={cache_mb!r}, expected MiB")
    if not directory:
        raise ConfigurationError(f"store {scheme}://{_public(address)}: no directory; expected {FORMS}")
    database = f"{scheme}://{address}" + (f"?{urlencode(options)}" if options else "")
    return StoreLocation(DIALECTS["postgresql"], Path(directory), database, payloads, int(cache_mb) << 20)


def _public(address: str) -> str:
    """Return the address of a database without its password."""
    account, separator, host = address.rpartition("@")
    return f"{account.partition(':')[0]}{separator}{host}"
