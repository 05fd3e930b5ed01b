# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The SDK of an autonomy framework or a notebook::

with Client() as c:
dem = c.request("dem", robot="mana", region="circle:0,0,10")
print(dem.value.layer("mean"), dem.delivered["coverage"])
"""

from cdff_common.client.answer import Answer
from cdff_common.client.async_client import AsyncClient
from cdff_common.client.client import Client
from cdff_common.client.stored_product import StoredProduct

__all__ = ["Answer", "AsyncClient", "Client", "StoredProduct"]
