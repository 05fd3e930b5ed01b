# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Roles and keys. A route that changes the store declares its roles, also in the OpenAPI document.
Every key may read. A writing route without roles is closed.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.routing import APIRoute

from cdff_common.contract.names import ROBOT_ID
from cdff_common.errors import ConfigurationError
from dpm_store.history.events import ROLES, Actor

logger = logging.getLogger(__name__)

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
#: Field of an OpenAPI operation with its roles.
EXTRA = "x-cdff-roles"
#: Actor of calls without keys: a program on this machine.
LOCAL = Actor("local", "admin", "http")


def allowed(*roles: str) -> dict[str, Any]:
    """Return ``openapi_extra`` of a route for these roles; ``admin`` is always included."""
    unknown = set(roles) - set(ROLES)
    if unknown:
        raise ValueError(f"roles {sorted(unknown)}: expected some of {', '.join(ROLES)}")
    return {EXTRA: sorted({*roles, "admin"}, key=ROLES.index)}


@dataclass(frozen=True, slots=True)
class Rule:
    """Roles of a route and a method; None if the route declares none."""

    path: str
    pattern: re.Pattern[str]
    methods: frozenset[str]
    roles: frozenset[str] | None

    @property
    def changes(self) -> bool:
        """True unless the route only reads, like a search by POST."""
        return self.roles is None or "reader" not in self.roles


def rules_of(routers: Iterable[APIRouter]) -> tuple[Rule, ...]:
    """Return the rules of all routes with methods other than GET, HEAD and OPTIONS."""
    rules = []
    for router in routers:
        for route in router.routes:
            methods = frozenset(getattr(route, "methods", None) or ()) - SAFE
            if isinstance(route, APIRoute) and methods:
                roles = (route.openapi_extra or {}).get(EXTRA)
                role_set = None if roles is None else frozenset(roles)
                rules.append(Rule(route.path, route.path_regex, methods, role_set))
    return tuple(rules)


def rule_for(rules: Iterable[Rule], method: str, path: str) -> Rule | None:
    """Return the rule of a request; None if no route matches."""
    return next((rule for rule in rules if method in rule.methods and rule.pattern.match(path)), None)


class Keys:
    """Known keys, hashed.

    A key is 256 random bits, so that SHA-256 without salt or stretching is sufficient; slow hashes protect
    passwords that people choose.

    Parameters
    ----------
    path : Path
        Lines of ``sha256hex role name``, comments after ``#``; the name of a robot's key is the robot's id.

    Raises
    ------
    ConfigurationError
        If the file cannot be read at the start, or a line is malformed; keys are never shown.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._version = _version(path)
        self._known = _read_keys(path)

    def actor(self, authorization: str) -> Actor | None:
        """Return the actor of an ``Authorization`` header, None for an unknown key, in constant time.

        A file that has changed is read again: a removed key is refused from then on. Without the file no key
        is known; from a malformed file the previous keys are kept.
        """
        self._update()
        scheme, _, token = authorization.partition(" ")
        digest = hashlib.sha256(token.strip().encode("utf-8", "surrogateescape")).hexdigest()
        match = None
        for known, actor in self._known.items():  # compare with all keys: constant time
            if hmac.compare_digest(known, digest):
                match = actor
        return match if scheme.lower() == "bearer" else None

    def _update(self) -> None:
        version = _version(self._path)
        if version == self._version:
            return
        self._version = version
        try:
            self._known = {} if version is None else _read_keys(self._path)
            logger.info("API keys read again", extra={"keys": len(self._known)})
        except ConfigurationError as error:
            logger.error("the previous API keys remain valid: %s", error)


def _version(path: Path) -> tuple[int, int, int] | None:
    """Return inode, size and modification time of a file; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns


def _read_keys(path: Path) -> dict[str, Actor]:
    """Return the actors of a file by digest; raises ConfigurationError."""
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    known = {}
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split("#", 1)[0].split()
        if not fields:
            continue
        if len(fields) != 3 or not re.fullmatch(r"[0-9a-fA-F]{64}", fields[0]) or fields[1] not in ROLES:
            raise ConfigurationError(
                f"{path}:{number}: expected 'sha256hex role name', role one of {', '.join(ROLES)}"
            )
        if fields[1] == "robot" and not re.fullmatch(ROBOT_ID, fields[2]):
            raise ConfigurationError(f"{path}:{number}: a robot's key is named after the robot's id")
        known[fields[0].lower()] = Actor(fields[2][:64], fields[1], "http")
    return known
