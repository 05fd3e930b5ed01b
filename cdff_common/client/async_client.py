# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The client for asyncio: each call runs in a thread and is cancelled with the task that awaits it.

::

    async with AsyncClient() as client:
        dem = await client.request("dem", robot="mana", region="circle:0,0,10")
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial, wraps
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, Unpack

from cdff_common.client.answer import Answer
from cdff_common.client.client import Client, OnProgress
from cdff_common.client.request_options import RequestOptions
from cdff_common.errors import CdffError, UnavailableError

P = ParamSpec("P")
T = TypeVar("T")


def _in_pool(
    method: Callable[Concatenate[Client, P], T],
) -> Callable[Concatenate[AsyncClient, P], Coroutine[Any, Any, T]]:
    """Return the coroutine function that calls a method of ``Client`` in the pool."""

    @wraps(method)
    async def call(self: AsyncClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._run(partial(getattr(self._opened_client, method.__name__), *args, **kwargs))

    return call


class AsyncClient:
    """Client of the orchestrator and the DPM; an asynchronous context manager.

    Parameters
    ----------
    connect : str, optional
        Endpoint of the router; default ``CDFF_CONNECT``, then ``tcp/127.0.0.1:7447``.
    name : str
        Name of this process in logs.
    at_once : int
        Largest number of simultaneous calls; further calls wait.

    Notes
    -----
    The methods have the arguments, results and errors of the same methods of ``Client``. A cancelled task
    cancels its request.
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
        await self._run(self._opened_client.close)
        self._pool.shutdown(wait=False)

    async def request(
        self,
        product: str,
        *,
        robot: str = "any",
        deadline_s: float = 20.0,
        on_progress: OnProgress | None = None,
        **options: Unpack[RequestOptions],
    ) -> Answer:
        """Request a product and wait for it; ``on_progress`` is called in the event loop."""
        loop, stopped = asyncio.get_running_loop(), threading.Event()
        jobs: list[str] = []

        def progress(body: Any) -> None:
            jobs.append(str(body["job"]))
            if stopped.is_set():
                self._cancel_quietly(jobs[-1], robot)
            elif on_progress is not None:
                loop.call_soon_threadsafe(on_progress, body)

        try:
            return await self._run(
                lambda: self._opened_client.request(
                    product, robot=robot, deadline_s=deadline_s, on_progress=progress, **options
                )
            )
        except asyncio.CancelledError:
            stopped.set()
            if jobs:
                self._pool.submit(self._cancel_quietly, jobs[-1], robot)
            raise

    async def standing(
        self,
        product: str,
        *,
        robot: str = "any",
        every_s: float = 0.0,
        lease_s: float = 30.0,
        **options: Unpack[RequestOptions],
    ) -> AsyncIterator[Answer]:
        """Yield the current product, then each newer one; see ``Client.standing``.

        The iterator counts as one of the calls ``at_once`` while it is open. It ends with ``aclose``, with
        ``async with contextlib.aclosing(…)``, or with the task that iterates.
        """
        stopped = threading.Event()
        answers = self._opened_client.standing(
            product, robot=robot, every_s=every_s, lease_s=lease_s, stop=stopped, **options
        )
        pending: Future[Answer | None] | None = None
        try:
            while True:
                pending = self._pool.submit(next, answers, None)
                answer = await asyncio.wrap_future(pending)
                if answer is None:
                    return
                yield answer
        finally:
            stopped.set()  # wakes the thread that cancels the request; its stream then ends
            if pending is not None:
                pending.add_done_callback(lambda _: self._pool.submit(answers.close))

    explain = _in_pool(Client.explain)
    schedule = _in_pool(Client.schedule)
    scheduled = _in_pool(Client.scheduled)
    search = _in_pool(Client.search)
    get = _in_pool(Client.get)
    pose = _in_pool(Client.pose)
    world = _in_pool(Client.world)
    call = _in_pool(Client.call)
    jobs = _in_pool(Client.jobs)
    cancel = _in_pool(Client.cancel)
    catalogue = _in_pool(Client.catalogue)
    history = _in_pool(Client.history)

    @property
    def _opened_client(self) -> Client:
        if self._client is None:
            raise UnavailableError("the client is not open: use it as `async with AsyncClient() as c`")
        return self._client

    async def _run(self, call: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._pool, call)

    def _cancel_quietly(self, job: str, robot: str) -> None:
        with suppress(CdffError):  # the job may have ended already
            self._opened_client.cancel(job, robot)
