# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Addresses of object stores."""

from __future__ import annotations

import pytest

from cdff_common.errors import ConfigurationError
from dpm_store.payloads.object_store import ObjectStore


@pytest.mark.parametrize("url", ["https://bucket/prefix", "bucket", "s3://", "s3:/bucket"])
def test_an_address_without_a_bucket_is_refused(url: str) -> None:
    with pytest.raises(ConfigurationError, match="expected s3://bucket"):
        ObjectStore(url)
