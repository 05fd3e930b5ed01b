# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Processes that cast rays: each makes its own renderer and renders the tasks that it receives."""

from __future__ import annotations

import multiprocessing
import pickle
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Protocol

Task = tuple[str, str, int]


class Renderer(Protocol):
    """Renders the samples of the sensors that cast rays."""

    def render(self, task: Task) -> Any:
        """Return the value of a sample; the task holds sensor, robot and index."""


#: Renderers of a worker process, by the file of their factory.
_RENDERERS: dict[str, Renderer] = {}


class RenderPool:
    """Context of worker processes.

    Parameters
    ----------
    workers : int
        Number of processes; 0: this process renders. The results do not depend on it.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._stack = ExitStack()

    def __enter__(self) -> RenderPool:
        if self._workers:
            context = multiprocessing.get_context("spawn")
            self._pool = self._stack.enter_context(ProcessPoolExecutor(self._workers, mp_context=context))
            self._scratch = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
            for _ in range(self._workers):
                self._pool.submit(_warm_up)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def map(self, factory: Callable[[], Renderer], tasks: Sequence[Task]) -> Iterator[Any]:
        """Yield the results of the tasks in their order; the factory can be pickled."""
        if not self._workers:
            yield from map(factory().render, tasks)
            return
        file = self._scratch / "renderer.pickle"
        file.write_bytes(pickle.dumps(factory))
        yield from self._pool.map(partial(_render_in_worker, str(file)), tasks, chunksize=4)


def _warm_up() -> None:
    """Import Open3D in a worker process while the parent process prepares the scenario."""
    import open3d  # noqa: F401


def _render_in_worker(file: str, task: Task) -> Any:
    if file not in _RENDERERS:
        _RENDERERS[file] = pickle.loads(Path(file).read_bytes())()  # written by the parent process
    return _RENDERERS[file].render(task)
