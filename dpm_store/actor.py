# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who acts: entered beside every change in the history, in the transaction of the change itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from cdff_common.errors import DeniedError

#: From weak to strong, save that a robot writes nothing but its own products.
ROLES = ("reader", "robot", "operator", "admin")


@dataclass(frozen=True, slots=True)
class Actor:
    """Somebody with a role.

    Attributes
    ----------
    name : str
        Of the key; for a robot its id.
    role : str
        One of ``ROLES``.
    via : str
        ``http`` or ``zenoh``.
    """

    name: str
    role: str
    via: str

    @property
    def text(self) -> str:
        """As it stands in the history: ``via/role/name``."""
        return f"{self.via}/{self.role}/{self.name}"

    def check_robot(self, robot: str) -> None:
        """Raise DeniedError where a robot would write what is another's."""
        if self.role == "robot" and robot != self.name:
            raise DeniedError(f"robot {self.name[:64]} may write its own products only, these are of {robot[:64]!r}")


_ACTOR: ContextVar[Actor | None] = ContextVar("actor", default=None)


@contextmanager
def acting(actor: Actor | None) -> Iterator[None]:
    """Have everything that is changed meanwhile entered as done by somebody."""
    token = _ACTOR.set(actor)
    try:
        yield
    finally:
        _ACTOR.reset(token)


def actor() -> Actor | None:
    """Who acts now; None for the process itself."""
    return _ACTOR.get()


def check_robot(robot: str) -> None:
    """Raise DeniedError where who acts is another robot."""
    if (who := actor()) is not None:
        who.check_robot(robot)
