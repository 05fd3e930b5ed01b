# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who may do what: a route that changes something names the roles that may, in the OpenAPI document too.

Reading is for every key. A route of another method that names nobody is for nobody, so that a new one is closed until
somebody has thought about it.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.routing import APIRoute

from cdff_common.errors import ConfigurationError
from dpm_store.actor import ROLES, Actor

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
#: Where an operation of the OpenAPI document names its roles.
EXTRA = "x-cdff-roles"
_ROBOT = re.compile(r"[a-z][a-z0-9_]{0,63}\Z")
#: Who calls where no keys are needed: a program of this machine.
LOCAL = Actor("local", "admin", "http")


def allowed(*roles: str) -> dict[str, Any]:
    """``openapi_extra`` of a route that these roles may use; ``admin`` always may."""
    unknown = set(roles) - set(ROLES)
    if unknown:
        raise ValueError(f"roles {sorted(unknown)}: expected some of {', '.join(ROLES)}")
    return {EXTRA: sorted({*roles, "admin"}, key=ROLES.index)}


@dataclass(frozen=True, slots=True)
class Rule:
    """Roles of a route and a method; None where the route names none."""

    path: str
    pattern: re.Pattern[str]
    methods: frozenset[str]
    roles: frozenset[str] | None

    @property
    def changes(self) -> bool:
        """Whether it may change something: a search by POST does not."""
        return self.roles is None or "reader" not in self.roles


def rules_of(routers: Iterable[APIRouter]) -> tuple[Rule, ...]:
    """Rules of all routes that are not only read."""
    found = []
    for router in routers:
        for route in router.routes:
            methods = frozenset(getattr(route, "methods", None) or ()) - SAFE
            if isinstance(route, APIRoute) and methods:
                roles = (route.openapi_extra or {}).get(EXTRA)
                named = None if roles is None else frozenset(roles)
                found.append(Rule(route.path, route.path_regex, methods, named))
    return tuple(found)


def rule_for(rules: Iterable[Rule], method: str, path: str) -> Rule | None:
    """The rule that a request comes under; None for one that nothing answers."""
    return next((rule for rule in rules if method in rule.methods and rule.pattern.match(path)), None)


class Keys:
    """Known keys, hashed.

    A key is 256 random bits, so that SHA-256 without salt or stretching is enough: nobody can try them all, and no two
    are alike. Slow hashes protect words that people choose.

    Parameters
    ----------
    path : Path
        Lines of ``sha256hex role name``, comments after ``#``; the name of a robot's key is the robot's id.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a line is something else; keys themselves are never shown.
    """

    def __init__(self, path: Path) -> None:
        try:
            text = path.read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"{path}: {error}") from error
        self._known: dict[str, Actor] = {}
        for number, line in enumerate(text.splitlines(), 1):
            fields = line.split("#", 1)[0].split()
            if not fields:
                continue
            if len(fields) != 3 or not re.fullmatch(r"[0-9a-fA-F]{64}", fields[0]) or fields[1] not in ROLES:
                raise ConfigurationError(
                    f"{path}:{number}: expected 'sha256hex role name', role one of {', '.join(ROLES)}"
                )
            if fields[1] == "robot" and not _ROBOT.match(fields[2]):
                raise ConfigurationError(f"{path}:{number}: a robot's key is named after the robot's id")
            self._known[fields[0].lower()] = Actor(fields[2][:64], fields[1], "http")

    def actor(self, authorization: str) -> Actor | None:
        """Whose key stands in an ``Authorization`` header; None for an unknown one, in the same time."""
        scheme, _, token = authorization.partition(" ")
        digest = hashlib.sha256(token.strip().encode("utf-8", "surrogateescape")).hexdigest()
        found = None
        for known, actor in self._known.items():  # all of them: the time must not tell which
            if hmac.compare_digest(known, digest):
                found = actor
        return found if scheme.lower() == "bearer" else None
