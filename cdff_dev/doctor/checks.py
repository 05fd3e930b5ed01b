# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The checks of ``cdff doctor``: each looks at one thing, changes nothing, and says what to do where it is not well."""

from __future__ import annotations

import ctypes
import importlib
import os
import shutil
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, Literal

from cdff_common.clock import wall_ns
from cdff_common.errors import CdffError

#: What the wheels of Open3D link to but do not carry: library -> Debian package.
SYSTEM_LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
}
#: Modules whose import says whether their native parts load, and whether they are needed for the base.
MODULES = {
    "zenoh": True, "numpy": True, "scipy": True, "numba": True, "msgpack": True, "asn1tools": True, "pydantic": True,
    "yaml": True, "cv2": False, "open3d": False, "small_gicp": False, "rasterio": False, "shapely": False,
    "sqlalchemy": False, "fastapi": False, "uvicorn": False, "PIL": False, "pyproj": False,
}  # fmt: skip
MIN_FREE_BYTES = 1 << 30
#: Before the first commit of this project no clock can be right.
EARLIEST_NS = 1_735_689_600 * 1_000_000_000

State = Literal["ok", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found: ``advice`` says what to do, empty where nothing is."""

    check: str
    state: State
    detail: str
    advice: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Settings:
    """Where the system would run: endpoint of the router, HTTP address, data folder."""

    connect: str
    http: str
    data_dir: Path


def examine(settings: Settings) -> Iterator[Finding]:
    """Run every check, in the order in which one needs the other."""
    yield python_version()
    yield from distributions()
    yield from system_libraries()
    yield from modules()
    yield data_folder(settings.data_dir)
    yield store_lock(settings.data_dir)
    yield http_port(settings.http)
    yield router(settings.connect)
    yield clock()


def python_version(found: tuple[int, int] = sys.version_info[:2]) -> Finding:
    """Python 3.11 or 3.12."""
    text = f"Python {found[0]}.{found[1]} at {sys.executable}"
    if (3, 11) <= found <= (3, 12):
        return Finding("python", "ok", text)
    return Finding("python", "error", text, "install Python 3.11 or 3.12 and run make setup with PYTHON naming it")


def distributions() -> Iterator[Finding]:
    """The versions that ``pyproject.toml`` demands of the base, without its extras."""
    from packaging.requirements import Requirement

    try:
        demanded = [Requirement(line) for line in requires("cdff") or ()]
    except PackageNotFoundError:
        yield Finding("cdff", "error", "not installed", "run make setup")
        return
    yield Finding("cdff", "ok", f"cdff {version('cdff')}")
    for requirement in demanded:
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found = version(requirement.name)
        except PackageNotFoundError:
            yield Finding(requirement.name, "error", "not installed", "run make setup")
            continue
        fits = requirement.specifier.contains(found, prereleases=True)
        text = f"{requirement.name} {found}"
        yield (
            Finding(requirement.name, "ok", text)
            if fits
            else Finding(requirement.name, "error", f"{text}, expected {requirement.specifier}", "run make setup")
        )


def system_libraries(load: Callable[[str], object] = ctypes.CDLL) -> Iterator[Finding]:
    """Libraries of the system that Open3D needs."""
    for library, package in SYSTEM_LIBRARIES.items():
        try:
            load(library)
        except OSError as error:
            yield Finding(library, "error", str(error), f"apt-get install {package}")
        else:
            yield Finding(library, "ok", f"{library} loads")


def modules(load: Callable[[str], object] = importlib.import_module) -> Iterator[Finding]:
    """Libraries with native parts: installed is not yet importable."""
    for name, needed in MODULES.items():
        try:
            load(name)
        except ImportError as error:
            state: State = "error" if needed else "warning"
            yield Finding(name, state, f"import {name}: {error}", "run make setup; a role without it works on")
        else:
            yield Finding(name, "ok", f"import {name}")


def data_folder(folder: Path) -> Finding:
    """The data folder can be written, and the disk has room."""
    nearest = next(p for p in (folder, *folder.parents) if p.exists())
    if not os.access(nearest, os.W_OK):
        return Finding("data", "error", f"{folder} cannot be written", "name another with CDFF_DATA_DIR")
    free = shutil.disk_usage(nearest).free
    text = f"{folder}, {free / 1e9:.1f} GB free"
    if free < MIN_FREE_BYTES:
        return Finding("data", "warning", text, "make room: the store keeps every product")
    return Finding("data", "ok", text)


def store_lock(folder: Path) -> Finding:
    """Whether a DPM process holds the store; that is no fault, but a second one would be refused."""
    import fcntl

    for path in sorted(folder.glob("*.lock")) if folder.is_dir() else ():
        with path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return Finding(
                    "store", "warning", f"{path} is held: a DPM runs on it", "stop it before starting another"
                )
            fcntl.flock(file, fcntl.LOCK_UN)
    return Finding("store", "ok", "no DPM holds the store")


def http_port(address: str) -> Finding:
    """Whether the HTTP port is free or answered by a DPM."""
    host, port = split_address(address)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            return Finding("http", "warning", f"{address}: {error.strerror}", "a DPM serves there, or use --http")
    return Finding("http", "ok", f"{address} is free")


def router(connect: str) -> Finding:
    """Whether something listens where the router should be."""
    host, port = split_address(connect.split("/", 1)[-1])
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError as error:
        return Finding("router", "warning", f"{connect}: {error}", "start it: cdff service router, or cdff up")
    return Finding("router", "ok", f"{connect} answers")


def clock(now_ns: int | None = None) -> Finding:
    """The wall clock tells a time that can be."""
    now = wall_ns() if now_ns is None else now_ns
    if now < EARLIEST_NS:
        return Finding("clock", "error", f"the wall clock says {now} ns", "set it: stamps and freshness depend on it")
    return Finding("clock", "ok", "the wall clock tells a possible time")


def split_address(address: str) -> tuple[str, int]:
    """``host:port``; raises CdffError with what was expected."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise CdffError(f"address {address!r}: expected host:port, as in 127.0.0.1:8080")
    return host.strip("[]"), int(port)
