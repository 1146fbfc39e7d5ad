"""Rewards on completions as TRL passes them."""

import json
from typing import Any

import pytest

from nsdr import DataError, Scene, narrate, save, verify
from nsdr.clevrer.example import TRUTH
from nsdr.rewards import MAX_OF_A_KIND, answer_format, exact, per_option, read_scene, trace_score, trace_verified
from nsdr.symbolic import Executor

OPTIONS = ["the cube exits", "the sphere enters", "the cylinder enters"]
RIGHT = "<answer>A,C</answer>"


def columns(n: int) -> dict[str, list]:
    return {"solution": [RIGHT] * n, "options": [OPTIONS] * n, "scene": [str(TRUTH)] * n, "prompts": ["?"] * n}


def test_answers_are_compared_as_a_whole_and_by_option() -> None:
    completions = ["<answer>A,C</answer>", "So it is A.\n<answer>C, A</answer>", "<answer>A</answer>", "no idea", ""]
    completions += ["<answer>none</answer>", "<answer>B</answer>"]
    given = columns(len(completions))
    assert exact(completions, **given) == [1, 1, 0, 0, 0, 0, 0]
    assert per_option(completions, **given) == pytest.approx([1, 1, 2 / 3, 0, 0, 1 / 3, 0])


def test_open_questions_have_words() -> None:
    completions = ["<answer>red</answer>", "<answer>blue</answer>", "<answer>A</answer>"]
    given = {"solution": ["<answer>red</answer>"] * 3, "options": [[]] * 3}
    assert exact(completions, **given) == per_option(completions, **given) == [1, 0, 0]


def test_messages_are_read_like_texts() -> None:
    texts = ["<answer>A,C</answer>", "<answer>B</answer>"]
    messages = [[{"role": "assistant", "content": text}] for text in texts]
    parts = [[{"role": "assistant", "content": [{"type": "text", "text": text}]}] for text in texts]
    for reward in (exact, per_option, answer_format, trace_verified):
        expected = reward(texts, **columns(2))
        assert reward(messages, **columns(2)) == reward(parts, **columns(2)) == expected
    assert exact([[]], **columns(1)) == [0]


def test_the_form_is_one_pair_of_tags_at_the_end() -> None:
    completions = ["I think so.\n<answer>B</answer>\n", "<answer>B</answer> or so", "B", "<answer>Z</answer>"]
    completions += ["<answer>A</answer> <answer>B</answer>", "<answer>A <answer>B</answer>"]
    completions += ["<answer>A</answer> or so</answer>", "<Answer>A</Answer> <answer>B</answer>"]
    completions += ["<answers>A</answers> <answer>B</answer>", "A</answer> <answer>B</answer>"]
    assert answer_format(completions, **columns(len(completions))) == [1] + 9 * [0]


def test_wrong_columns_are_refused() -> None:
    with pytest.raises(DataError, match="column solution: expected 2 values, one per completion, got 1"):
        exact(["", ""], ["<answer>red</answer>"], [[], []])
    with pytest.raises(DataError, match=r"solution 'ruby': .*expected such as <answer>red</answer>"):
        exact([""], ["ruby"], [[]])
    with pytest.raises(DataError, match="column scene: expected 1 values"):
        trace_verified([""], [])
    with pytest.raises(DataError, match=r"column scene: has values that are null; expected .*nsdr export --scenes"):
        trace_verified([""], [None])  # type: ignore[list-item]
    with pytest.raises(DataError, match="column solution: has values that are null"):
        exact(["", ""], ["<answer>red</answer>", None], [[], []])  # type: ignore[list-item]
    with pytest.raises(DataError, match="column scene: expected paths, got 5"):
        trace_verified([""], [5])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"solution": [5]}, "column solution: expected texts, got 5"),
        ({"options": [5.0]}, "column options: expected lists of texts"),
        ({"options": ["ab"]}, "column options: expected lists of texts"),
        ({"options": [[1, 2]]}, "column options: expected lists of texts"),
        ({"options": [3]}, "column options: expected lists of texts, got 3"),
        ({"completions": [5]}, "completions: expected texts or lists of messages, got 5"),
        ({"completions": [[None]]}, "completions: expected texts or lists of messages"),
        ({"completions": [[{"content": 5}]]}, "a message's content, got 5"),
    ],
)
def test_wrong_values_of_columns_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        exact(**({"completions": [""], "solution": ["<answer>red</answer>"], "options": [[]]} | changes))


def score(text: str, scene: Scene) -> float:
    return trace_score(verify(text, scene))


def test_narrated_answers_have_full_score(small_scene: Scene) -> None:
    executor = Executor(small_scene)
    for program in ("events objects filter_collision count", "objects end get_frame filter_moving exist"):
        for length in ("short", "long"):
            assert score(narrate(executor.answer(program.split()), small_scene, length), small_scene) == 1


