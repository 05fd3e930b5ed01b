# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks of ``cdff doctor``: each checks one property of the machine, without changes, and gives advice."""

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

#: System libraries that the wheel of Open3D needs but does not contain, and their Debian packages.
SYSTEM_LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
}
#: Modules with native code, and whether the base installation needs them.
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
#: Start of the project: a clock that shows an earlier time is wrong.
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
    """Run all checks; a check runs before the checks that depend on it.

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


def python_version(installed: tuple[int, int] = sys.version_info[:2]) -> Finding:
    """Check that the Python version is 3.11 to 3.13."""
    text = f"Python {installed[0]}.{installed[1]} at {sys.executable}"
    if (3, 11) <= installed <= (3, 13):
        return Finding("python", "ok", text)
    return Finding(
        "python", "error", text, "install Python 3.11 to 3.13 and run make setup with PYTHON naming it"
    )


def distributions() -> Iterator[Finding]:
    """Check the installed versions of the packages that ``pyproject.toml`` requires, without extras."""
    from packaging.requirements import Requirement

    installed = _version("cdff")
    yield _version_finding("cdff", installed, is_right=installed is not None)
    for requirement in map(Requirement, (installed and requires("cdff")) or ()):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            installed = _version(requirement.name)
            is_right = installed is not None and requirement.specifier.contains(installed, prereleases=True)
            expected = f", expected {requirement.specifier}"
            yield _version_finding(requirement.name, installed, is_right, expected)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _version_finding(name: str, installed: str | None, is_right: bool, expected: str = "") -> Finding:
    text = f"{name} {installed or 'is not installed'}"
    return (
        Finding(name, "ok", text) if is_right else Finding(name, "error", text + expected, "run make setup")
    )


def system_libraries(load: Callable[[str], object] = ctypes.CDLL) -> Iterator[Finding]:
    """Check that the system libraries that Open3D needs can be loaded."""
    for library, package in SYSTEM_LIBRARIES.items():
        advice = f"apt-get install {package}"
        yield _attempt_finding(library, f"load {library}", partial(load, library), "error", advice)


def modules(load: Callable[[str], object] = importlib.import_module) -> Iterator[Finding]:
    """Check that libraries with native parts can be imported."""
    for name, is_required in MODULES.items():
        advice = "run make setup; services that do not use it work without it"
        yield _attempt_finding(
            name, f"import {name}", partial(load, name), "error" if is_required else "warning", advice
        )


def _attempt_finding(
    check: str, subject: str, attempt: Callable[[], object], state: State, advice: str, success: str = ""
) -> Finding:
    """Return the finding of an attempt: ``state`` with ``advice`` if it fails, otherwise ``ok``.

    The detail is ``subject``, followed by the error or by ``success``.
    """
    try:
        attempt()
    except (ImportError, OSError) as error:
        return Finding(check, state, f"{subject}: {getattr(error, 'strerror', None) or error}", advice)
    return Finding(check, "ok", f"{subject}{success}")


def data_folder(folder: Path) -> Finding:
    """Check that the data folder is writable and the disk has space."""
    nearest = next(p for p in (folder, *folder.parents) if p.exists())
    if not os.access(nearest, os.W_OK):
        return Finding(
            "data", "error", f"{folder} cannot be written", "set another folder with CDFF_DATA_DIR"
        )
    free_bytes = shutil.disk_usage(nearest).free
    text = f"{folder}, {free_bytes / 1e9:.1f} GB free"
    if free_bytes < MIN_FREE_BYTES:
        return Finding(
            "data",
            "warning",
            text,
            "free some space: the store keeps products until a retention rule deletes them",
        )
    return Finding("data", "ok", text)


def store_lock(folder: Path) -> Finding:
    """Check whether a DPM process uses the store, in which case a second DPM would be refused."""
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
    return Finding("store", "ok", "no DPM uses the store")


def http_port(address: str) -> Finding:
    """Check that the HTTP port is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bind = partial(probe.bind, split_address(address))
        return _attempt_finding(
            "http",
            address,
            bind,
            "warning",
            "a running DPM may use it; otherwise choose another with --http",
            " is free",
        )


def router(connect: str) -> Finding:
    """Check that a process listens at the endpoint of the router."""
    address, advice = split_address(connect), "start the router: cdff service router, or cdff up"

    def connect_once() -> None:
        socket.create_connection(address, timeout=1.0).close()

    return _attempt_finding("router", connect, connect_once, "warning", advice, " accepts connections")


def clock(now_ns: int | None = None) -> Finding:
    """Check that the time of the wall clock is not before the start of the project."""
    now = wall_ns() if now_ns is None else now_ns
    if now < EARLIEST_NS:
        return Finding(
            "clock", "error", f"the wall clock shows {now} ns", "set the clock: stamps and ages depend on it"
        )
    return Finding("clock", "ok", "the wall clock shows a plausible time")
