# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access to an object store with the S3 protocol; its errors become those of the store.

The endpoint and the credentials are the standard variables ``AWS_ENDPOINT_URL``, ``AWS_ACCESS_KEY_ID``,
``AWS_SECRET_ACCESS_KEY`` and ``AWS_REGION``, so that no secret is in a URL. An object exists completely or
not at all, and ``create`` never replaces one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

from cdff_common.errors import ConfigurationError, StorageError

_MARKER = "store"
_RETRIES: dict[str, Any] = {"max_retries": 3, "retry_timeout": timedelta(seconds=20)}


class ObjectStore:
    """The objects below a URL, by key.

    Raises
    ------
    ConfigurationError
        If the URL is malformed, the client library is missing, the bucket does not exist, or the credentials
        are refused.
    StorageError
        If the object store cannot be reached; this holds for the methods too.
    """

    def __init__(self, url: str) -> None:
        if not url.startswith("s3://") or len(url) <= len("s3://"):
            raise ConfigurationError(f"payloads {url!r}: expected s3://bucket or s3://bucket/prefix")
        try:
            import obstore
            from obstore import exceptions
            from obstore.store import S3Store
        except ImportError as error:
            raise ConfigurationError(f"payloads {url}: {error}; install the extra `cdff[scale]`") from error
        self._url, self._api, self._errors = url, obstore, exceptions
        endpoint = os.environ.get("AWS_ENDPOINT_URL", "")
        options: dict[str, Any] = {"allow_http": endpoint.startswith("http://"), "timeout": "60 s"}
        config: dict[str, Any] = {"endpoint": endpoint} if endpoint else {}
        try:
            self._store = S3Store.from_url(url, config=config, client_options=options, retry_config=_RETRIES)
        except exceptions.BaseError as error:
            raise ConfigurationError(f"payloads {url}: {error}") from error
        self._check_access()

    def _check_access(self) -> None:
        """Create the object that marks a store, so that a wrong bucket or key is found at the start."""
        errors = self._errors
        try:
            self._api.put(self._store, _MARKER, b"cdff", mode="create")
        except (errors.AlreadyExistsError, errors.PreconditionError):
            return
        except (
            errors.PermissionDeniedError,
            errors.UnauthenticatedError,
            errors.NotFoundError,
            FileNotFoundError,
        ) as error:
            raise ConfigurationError(
                f"payloads {self._url}: {_first_line(error)}; create the bucket, and check AWS_ACCESS_KEY_ID "
                "and AWS_SECRET_ACCESS_KEY"
            ) from error
        except (errors.BaseError, OSError, ValueError) as error:
            raise StorageError(
                f"payloads {self._url}: {_first_line(error)}; check AWS_ENDPOINT_URL and that the object "
                "store runs"
            ) from error

    def create(self, key: str, content: bytes) -> bool:
        """Create an object; return False if it exists."""
        with self._translated(key):
            try:
                self._api.put(self._store, key, content, mode="create", use_multipart=False)
            except (self._errors.AlreadyExistsError, self._errors.PreconditionError):
                return False
            return True

    def put(self, key: str, content: bytes) -> None:
        """Create or replace an object."""
        with self._translated(key):
            self._api.put(self._store, key, content, use_multipart=False)

    def get(self, key: str) -> bytes:
        """Return an object."""
        with self._translated(key):
            return bytes(self._api.get(self._store, key).bytes())

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """Return bytes of an object; fewer if it ends before."""
        if not length:
            return b""
        with self._translated(key):
            return bytes(self._api.get_range(self._store, key, start=start, length=length))

    def size(self, key: str) -> int | None:
        """Return the size of an object; None if it does not exist."""
        with self._translated(key):
            try:
                return int(self._api.head(self._store, key)["size"])
            except (self._errors.NotFoundError, FileNotFoundError):
                return None

    def remove(self, key: str) -> None:
        """Remove an object that may not exist."""
        with self._translated(key):
            try:
                self._api.delete(self._store, key)
            except (self._errors.NotFoundError, FileNotFoundError):
                return

    def list(self, prefix: str, after: str | None = None) -> Iterator[list[tuple[str, int]]]:
        """Yield keys and sizes of the objects with a prefix, in order, in lists, from ``after`` a key on."""
        with self._translated(prefix):
            for page in self._api.list(self._store, prefix, offset=after, chunk_size=1000):
                yield [(entry["path"], int(entry["size"])) for entry in page]

    @contextmanager
    def _translated(self, key: str) -> Iterator[None]:
        try:
            yield
        except (self._errors.BaseError, OSError, ValueError) as error:
            raise StorageError(f"object {self._url}/{key}: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:300]
