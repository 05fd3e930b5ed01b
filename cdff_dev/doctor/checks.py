# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The checks of ``cdff doctor``: each examines one thing, changes nothing, and advises if it is at fault."""

from __future__ import annotations

import ctypes
import importlib
import os
import shutil
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Literal

from cdff_common.clock import wall_ns
from cdff_dev.ports import split_address

#: What the wheels of Open3D link to but do not carry: library -> Debian package.
SYSTEM_LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
}
#: Modules whose native parts must load, and whether the base needs them.
MODULES = {
    "zenoh": True,
    "numpy": True,
    "scipy": False,
    "numba": False,
    "msgpack": True,
    "asn1tools": True,
    "pydantic": True,
    "yaml": True,
    "cv2": False,
    "open3d": False,
    "small_gicp": False,
    "rasterio": False,
    "shapely": False,
    "sqlalchemy": False,
    "fastapi": False,
    "uvicorn": False,
    "PIL": False,
    "pyproj": False,
}
MIN_FREE_BYTES = 1 << 30
#: Before the first commit of this project no clock can be right.
EARLIEST_NS = 1_735_689_600 * 1_000_000_000

State = Literal["ok", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: ``advice`` is empty if nothing needs to be done."""

    check: str
    state: State
    detail: str
    advice: str = ""


def examine(connect: str, http: str, data_dir: Path) -> Iterator[Finding]:
    """Run every check, in the order in which one needs the other.

    Parameters
    ----------
    connect, http : str
        Endpoint of the router, and address of the HTTP server.
    """
    yield python_version()
    yield from distributions()
    yield from system_libraries()
    yield from modules()
    yield data_folder(data_dir)
    yield store_lock(data_dir)
    yield http_port(http)
    yield router(connect)
    yield clock()


def python_version(found: tuple[int, int] = sys.version_info[:2]) -> Finding:
    """Return whether this is Python 3.11 to 3.13."""
    text = f"Python {found[0]}.{found[1]} at {sys.executable}"
    if (3, 11) <= found <= (3, 13):
        return Finding("python", "ok", text)
    return Finding(
        "python", "error", text, "install Python 3.11 to 3.13 and run make setup with PYTHON naming it"
    )


def distributions() -> Iterator[Finding]:
    """Return the versions that ``pyproject.toml`` requires, without extras."""
    from packaging.requirements import Requirement

    found = _version("cdff")
    yield _installed("cdff", found, is_right=found is not None)
    for requirement in map(Requirement, (found and requires("cdff")) or ()):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            found = _version(requirement.name)
            is_right = found is not None and requirement.specifier.contains(found, prereleases=True)
            yield _installed(requirement.name, found, is_right, f", expected {requirement.specifier}")


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _installed(name: str, found: str | None, is_right: bool, expected: str = "") -> Finding:
    text = f"{name} {found or 'is not installed'}"
    return (
        Finding(name, "ok", text) if is_right else Finding(name, "error", text + expected, "run make setup")
    )


def system_libraries(load: Callable[[str], object] = ctypes.CDLL) -> Iterator[Finding]:
    """Check the system libraries that Open3D needs."""
    for library, package in SYSTEM_LIBRARIES.items():
        advice = f"apt-get install {package}"
        yield _tried(library, f"load {library}", partial(load, library), "error", advice)


def modules(load: Callable[[str], object] = importlib.import_module) -> Iterator[Finding]:
    """Check that libraries with native parts can be imported."""
    for name, needed in MODULES.items():
        advice = "run make setup; a role without it works on"
        yield _tried(name, f"import {name}", partial(load, name), "error" if needed else "warning", advice)


def _tried(
    check: str, what: str, attempt: Callable[[], object], state: State, advice: str, ok: str = ""
) -> Finding:
    """Return whether an attempt succeeds; ``ok`` follows ``what`` then."""
    try:
        attempt()
    except (ImportError, OSError) as error:
        return Finding(check, state, f"{what}: {getattr(error, 'strerror', None) or error}", advice)
    return Finding(check, "ok", f"{what}{ok}")


def data_folder(folder: Path) -> Finding:
    """Check that the data folder is writable and the disk has space."""
    nearest = next(p for p in (folder, *folder.parents) if p.exists())
    if not os.access(nearest, os.W_OK):
        return Finding("data", "error", f"{folder} cannot be written", "name another with CDFF_DATA_DIR")
    free = shutil.disk_usage(nearest).free
    text = f"{folder}, {free / 1e9:.1f} GB free"
    if free < MIN_FREE_BYTES:
        return Finding("data", "warning", text, "make room: the store keeps every product")
    return Finding("data", "ok", text)


def store_lock(folder: Path) -> Finding:
    """Report a DPM process that has the store open; it is no fault, but a second one would be refused."""
    import fcntl

    for path in sorted(folder.glob("*.lock")) if folder.is_dir() else ():
        try:
            file = path.open("rb")
        except OSError as error:
            return Finding("store", "warning", f"{path}: {error.strerror}", "make it readable for this user")
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return Finding(
                    "store",
                    "warning",
                    f"{path} is locked by a running DPM",
                    "stop it before starting another",
                )
            fcntl.flock(file, fcntl.LOCK_UN)
    return Finding("store", "ok", "no DPM holds the store")


def http_port(address: str) -> Finding:
    """Check that the HTTP port is free or answered by a DPM."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bind = partial(probe.bind, split_address(address))
        return _tried("http", address, bind, "warning", "a DPM serves there, or use --http", " is free")


def router(connect: str) -> Finding:
    """Check that a process listens at the endpoint of the router."""
    address, advice = split_address(connect), "start it: cdff service router, or cdff up"

    def knock() -> None:
        socket.create_connection(address, timeout=1.0).close()

    return _tried("router", connect, knock, "warning", advice, " answers")


def clock(now_ns: int | None = None) -> Finding:
    """Check that the wall clock shows a possible time."""
    now = wall_ns() if now_ns is None else now_ns
    if now < EARLIEST_NS:
        return Finding(
            "clock", "error", f"the wall clock shows {now} ns", "set it: stamps and freshness depend on it"
        )
    return Finding("clock", "ok", "the wall clock shows a possible time")
