# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identity of a process on a secured bus: its certificate and key in a folder written by ``cdff keys``."""

from __future__ import annotations

import json
import os
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cdff_common.errors import ConfigurationError

#: Variable with the folder of the identity; without it the bus is neither encrypted nor authenticated.
VARIABLE = "CDFF_IDENTITY"
#: Files of an identity folder. The others are only in folders of identities with a router.
AUTHORITY, CERTIFICATE, KEY = "ca.crt", "identity.crt", "identity.key"
ACCESS, MEMBERS, EXPIRY = "access.json", "members.json", "expiry.json"


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity folder with ``ca.crt``, ``identity.crt`` and ``identity.key``."""

    folder: Path

    @classmethod
    def of_environment(cls) -> Identity | None:
        """Return the identity of ``CDFF_IDENTITY``, None if it is not set; raises ConfigurationError."""
        folder = os.environ.get(VARIABLE)
        return cls.read(Path(folder)) if folder else None

    @classmethod
    def read(cls, folder: Path) -> Identity:
        """Return the identity in a folder.

        Raises
        ------
        ConfigurationError
            If a file is missing or unreadable, or others than the owner may read the key. The group may read
            the key of another owner, root: Kubernetes mounts secrets in this way.
        """
        for name in (AUTHORITY, CERTIFICATE, KEY):
            path = folder / name
            if not os.access(path, os.R_OK):
                raise ConfigurationError(
                    f"{path}: cannot be read, expected a file of an identity; write it with `cdff keys`"
                )
        status = (folder / KEY).stat()
        mode = status.st_mode & 0o777
        is_mounted = status.st_uid == 0 and os.geteuid() != 0
        if mode & (0o037 if is_mounted else 0o077):
            raise ConfigurationError(f"{folder / KEY}: mode {mode:o}, expected 600; run chmod 600 on it")
        return cls(folder.resolve())

    def path(self, name: str) -> str:
        """Return the path of a file of the folder."""
        return str(self.folder / name)

    def settings(self, *, listens: bool) -> dict[str, object]:
        """Return the Zenoh settings with which both ends of a link show certificates of one authority."""
        tls = {
            "root_ca_certificate": self.path(AUTHORITY),
            "connect_certificate": self.path(CERTIFICATE),
            "connect_private_key": self.path(KEY),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
        if listens:
            tls |= {"listen_certificate": self.path(CERTIFICATE), "listen_private_key": self.path(KEY)}
        return {f"transport/link/tls/{name}": value for name, value in tls.items()}

    def https_context(self) -> ssl.SSLContext:
        """Return the TLS settings of an HTTP client that shows this identity to the DPM."""
        context = ssl.create_default_context(cafile=self.path(AUTHORITY))
        context.load_cert_chain(self.path(CERTIFICATE), self.path(KEY))
        return context

    def access_control(self) -> dict[str, Any]:
        """Return the access-control list of a router; raises ConfigurationError if there is none."""
        path = self.folder / ACCESS
        try:
            rules: dict[str, Any] = json.loads(path.read_text())
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"{path}: {error}; a router needs the identity of the ground or of a robot"
            ) from error
        return rules
