"""The agent server, by the SDK's own client: in this process and over stdio."""

import shutil
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import numpy as np
import pytest
from mcp import Client, StdioServerParameters, stdio_client

from nsdr import DataError, Event, Pipeline, Remove
from nsdr.apps.mcp import AgentTools, Change, make_server
from nsdr.cli.main import main
from nsdr.dynamics import StoredExplanation, simulate
from nsdr.pipeline import Perception
from nsdr.types import DynamicsPrediction, Rollout
from nsdr.world.world import CLEVRER_WORLD

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
NEXT = "What will happen next?"
TOOLS = ["ask", "perceive", "run_program", "simulate"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, short_video) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    (folder / "clips").mkdir()
    shutil.copy(short_video, folder / "clips" / "a.mp4")
    (folder.parent / "outside.mp4").write_bytes(b"secret")
    (folder / "linked.mp4").symlink_to(short_video)
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Any:
    return make_server(Pipeline.from_pretrained(), folder)


def call(server: Any, name: str, **arguments: Any) -> Any:
    async def go() -> Any:
        async with Client(server) as client:
            return await client.call_tool(name, arguments)

    return anyio.run(go)


def test_the_tools_say_what_they_take(server) -> None:
    async def go() -> Any:
        async with Client(server) as client:
            return client.instructions, (await client.list_tools()).tools

    instructions, tools = anyio.run(go)
    assert "clips/a.mp4" in instructions
    assert "Objects are 0.4 world units wide, such as the red metal cube, and start with up to 3 " in instructions
    assert sorted(tool.name for tool in tools) == TOOLS
    simulate = next(tool for tool in tools if tool.name == "simulate")
    change = simulate.input_schema["$defs"]["Change"]
    assert change["properties"]["kind"]["enum"] == ["remove", "set_mass", "set_velocity", "move", "freeze", "add"]
    assert "of which a frame is 0.028 s" in instructions  # not 1/25 s
    assert "simulated time" in change["description"]


def test_seeing_and_asking(server) -> None:
    scene = call(server, "perceive", video="clips/a.mp4").structured_content
    assert scene["n_frames"] == 48
    assert len(scene["objects"]) == len(set(scene["objects"])) > 2
    collisions = [e for e in scene["events"] if e["kind"] == "collision"]
    assert all(set(e["objects"]) <= set(scene["objects"]) and e["probability"] > 0.5 for e in collisions)
    count = call(server, "ask", video="clips/a.mp4", question="How many collisions happen?").structured_content
    assert count["answer"] == len(collisions)
    assert count["program"].startswith(f"count: {len(collisions)}")
    (short,) = scene["notes"]
    assert "48 frames" in short
    assert count["notes"] == [short]
    misspelt = call(server, "ask", video="clips/a.mp4", question="How many spheers are there?").structured_content
    assert misspelt["notes"] == [short, "read 'spheers' as 'spheres'"]
    removed = scene["objects"][0]
    what_if = call(
        server,
        "ask",
        video="clips/a.mp4",
        question=f"What will happen if the {removed} is removed?",
        choices=[f"The {scene['objects'][1]} collides with the {scene['objects'][2]}", "The moon rises"],
    ).structured_content
    assert what_if["choices"][0]["answer"] in ("correct", "wrong")
    assert what_if["choices"][1]["error"]
    assert call(server, "perceive", video="linked.mp4").structured_content["objects"] == scene["objects"]
    program = call(server, "run_program", video="clips/a.mp4", program="events objects filter_collision count")
    assert program.structured_content["answer"] == count["answer"]


def test_probabilities_that_a_backend_does_not_know_are_left_open(folder, small_scene) -> None:
    objects, shape = small_scene.objects[:3], (3, 5)
    hit, none = (
        Rollout(np.zeros((*shape, 2)), np.ones(shape, bool), events)
        for events in ((Event("collision", 2, (0, 1)),), ())
    )
    simulation = simulate(StoredExplanation(DynamicsPrediction(objects, 4, none, {2: hit})), [Remove(2)])
    pipeline: Any = SimpleNamespace(
        perceive=lambda path: Perception(None, None, None, small_scene), simulate=lambda *arguments: simulation
    )
    tools = AgentTools(pipeline, folder)
    seen = tools.perceive("linked.mp4")
    assert [e["probability"] for e in (*seen["events"], *seen["after_video"])] == [None] * 5
    assert {e["probability"] for e in tools.simulate("linked.mp4", [])["events"]} == {None}


def test_changing(server) -> None:
    names = call(server, "perceive", video="clips/a.mp4").structured_content["objects"]
    changes = [{"kind": "remove", "object": names[0]}]
    found = call(server, "simulate", video="clips/a.mp4", changes=changes).structured_content
    assert found["interventions"] == [f"without the {names[0]}"]
    assert not any(names[0] in e["objects"] for e in found["events"] if e["kind"] == "collision")
    assert any("48 frames" in note for note in found["notes"])


