# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The asyncio client against real processes."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Answer, AsyncClient
from cdff_common.clock import wall_ns
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn
from tests.integration.conftest import wait_until as eventually
from tests.support.orchestrated_products import put

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


@pytest.mark.req("CDFF-SUP-075")
def test_twenty_concurrent_requests_are_answered_and_a_cancelled_task_ends_its_job(
    spawn: Spawn, endpoint: str, tmp_path: Path
) -> None:
    spawn("services.router")
    spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
    spawn("services.orchestrator", "--profile", PROFILE)
    stamp_ns = wall_ns() // 1000 * 1000
    T = UncertainTransform.identity()
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=stamp_ns)
    with Bus.open(endpoint, name="test", wait_s=20) as bus:
        awaited_tokens = {keys.alive("mana", s) for s in ("dpm", "orchestrator")}
        eventually(lambda: awaited_tokens <= bus.alive(keys.alive("mana", "*")), 40, "start-up")
        header = put(bus, "pose", value, child="mana/base")

    async def one_shot_requests() -> None:
        async with AsyncClient(endpoint) as c:
            answers = await asyncio.gather(
                *(c.request("pose", robot="mana", max_age_s=600) for _ in range(20))
            )
            assert {a.header.id for a in answers} == {header.id}
            assert (await c.get(header.id)).value == value
            received = asyncio.Event()
            # No newer pose can appear: the DFPC that produces it is not running.
            task = asyncio.create_task(
                c.request(
                    "pose", robot="mana", max_age_s=0.0, deadline_s=60, on_progress=lambda _b: received.set()
                )
            )
            await asyncio.wait_for(received.wait(), 20)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            async with asyncio.timeout(20):
                while (await c.jobs("mana"))[0]["state"] != "cancelled":
                    await asyncio.sleep(0.05)

    async def standing_requests() -> None:
        async with AsyncClient(endpoint) as c:
            newest_ns = stamp_ns
            async with contextlib.aclosing(c.standing("pose", robot="mana", lease_s=6.0)) as answers:
                async for answer in answers:
                    assert answer.header.t1_ns == newest_ns
                    if newest_ns > stamp_ns:
                        break
                    newest_ns += 1_000_000
                    later = TransformWithCovariance.from_transform(
                        T, parent="site", child="mana/base", stamp_ns=newest_ns
                    )
                    await asyncio.to_thread(put, bus, "pose", later, child="mana/base", seq=1)
            async with asyncio.timeout(20):
                while (await c.jobs("mana"))[0]["state"] != "cancelled":
                    await asyncio.sleep(0.05)
            # A task that waits for the next answer ends when it is cancelled.
            task = asyncio.ensure_future(collect(c, 2))
            async with asyncio.timeout(20):
                while (await c.jobs("mana"))[0]["state"] in ("cancelled", "received", "looking"):
                    await asyncio.sleep(0.05)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            async with asyncio.timeout(20):
                while (await c.jobs("mana"))[0]["state"] != "cancelled":
                    await asyncio.sleep(0.05)

    async def collect(c: AsyncClient, n: int) -> list[Answer]:
        async with contextlib.aclosing(c.standing("pose", robot="mana", lease_s=6.0)) as answers:
            results: list[Answer] = []
            async for answer in answers:
                results.append(answer)
                if len(results) == n:
                    break
            return results

    asyncio.run(one_shot_requests())
    with Bus.open(endpoint, name="test", wait_s=20) as bus:
        asyncio.run(standing_requests())