EVENT = "Frame 20: the red cube and the blue sphere collide.\n"
WRONG = "The red sphere exits.\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("The video is nice.", 0),
        (EVENT, 1),
        (EVENT + WRONG, 1 / 2),
        (WRONG, 0),
        ("It exits.", 0),
        (EVENT + "It exits.", 1),
        # The same fact in other words, at other frames, or without one.
        (4 * EVENT + "Frame 21: the blue sphere and the cube collide. The cube hits the blue sphere. " + WRONG, 1 / 2),
        # A frame for every guess.
        ("".join(f"Frame {f}: the blue sphere exits.\n" for f in (10, 20, 30, 60)), 1 / 4),
        # What is easily said.
        ("There is a red cube. The red cube is red. There are 4 objects.", 0),
        (EVENT + WRONG + "There is a red cube. The red cube is metal. There are 4 objects.", 1 / 2),
        (EVENT + "The red cube is rubber.", 1 / 2),
        (EVENT + WRONG + "Frame 3: the cube does not enter. Frame 4: the cube does not exit.", 1 / 2),
        # Denials count at most as often as what is asserted.
        (
            EVENT + WRONG + "The cube does not exit. The cube does not enter. The red sphere does not hit the cube.",
            2 / 3,
        ),
        # The same event before or after a frame, or of unnamed objects.
        (EVENT + "The cube hits the blue sphere after frame 2. The cube hits an object. " + WRONG, 1 / 2),
        # Events of no particular object, and none of what is not there.
        ("An object hits an object. An object exits. An object enters after frame 0.", 0),
        ("The first collision is between an object and a thing. After the video, an object hits an object.", 0),
        ("An object enters before an object exits.", 0),
        ("No purple cube enters. Frame 3: no purple cube is moving. 0 purple cubes never move.", 0),
        ("No cylinder enters.", 1),
        ("The cube does not exit. The purple cube does not exit. The cube and the cylinder do not collide.", 0),
        ("After the video, the cube and the cylinder do not collide.", 1),
        ("Frame 20: an object hits an object.", 1),
        # Each object that is not there, and each one that is removed.
        (EVENT + "The purple cube exits. The gray cube exits. The gray cube hits the purple cube.", 1 / 4),
        (
            EVENT + "Without the cube, the blue sphere would hit the cylinder.\n"
            "Without the cylinder, the blue sphere would not hit the cube.\n"
            "Without the blue sphere, the cylinder would not hit the cube.",
            1 / 4,
        ),
    ],
)
def test_what_a_text_is_worth(small_scene: Scene, text: str, expected: float) -> None:
    assert score(text, small_scene) == pytest.approx(expected)


def test_facts_of_a_kind_are_limited(small_scene: Scene) -> None:
    events = (
        "the red sphere enters",
        "the cube hits the blue sphere",
        "the blue sphere hits the cylinder",
        "the blue sphere exits",
    )
    text = ".\n".join(f"{a} before {b}" for i, a in enumerate(events) for b in events[i + 1 :])
    text += ".\n" + ".\n".join(f"{b} after {a}" for i, a in enumerate(events) for b in events[i + 1 :])
    assert all(c.holds for c in verify(text, small_scene).claims)
    assert len(verify(text, small_scene).claims) == 12
    assert score(text + ".\n" + WRONG, small_scene) == pytest.approx(MAX_OF_A_KIND / (MAX_OF_A_KIND + 1))


def test_scenes_are_read_from_each_kind_of_file(tmp_path, example_scene: Scene) -> None:
    save(example_scene, tmp_path / "scene.json")
    frames = [
        {
            "frame_id": f,
            "objects": [
                {
                    "object_id": 0,
                    "location": [0, 0, 0.2],
                    "orientation": [0, 0, 0],
                    "velocity": [0, 0, 0],
                    "angular_velocity": [0, 0, 0],
                    "inside_camera_view": f > 2,
                }
            ],
        }
        for f in range(128)
    ]
    thing = {"object_id": 0, "color": "red", "material": "metal", "shape": "cube"}
    named = {"scene_index": 1, "seed": 0, "video_filename": "v.mp4"}
    annotation = {**named, "object_property": [thing], "motion_trajectory": frames, "collision": []}
    truth = {**named, "objects": [thing], "frames": frames, "collisions": [], "counterfactual": {}}
    for name, content in (("annotation", annotation), ("truth", truth), ("other", {"a": 1})):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    text = "Frame 3: the cube enters."
    paths = [tmp_path / "annotation.json", tmp_path / "truth.json", tmp_path / "scene.json"]
    assert trace_verified([text] * 3, paths) == [1, 1, 0]
    assert read_scene(str(tmp_path / "annotation.json")).unseen is None
    assert len(read_scene(str(TRUTH)).objects) == len(example_scene.objects)
    with pytest.raises(DataError, match=r"other\.json: missing key 'scene_index'"):
        trace_verified([text], [tmp_path / "other.json"])
    (tmp_path / "broken.json").write_text(json.dumps({**truth, "frames": []}))
    with pytest.raises(DataError, match=r"broken\.json: frames"):
        trace_verified([text], [tmp_path / "broken.json"])
    (tmp_path / "number.json").write_text(json.dumps({**annotation, "motion_trajectory": 5}))
    with pytest.raises(DataError, match=r"number\.json: .*motion_trajectory: expected a list, got 5"):
        trace_verified([text], [tmp_path / "number.json"])
    (tmp_path / "part.json").write_text(json.dumps({"type": "Scene"}))
    with pytest.raises(DataError) as refused:
        trace_verified([text], [tmp_path / "part.json"])
    assert str(refused.value).count("part.json") == 1


@pytest.mark.parametrize(
    "text",
    [
        "Without the red cube, the red cube and the blue sphere do not collide.",
        "The red cube is responsible for the collision of the red cube and the blue sphere.",
    ],
)
def test_what_is_true_by_its_words_earns_nothing(text: str, small_scene: Scene) -> None:
    claims = verify(text, small_scene)
    assert [c.holds for c in claims.claims] == [True]
    assert trace_score(claims) == 0


def test_messages_without_text_are_empty_answers() -> None:
    for message in ({"role": "assistant", "tool_calls": []}, {"content": ["x", {"type": "text"}]}, {"content": None}):
        assert exact([[message]], solution=["<answer>red</answer>"], options=[[]]) == [0.0]
