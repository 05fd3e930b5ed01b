# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Index of the open jobs by the changes that concern them, so that a change wakes no other job."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Hashable, Iterable
from typing import Protocol

#: Robot of a watcher of the products of all robots.
ANY = "any"


class Watcher(Protocol):
    """Receiver of a signal, such as an event."""

    def set(self) -> None:
        """Signal a change."""


class Watchers:
    """Watchers of changes of robots, and of insertions of products; not thread-safe.

    A watcher may be called several times for one change.
    """

    def __init__(self) -> None:
        self._by_subject: defaultdict[Hashable, set[Watcher]] = defaultdict(set)
        self._insertions: Counter[tuple[str, str]] = Counter()

    def add(self, watcher: Watcher, robots: Iterable[str], products: Iterable[tuple[str, str]]) -> None:
        """Watch some robots, and the insertion of products, ``(robot or ANY, product)``."""
        for subject in (*robots, *products):
            self._by_subject[subject].add(watcher)

    def remove(self, watcher: Watcher, robots: Iterable[str], products: Iterable[tuple[str, str]]) -> None:
        """Undo ``add`` with the same arguments."""
        for subject in (*robots, *products):
            self._by_subject[subject].discard(watcher)
            if not self._by_subject[subject]:
                del self._by_subject[subject]

    def notify(self, robots: Iterable[str] | None = None) -> None:
        """Wake the watchers of some robots, by default all watchers of any robot."""
        subjects = [s for s in self._by_subject if isinstance(s, str)] if robots is None else robots
        self._wake(subjects)

    def add_insertion(self, robot: str, product: str) -> None:
        """Count an insertion of a product of a robot, and wake its watchers."""
        subjects = ((robot, product), (ANY, product))
        self._insertions.update(subjects)
        self._wake(subjects)

    def insertions(self, products: Iterable[tuple[str, str]]) -> int:
        """Return the number of insertions of some products, ``(robot or ANY, product)``."""
        return sum(self._insertions[product] for product in products)

    def _wake(self, subjects: Iterable[Hashable]) -> None:
        for subject in subjects:
            for watcher in self._by_subject.get(subject, ()):
                watcher.set()
