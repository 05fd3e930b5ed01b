# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the DPM process: arguments first, then the environment, then defaults."""

from __future__ import annotations

import argparse
import ipaddress
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, urlencode

from cdff_common.bus.identity import VARIABLE, Identity
from cdff_common.errors import ConfigurationError
from cdff_common.process import data_dir_of

DEFAULT_HTTP = "127.0.0.1:8080"
#: Endpoint of the link between robots and the ground.
DEFAULT_LINK = "udp/127.0.0.1:7449"
#: Largest body of a request.
DEFAULT_MAX_BODY_MB = 256


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of one DPM process.

    Attributes
    ----------
    data_dir : Path
        Directory of the store.
    host, port : str, int
        HTTP address.
    connect : str or None
        Endpoint of the router; None for the default of the bus.
    profile : Path or None
        Mission profile: robots and their fixed frames.
    hosts : tuple of str
        Further ``Host`` names of the HTTP server, in addition to the address and localhost.
    keys_file : Path or None
        API keys as lines of ``sha256hex role name``; needed off loopback.
    max_body_bytes : int
        Largest body of one insertion, bytes.
    new : bool
        Create a database although the directory has payloads of an earlier one.
    identity : Identity or None
        Identity with which HTTP is served over TLS.
    cors_origins : tuple of str
        Origins whose pages may read over HTTP; ``*`` for all.
    root_path : str
        Path below which a proxy serves HTTP, in links.
    behind_proxy : bool
        Whether ``X-Forwarded-Prefix`` and ``X-Forwarded-Host`` are read.
    store : str
        URL of a database on a server; empty for the one in the data directory.
    contact_plan : Path or None
        Contact plan of the exchange between robots and the ground; None for no exchange.
    contact_link, contact_robot : str, str or None
        Zenoh endpoint of the link; the robot on which this process runs, None on the ground.
    shares_port : bool
        Whether other processes of this store answer on the same HTTP address.
    worker : int
        Number of a worker, which answers calls but does not maintain the store; 0 for the DPM itself.
    """

    data_dir: Path
    host: str = "127.0.0.1"
    port: int = 8080
    connect: str | None = None
    profile: Path | None = None
    hosts: tuple[str, ...] = ()
    keys_file: Path | None = None
    max_body_bytes: int = DEFAULT_MAX_BODY_MB << 20
    new: bool = False
    identity: Identity | None = None
    cors_origins: tuple[str, ...] = ()
    root_path: str = ""
    behind_proxy: bool = False
    store: str = ""
    contact_plan: Path | None = None
    contact_link: str = DEFAULT_LINK
    contact_robot: str | None = None
    shares_port: bool = False
    worker: int = 0

    @property
    def service(self) -> str:
        """Name of the process: ``dpm``, or ``dpm_1`` and so on for workers."""
        return f"dpm_{self.worker}" if self.worker else "dpm"

    @property
    def store_url(self) -> str:
        """URL for ``dpm_store.open_store``; with a server the data directory has local files only."""
        if not self.store:
            return f"sqlite:///{self.data_dir}"
        address, _, query = self.store.partition("?")
        options = dict(parse_qsl(query))
        directory = Path(options.get("directory", self.data_dir))
        options["directory"] = str(directory / self.service if self.worker else directory)
        return f"{address}?{urlencode(options, safe='/:')}"


def _is_loopback(host: str) -> bool:
    """Return True for a loopback address or ``localhost``."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def parse_settings(arguments: Sequence[str] | None, environment: Mapping[str, str] = os.environ) -> Settings:
    """Read settings from the command line and the environment.

    Raises
    ------
    ConfigurationError
        If ``--http`` is no ``host:port``, or is off loopback without ``--keys`` and an identity.
    """
    parser = argparse.ArgumentParser(
        prog="dpm", description="Data Product Manager: store, Zenoh queries, HTTP."
    )
    parser.add_argument("--data-dir", help="CDFF_DATA_DIR, ~/.local/share/cdff")
    parser.add_argument(
        "--store",
        default=environment.get("CDFF_STORE", ""),
        help="CDFF_STORE, database on a server: postgresql+psycopg://user@host/db?payloads=s3://bucket",
    )
    parser.add_argument("--http", default=environment.get("CDFF_HTTP", DEFAULT_HTTP), help="host:port")
    parser.add_argument(
        "--connect", default=None, help="router, as tcp/127.0.0.1:7447 (default: CDFF_CONNECT)"
    )
    parser.add_argument("--profile", type=Path, default=environment.get("CDFF_PROFILE") or None)
    parser.add_argument(
        "--host-name",
        action="append",
        default=[n for n in environment.get("CDFF_HTTP_HOSTS", "").split(",") if n],
        help="further Host name that is answered (repeatable)",
    )
    parser.add_argument(
        "--keys",
        type=Path,
        default=environment.get("CDFF_HTTP_KEYS") or None,
        help="file of API keys, lines of 'sha256hex role name'; needed off loopback",
    )
    parser.add_argument(
        "--cors-origin",
        action="append",
        default=[n for n in environment.get("CDFF_HTTP_CORS", "").split(",") if n],
        help="origin whose pages may read, as https://maps.example; * for all (repeatable)",
    )
    parser.add_argument(
        "--root-path",
        default=environment.get("CDFF_HTTP_ROOT_PATH", ""),
        help="path below which a proxy serves the DPM, as /dpm",
    )
    parser.add_argument(
        "--behind-proxy",
        action="store_true",
        default=environment.get("CDFF_HTTP_BEHIND_PROXY") == "1",
        help="read X-Forwarded-Prefix and X-Forwarded-Host, which only a proxy may send",
    )
    parser.add_argument(
        "--contact-plan",
        type=Path,
        help="contact plan: exchange products with robots, or with the ground (--contact-robot)",
    )
    parser.add_argument(
        "--contact-link",
        default=DEFAULT_LINK,
        help=f"Zenoh endpoint on which the ground listens, to which robots connect (default: {DEFAULT_LINK})",
    )
    parser.add_argument("--contact-robot", metavar="ID", help="the robot on which this process runs")
    parser.add_argument(
        "--new",
        action="store_true",
        help="create an empty database although the directory has payloads of a missing one",
    )
    parser.add_argument(
        "--share-port",
        action="store_true",
        help="let the workers of this store answer on the same HTTP address",
    )
    parser.add_argument(
        "--worker",
        type=int,
        default=0,
        metavar="N",
        help="run worker N (1, 2, …): it answers calls with the DPM of the same --store on a server",
    )
    parser.add_argument("--max-body-mb", type=int, default=DEFAULT_MAX_BODY_MB)
    args = parser.parse_args(arguments)
    host, separator, port = args.http.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not separator or not host or not port.isdigit() or int(port) > 65535:
        raise ConfigurationError(f"--http {args.http!r}: expected host:port, as in {DEFAULT_HTTP}")
    if args.root_path and not re.fullmatch(r"(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*){1,16}", args.root_path):
        raise ConfigurationError(f"--root-path {args.root_path!r}: expected a path as /dpm")
    published = environment.get("CDFF_HTTP_PUBLISHED_ON_LOOPBACK") == "1"
    folder = environment.get(VARIABLE)
    identity = Identity.read(Path(folder)) if folder else None
    if not _is_loopback(host) and args.keys is None and identity is None and not published:
        raise ConfigurationError(
            f"--http {args.http}: off loopback every call needs a key; name a file of keys with --keys, or "
            f"set {VARIABLE} to a folder of `cdff keys` "
            "(in a container whose port is published on loopback only, set CDFF_HTTP_PUBLISHED_ON_LOOPBACK=1)"
        )
    if args.worker < 0:
        raise ConfigurationError(f"--worker {args.worker}: expected a number from 1 on")
    if (args.worker or args.share_port) and not args.store:
        raise ConfigurationError(
            f"{'--worker' if args.worker else '--share-port'}: expected --store URL of a database on a "
            "server; only one process opens the embedded store"
        )
    if args.worker and "payloads=" not in args.store:
        raise ConfigurationError(
            "--worker: expected --store URL with payloads=s3://… that all processes read"
        )
    if args.worker and (args.contact_plan or args.new):
        raise ConfigurationError("--worker: --contact-plan and --new are options of the DPM itself")
    return Settings(
        data_dir_of(args.data_dir, environment),
        host,
        int(port),
        args.connect,
        None if args.profile is None else Path(args.profile),
        tuple(args.host_name),
        args.keys,
        args.max_body_mb << 20,
        args.new,
        identity,
        tuple(args.cors_origin),
        args.root_path,
        args.behind_proxy,
        args.store,
        args.contact_plan,
        args.contact_link,
        args.contact_robot,
        args.share_port or bool(args.worker),
        args.worker,
    )
