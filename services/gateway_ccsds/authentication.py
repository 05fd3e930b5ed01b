# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Authenticated commands, with a message authentication code and a counter that prevents repetition.

A command is ``function (1 byte), counter (8 bytes, big-endian), arguments (JSON in UTF-8), code (16 bytes)``.
The code is HMAC-SHA-256 (RFC 2104), truncated to 128 bits, of ``cdff-command-1``, the robot and the bytes
before the code. It is computed where the command is written: a mission control system forwards the command
and does not need the key.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
import struct
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, Self

from cdff_common.errors import CodecError, ConfigurationError, DeniedError, StorageError
from cdff_common.output import replace_file

KEY_BYTES = 32
CODE_BYTES = 16
#: Largest command, bytes.
MAX_COMMAND_BYTES = 4096
_HEAD = struct.Struct(">BQ")


class Function(IntEnum):
    """Functions of PUS service 8."""

    REQUEST = 1  # request a product; arguments: those of `orchestrator/@rpc/request`
    SEND = 2  # send a stored product; arguments: id and, optionally, format
    CANCEL = 3  # cancel a job; arguments: job


@dataclass(frozen=True, slots=True)
class Command:
    """An authenticated command.

    Attributes
    ----------
    function : Function
    counter : int
    arguments : dict
    """

    function: Function
    counter: int
    arguments: dict[str, Any]


class CommandKey:
    """Secret key that the author of the commands and the gateway share.

    Parameters
    ----------
    key : bytes
        ``KEY_BYTES`` bytes.
    """

    def __init__(self, key: bytes) -> None:
        if len(key) != KEY_BYTES:
            raise ConfigurationError(f"a key of {len(key)} bytes: expected {KEY_BYTES}")
        self._key = key

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the key of a file of 64 hexadecimal digits; raises ConfigurationError."""
        try:
            if path.stat().st_mode & 0o077:
                raise ConfigurationError(f"{path}: other users can read this key; chmod 600 {path}")
            return cls(bytes.fromhex(path.read_text(encoding="ascii")))
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"{path}: {error}; expected the key that `cdff keys command` writes"
            ) from error

    @staticmethod
    def write(path: Path) -> None:
        """Write a new random key, which only the user can read; raises ConfigurationError if it exists."""
        try:
            path.touch(mode=0o600, exist_ok=False)
            path.write_text(secrets.token_hex(KEY_BYTES) + "\n", encoding="ascii")
        except OSError as error:
            raise ConfigurationError(f"{path}: {error}; remove the old key first") from error

    def seal(self, robot: str, command: Command) -> bytes:
        """Return the bytes of a command for a robot."""
        text = json.dumps(command.arguments, separators=(",", ":")).encode()
        data = _HEAD.pack(command.function, command.counter) + text
        return data + self._code(robot, data)

    def open(self, robot: str, data: bytes) -> Command:
        """Return the command in bytes for a robot.

        Raises
        ------
        DeniedError
            If the code is not that of this key and robot.
        CodecError
            If the function is unknown, or the arguments are not a JSON object.
        """
        if not _HEAD.size + CODE_BYTES <= len(data) <= MAX_COMMAND_BYTES:
            raise CodecError(f"a command of {len(data)} bytes: expected 25 to {MAX_COMMAND_BYTES}")
        signed, code = data[:-CODE_BYTES], data[-CODE_BYTES:]
        if not hmac.compare_digest(code, self._code(robot, signed)):
            raise DeniedError(f"the code of a command is not that of the key of {robot}")
        number, counter = _HEAD.unpack_from(signed)
        try:
            function = Function(number)
            arguments = json.loads(signed[_HEAD.size :])
        except (ValueError, RecursionError) as error:
            raise CodecError(f"command: {error}") from error
        if not isinstance(arguments, dict):
            raise CodecError(f"arguments of a command: a {type(arguments).__name__}, expected an object")
        return Command(function, counter, arguments)

    def _code(self, robot: str, data: bytes) -> bytes:
        message = b"cdff-command-1\0" + robot.encode() + b"\0" + data
        return hmac.digest(self._key, message, hashlib.sha256)[:CODE_BYTES]


class CommandCounter:
    """Highest counter of all accepted commands, stored on disk: each command is executed at most once.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._last = int(path.read_text(encoding="ascii")) if path.exists() else -1
        except (OSError, ValueError) as error:
            raise StorageError(
                f"{path}: {error}; without it old commands could be repeated: remove the file only if the "
                "command key is replaced"
            ) from error

    def take(self, counter: int) -> None:
        """Accept and store a counter before its command is executed.

        Raises
        ------
        DeniedError
            If it is not greater than all accepted counters.
        OSError
            If it cannot be stored.
        """
        if counter <= self._last:
            raise DeniedError(f"counter {counter} of a command: expected more than {self._last}")
        replace_file(self._path, str(counter).encode(), sync=True)
        self._last = counter
