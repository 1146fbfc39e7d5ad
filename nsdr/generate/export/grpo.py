"""JSON lines for reinforcement learning with answers that can be checked (GRPO)."""

from typing import Any

from nsdr.generate.export.base import Export, Exporter, write_json_lines
from nsdr.generate.export.records import Record

__all__ = ["GRPO", "grpo_row", "user_message"]


def user_message(record: Record) -> dict[str, Any]:
    """What the user says: the video, then the prompt, as chat templates of Qwen-VL and its kin read them."""
    content = [{"type": "video", "video": record.video}, {"type": "text", "text": record.prompt}]
    return {"role": "user", "content": content}


def grpo_row(record: Record) -> dict[str, Any]:
    """A row in the conversational form that TRL's `GRPOTrainer` takes: `prompt` is a list of messages.

    All other attributes of the record are columns, which the trainer hands on to reward functions.
    """
    return record.row() | {"prompt": [user_message(record)]}


def _write(export: Export) -> None:
    write_json_lines(export, grpo_row)


GRPO = Exporter(_write)
"""SPLIT.jsonl with `grpo_row` of each question, and `videos/`."""
