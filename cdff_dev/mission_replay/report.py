# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of the answers of a mission replay: ``answers.json`` and the delivered payloads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import rpc_code
from cdff_common.json_form import jsonable
from cdff_common.output import make_folder, write_file
from cdff_dev.mission_replay.mission import ScriptedAnswer

#: Suffix of the files of a format, if it differs from the name of the format.
_SUFFIXES = {"xer": "xml"}


def write_answers(folder: Path, answers: Sequence[ScriptedAnswer], start_ns: int) -> list[dict[str, Any]]:
    """Write ``answers.json`` and ``answers/{request}.{format}``; return the content of ``answers.json``.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    make_folder(folder / "answers")
    described = [_write_answer(folder, answer, start_ns) for answer in answers]
    write_file(folder / "answers.json", (json.dumps(described, indent=2, sort_keys=True) + "\n").encode())
    return described


def _write_answer(folder: Path, answer: ScriptedAnswer, start_ns: int) -> dict[str, Any]:
    """Write the payload of an answer, if it has one; return its entry of ``answers.json``."""
    scripted = answer.request
    request = scripted.request
    body: dict[str, Any] = {
        "request": request.id,
        "at_s": (scripted.at_ns - start_ns) * 1e-9,
        "after_s": round(answer.after_s, 6),
        "asked": request.describe(),
        "progress": answer.progress,
    }
    if answer.error is not None or answer.reply is None:
        code, retriable = rpc_code(answer.error) if answer.error is not None else ("INTERNAL", False)
        detail = str(answer.error or "no answer")
        body |= {"answer": "error", "code": code, "retriable": retriable, "detail": detail}
        return jsonable(body)  # type: ignore[no-any-return]
    attachment = {
        k: v for k, v in answer.reply.attachment.items() if k not in ("job", "request", "asked", "final")
    }
    body |= {"answer": attachment.pop("kind"), "delivered": attachment.pop("delivered"), "header": attachment}
    if body["answer"] == "product":
        name = f"answers/{request.id}.{_SUFFIXES.get(request.format, request.format)}"
        write_file(folder / name, answer.reply.payload)
        body["file"] = name
    return jsonable(body)  # type: ignore[no-any-return]
