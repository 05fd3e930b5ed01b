# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a rehearsal leaves behind: ``answers.json`` and the payloads that were delivered."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import rpc_code
from cdff_common.json_form import jsonable
from cdff_common.output import make_folder, write_file
from services.rehearsal.mission import Answered

_ENDINGS = {"uper": "uper", "ber": "ber", "xer": "xml", "msgpack": "msgpack"}


def write_answers(folder: Path, answers: Sequence[Answered], start_ns: int) -> list[dict[str, Any]]:
    """Write ``answers.json`` and ``answers/{request}.{format}``; return what the former holds.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    make_folder(folder / "answers")
    told = [_described(folder, answered, start_ns) for answered in answers]
    write_file(folder / "answers.json", (json.dumps(told, indent=2, sort_keys=True) + "\n").encode())
    return told


def _described(folder: Path, answered: Answered, start_ns: int) -> dict[str, Any]:
    scripted = answered.request
    request = scripted.request
    body: dict[str, Any] = {
        "request": request.id,
        "at_s": (scripted.at_ns - start_ns) * 1e-9,
        "after_s": round(answered.after_s, 6),
        "asked": request.describe(),
        "told": answered.told,
    }
    if answered.error is not None or answered.reply is None:
        code, retriable = rpc_code(answered.error) if answered.error is not None else ("INTERNAL", False)
        detail = str(answered.error or "no answer")
        return jsonable({**body, "answer": "error", "code": code, "retriable": retriable, "detail": detail})  # type: ignore[no-any-return]
    attachment = {k: v for k, v in answered.reply.attachment.items() if k not in ("job", "request", "asked", "final")}
    body |= {"answer": attachment.pop("kind"), "delivered": attachment.pop("delivered"), "header": attachment}
    if body["answer"] == "product":
        name = f"answers/{request.id}.{_ENDINGS.get(request.format, request.format)}"
        write_file(folder / name, answered.reply.payload)
        body["file"] = name
    return jsonable(body)  # type: ignore[no-any-return]
