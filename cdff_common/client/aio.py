# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The client for asyncio: the same requests, each in a thread of its own, cancelled with the task that awaits it::

async with AsyncClient() as c:
dem = await c.request("dem", robot="mana", region="circle:0,0,10")
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TypeVar, Unpack

from cdff_common.client.answer import Answer
from cdff_common.client.client import Client, OnProgress
from cdff_common.client.wishes import Wishes
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.geometry import UncertainTransform

T = TypeVar("T")


class AsyncClient:
    """A client of the orchestrator and the DPM; an asynchronous context manager.

    Parameters
    ----------
    connect : str, optional
        Endpoint of the router; default ``CDFF_CONNECT``, then ``tcp/127.0.0.1:7447``.
    name : str
        Of this process, for logs.
    at_once : int
        Most calls under way at a time; more wait here.

    Notes
    -----
    Methods raise what those of ``Client`` raise. It asks again, as ``Client`` does, where the router or the
    orchestrator went away, until the deadline. A task that is cancelled cancels its request with the orchestrator.
    """

    def __init__(self, connect: str | None = None, *, name: str = "client", at_once: int = 32) -> None:
        self._connect = connect
        self._name = name
        self._pool = ThreadPoolExecutor(at_once, thread_name_prefix=name)
        self._client: Client | None = None

    async def __aenter__(self) -> Self:
        self._client = await self._run(lambda: Client(self._connect, name=self._name))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._run(self._open.close)
        self._pool.shutdown(wait=False)

    async def request(
        self,
        product: str,
        *,
        robot: str = "any",
        deadline_s: float = 20.0,
        on_progress: OnProgress | None = None,
        **wishes: Unpack[Wishes],
    ) -> Answer:
        """Ask for a product and wait for it; ``on_progress`` is called in the event loop."""
        loop, over = asyncio.get_running_loop(), threading.Event()
        jobs: list[str] = []

        def progress(body: Any) -> None:
            jobs.append(str(body["job"]))
            if over.is_set():
                self._cancel_quietly(jobs[-1], robot)
            elif on_progress is not None:
                loop.call_soon_threadsafe(on_progress, body)

        try:
            return await self._run(
                lambda: self._open.request(product, robot=robot, deadline_s=deadline_s, on_progress=progress, **wishes)
            )
        except asyncio.CancelledError:
            over.set()
            if jobs:
                self._pool.submit(self._cancel_quietly, jobs[-1], robot)
            raise

    async def standing(
        self, product: str, *, robot: str = "any", every_s: float = 0.0, lease_s: float = 30.0, **wishes: Unpack[Wishes]
    ) -> AsyncIterator[Answer]:
        """Yield a product now and each newer one as it comes; see ``Client.standing``.

        One of the calls ``at_once`` is taken while it is open. It ends with ``aclose``, with ``async with
        contextlib.aclosing(…)``, or with the task that iterates.
        """
        over = threading.Event()
        answers = self._open.standing(product, robot=robot, every_s=every_s, lease_s=lease_s, stop=over, **wishes)
        coming: Future[Answer | None] | None = None
        try:
            while True:
                coming = self._pool.submit(next, answers, None)
                answer = await asyncio.wrap_future(coming)
                if answer is None:
                    return
                yield answer
        finally:
            over.set()  # wakes whoever cancels it with the orchestrator; its stream then ends
            if coming is not None:
                coming.add_done_callback(lambda _: self._pool.submit(answers.close))

    async def explain(
        self, product: str, *, robot: str = "any", deadline_s: float = 20.0, **wishes: Unpack[Wishes]
    ) -> dict[str, Any]:
        """Say what a request would get, without running anything."""
        return await self._run(lambda: self._open.explain(product, robot=robot, deadline_s=deadline_s, **wishes))

    async def search(self, product: str | None = None, **parameters: object) -> list[dict[str, Any]]:
        """Metadata of products in the DPM, newest first."""
        return await self._run(lambda: self._open.search(product, **parameters))

    async def get(self, product_id: str) -> Answer:
        """Return a product by id; raises ProductNotFoundError."""
        return await self._run(lambda: self._open.get(product_id))

    async def pose(
        self, robot: str, *, parent: str = "site", child: str | None = None, t_ns: int | None = None
    ) -> UncertainTransform:
        """``T_parent_child`` from the DPM at a time, the newest without one."""
        return await self._run(lambda: self._open.pose(robot, parent=parent, child=child, t_ns=t_ns))

    async def call(
        self, robot: str, dfpc: str, operation: str, parameters: Mapping[str, object] | None = None, *,
        timeout_s: float = 10.0,
    ) -> tuple[Any, Mapping[str, Any]]:  # fmt: skip
        """Run an operation of a DFPC; see ``Client.call``."""
        return await self._run(lambda: self._open.call(robot, dfpc, operation, parameters, timeout_s=timeout_s))

    async def jobs(self, robot: str = "any", *, limit: int = 50) -> list[dict[str, Any]]:
        """The orchestrator's newest jobs, and where they stand."""
        return await self._run(lambda: self._open.jobs(robot, limit=limit))

    async def cancel(self, job: str, robot: str = "any") -> None:
        """Cancel a job by its id or its request's."""
        await self._run(lambda: self._open.cancel(job, robot))

    async def catalogue(self, robot: str = "any", product: str | None = None) -> dict[str, Any]:
        """What could be asked for, what would make it at what cost, and why not; of one product where it is named."""
        return await self._run(lambda: self._open.catalogue(robot, product))

    async def history(
        self, *, kinds: Sequence[str] = (), robot: str = "any", since: int = 0, limit: int = 1000
    ) -> list[dict[str, Any]]:
        """What happened after an ordinal, oldest first; see ``Client.history``."""
        return await self._run(lambda: self._open.history(kinds=kinds, robot=robot, since=since, limit=limit))

    # -- inside -----------------------------------------------------------------------------------------------------

    @property
    def _open(self) -> Client:
        if self._client is None:
            raise UnavailableError("the client is not open: use it as `async with AsyncClient() as c`")
        return self._client

    async def _run(self, call: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._pool, call)

    def _cancel_quietly(self, job: str, robot: str) -> None:
        with suppress(CdffError):  # it may have ended by itself
            self._open.cancel(job, robot)
