"""Calls of agents that are refused: unknown and wrong arguments, other files, and texts without end."""

import json
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from nsdr.clevrer.example import VIDEO
from nsdr.errors import DataError
from tests.robustness.case import Case

CALLED = "agent"
"""The function of `tests.robustness.library` that makes a call."""
RIGHT: dict[str, dict[str, Any]] = {
    "perceive": {"video": VIDEO.name},
    "ask": {"video": VIDEO.name, "question": "What will happen next?", "choices": ["The cube exits"]},
    "run_program": {"video": VIDEO.name, "program": "events objects filter_collision count", "choice_programs": []},
    "simulate": {"video": VIDEO.name, "changes": [{"kind": "remove", "object": "purple cube"}], "from_frame": 0},
}
"""A right call of each tool."""
WRONG: dict[str, tuple[Any, ...]] = {
    "video": (None, 5, [], "../x.mp4", "/etc/passwd", "a\0b", "", "x" * 100_000),
    "question": (None, 5, [], "x" * 501, "What " * 20_000),
    "choices": (5, "x", [5], [None], {}, ["The cube exits"] * 27, ["x" * 3001], [""] * 100_000),
    "program": (None, 5, {}, "objects " * 10_000),
    "choice_programs": (5, [5], ["events"] * 27, ["objects " * 10_000]),
    "changes": (None, 5, "x", {}, [5], [None], [{}], [{"kind": "explode"}], [{"kind": "remove", "factor": 2}],
                [{"kind": "freeze"}], [{"kind": "freeze", "object": 5}], [{"kind": "freeze", "object": "x", "zebra": 1}],
                [{"kind": "set_mass", "object": "x", "factor": "y"}]),
    "from_frame": (None, "x", 0.5, [], {}),
}  # fmt: skip
"""Wrong values of each argument."""


REQUIRED = ("video", "question", "program", "changes")
"""Arguments without a default."""


@lru_cache(maxsize=1)
def _server() -> Any:
    from nsdr.apps.mcp import make_server
    from nsdr.pipeline import Pipeline

    return make_server(Pipeline(None, None, None), VIDEO.parent)


def call_tool(tool: str, arguments: dict[str, Any]) -> None:
    """Call a tool as an agent does.

    Raises:
        DataError: the tool's error, or it shows a folder of this machine.
    """
    import anyio
    from mcp import Client

    async def called() -> Any:
        async with Client(_server()) as client:
            return await client.call_tool(tool, arguments)

    result = anyio.run(called)
    if result.is_error:
        said = " ".join(result.content[0].text.split())
        assert str(VIDEO.parent) not in said
        assert said != f"Error executing tool {tool}", "a bug, whose own text the SDK hides"
        raise DataError(said)


def agent_cases() -> Iterator[Case]:
    """All refused calls."""
    for tool, right in RIGHT.items():
        calls = {"unknown argument": ({**right, "zebra": 1}, "zebra")}
        calls |= {f"without {name}": (_without(right, name), name) for name in right if name in REQUIRED}
        for name in right:
            for value in WRONG[name]:
                calls[f"{name} = {json.dumps(value)[:40]} ({len(json.dumps(value))})"] = {**right, name: value}, ""
        for what, (arguments, named) in calls.items():
            values = json.dumps({"tool": tool, "arguments": arguments})
            yield Case(f"agent, {tool}", what, ("call", CALLED, values), named=named)


def _without(values: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key != name}
