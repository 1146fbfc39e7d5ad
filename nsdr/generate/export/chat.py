"""JSON lines of conversations for supervised training."""

from typing import Any

from nsdr.generate.export.base import Export, Exporter, write_json_lines
from nsdr.generate.export.grpo import user_message
from nsdr.generate.export.records import Record

__all__ = ["CHAT", "chat_row"]


def chat_row(record: Record) -> dict[str, Any]:
    """A row with `messages` in place of `prompt`, `solution` and `reasoning`.

    They are the user's, then the assistant's with the reasoning, if there is any, and the solution; without a solution, the
    user's only.
    """
    messages = [user_message(record)]
    if record.solution is not None:
        text = record.reasoning or record.solution  # reasoning ends with the solution
        messages.append({"role": "assistant", "content": [{"type": "text", "text": text}]})
    others = {k: v for k, v in record.row().items() if k not in ("prompt", "solution", "reasoning")}
    return {"id": others.pop("id"), "messages": messages, **others}


def _write(export: Export) -> None:
    write_json_lines(export, chat_row)


CHAT = Exporter(_write)
"""SPLIT.jsonl with `chat_row` of each question, and `videos/`."""