@pytest.mark.parametrize(
    ("tool", "arguments", "message"),
    [
        ("perceive", {"video": "../outside.mp4"}, "no video of the folder; it has clips/a.mp4"),
        ("perceive", {"video": "/etc/passwd"}, "no video of the folder"),
        ("perceive", {"video": "a\0b"}, "no video of the folder"),
        ("perceive", {"video": "a" * 5000}, "no video of the folder"),
        ("ask", {"video": "clips/a.mp4", "question": "Who won?"}, "unknown word 'won'"),
        ("run_program", {"video": "clips/a.mp4", "program": "objects counted"}, "counted"),
        ("simulate", {"video": "clips/a.mp4", "changes": [{"kind": "remove", "object": "unicorn"}]}, "unicorn"),
        (
            "simulate",
            {"video": "clips/a.mp4", "changes": [{"kind": "remove", "factor": 2}]},
            "takes object, not factor",
        ),
        ("simulate", {"video": "clips/a.mp4", "changes": [{"kind": "set_mass"}]}, "set_mass needs object, factor"),
        ("simulate", {"video": "clips/a.mp4", "changes": [{"kind": "freeze"}]}, "freeze needs object"),
        ("simulate", {"video": "clips/a.mp4", "changes": [{"kind": "explode"}]}, "explode"),
        ("perceive", {"video": "clips/a.mp4", "fps": 24}, "fps"),
        ("ask", {"video": "clips/a.mp4", "question": "How many collisions happen?", "choice": ["A"]}, "choice"),
        ("simulate", {"video": "clips/a.mp4", "changes": [{"kind": "freeze", "what": "red cube"}]}, "what"),
        ("ask", {"video": "clips/a.mp4", "question": "How many " * 60}, "at most 500 characters"),
        ("ask", {"video": "clips/a.mp4", "question": NEXT, "choices": ["It exits"] * 27}, "at most 26 choices"),
        ("ask", {"video": "clips/a.mp4", "question": NEXT, "choices": ["x" * 3001]}, "at most 3,000 characters"),
        ("run_program", {"video": "clips/a.mp4", "program": "objects " * 700}, "at most 5,000 characters"),
        (
            "run_program",
            {"video": "clips/a.mp4", "program": "unseen_events belong_to", "choice_programs": ["objects count"] * 27},
            "at most 26 choice programs",
        ),
    ],
)
def test_errors_are_messages(server, tool, arguments, message) -> None:
    result = call(server, tool, **arguments)
    assert result.is_error
    assert message in result.content[0].text


def test_errors_show_no_folders(server, folder) -> None:
    (folder / "broken.mp4").write_bytes(b"\0\0\0\x20ftypisom" + bytes(99))
    try:
        result = call(server, "perceive", video="broken.mp4")
    finally:
        (folder / "broken.mp4").unlink()
    assert result.is_error
    assert "broken.mp4: not a video" in result.content[0].text
    assert str(folder) not in result.content[0].text


def test_cancelled_calls_do_not_run(folder, small_scene) -> None:
    begun, may_end, seen = threading.Event(), threading.Event(), []

    def perceive(path: Path) -> Perception:
        seen.append(path)
        begun.set()
        assert may_end.wait(60)
        return Perception(None, None, None, small_scene)

    pipeline: Any = SimpleNamespace(perceive=perceive, world=CLEVRER_WORLD)
    server = make_server(pipeline, folder)

    async def go() -> None:
        async with Client(server) as client:

            async def look() -> None:
                await client.call_tool("perceive", {"video": "linked.mp4"})

            async with anyio.create_task_group() as first:
                first.start_soon(look)
                await anyio.to_thread.run_sync(begun.wait)
                async with anyio.create_task_group() as others:
                    for _ in range(8):
                        others.start_soon(look)
                    await anyio.wait_all_tasks_blocked()
                    others.cancel_scope.cancel()
                assert len(seen) == 1
                may_end.set()
            await look()

    anyio.run(go)
    assert len(seen) == 2


def test_over_stdio(folder) -> None:
    async def go() -> Any:
        command = [sys.executable, "-c", "from nsdr.cli import run; run()", "mcp", str(folder)]
        parameters = StdioServerParameters(command=command[0], args=command[1:], cwd=str(Path.cwd()))
        async with Client(stdio_client(parameters)) as client:
            return await client.call_tool("perceive", {"video": "nothing.mp4"})

    result = anyio.run(go)
    assert result.is_error
    assert "clips/a.mp4" in result.content[0].text


def test_bad_options_are_refused(tmp_path, capsys) -> None:
    with pytest.raises(DataError, match="takes object, factor, not speed"):
        Change("set_mass", "red cube", 2.0, speed=1.0).intervention()
    assert main(["mcp", str(tmp_path / "none")]) == 2
    assert "none: expected a folder of clips, found nothing" in capsys.readouterr().err
