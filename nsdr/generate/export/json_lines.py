"""JSON lines of conversations, as chat templates of Qwen-VL and its kin read them: for GRPO and for supervised training."""

from typing import Any

from nsdr.generate.export.base import Exporter, write_json_lines
from nsdr.generate.export.records import Record


def _user_message(record: Record) -> dict[str, Any]:
    """What the user says: the video, then the prompt."""
    content = [{"type": "video", "video": record.video}, {"type": "text", "text": record.prompt}]
    return {"role": "user", "content": content}


def grpo_row(record: Record) -> dict[str, Any]:
    """A row in the conversational form that TRL's `GRPOTrainer` takes: `prompt` is a list of messages.

    All other attributes of the record are columns, which the trainer hands on to reward functions.
    """
    return record.row() | {"prompt": [_user_message(record)]}


def chat_row(record: Record) -> dict[str, Any]:
    """A row with `messages` in place of `prompt`, `solution` and `reasoning`.

    They are the user's, then the assistant's with the reasoning, if there is any, and the solution; without a solution, the
    user's only.
    """
    messages = [_user_message(record)]
    if record.solution is not None:
        text = record.reasoning or record.solution  # reasoning ends with the solution
        messages.append({"role": "assistant", "content": [{"type": "text", "text": text}]})
    others = {k: v for k, v in record.row().items() if k not in ("id", "prompt", "solution", "reasoning")}
    return {"id": record.id, "messages": messages, **others}


GRPO = Exporter(lambda export: write_json_lines(export, grpo_row))
"""SPLIT.jsonl with `grpo_row` of each question, and `videos/`."""
CHAT = Exporter(lambda export: write_json_lines(export, chat_row))
"""SPLIT.jsonl with `chat_row` of each question, and `videos/`."""
