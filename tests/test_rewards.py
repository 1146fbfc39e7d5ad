"""Rewards on completions as TRL passes them."""

import json
import re
from itertools import combinations
from pathlib import Path
from time import process_time
from typing import Any

import pytest

from nsdr import DataError, Scene, read_world, save
from nsdr.clevrer import read_questions, solution
from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.generate.export import reasoner
from nsdr.rewards import (
    SWIFT,
    answer_format,
    easyr1,
    evidence,
    exact,
    per_option,
    read_scene,
    verl,
    video_r1,
)  # fmt: skip

OPTIONS = ["the cube exits", "the sphere enters", "the cylinder enters"]
RIGHT = "<answer>A,C</answer>"


def columns(n: int) -> dict[str, list]:
    return {"solution": [RIGHT] * n, "options": [OPTIONS] * n, "prompts": ["?"] * n}


def evidence_columns(scene: Any, n: int = 1) -> dict[str, list]:
    """Columns of "How many cubes enter?", of which there is one in the example."""
    program = ["events", "objects", "cube", "filter_shape", "filter_in", "count"]
    row = {"solution": "<answer>1</answer>", "options": [], "program": program, "option_programs": [], "scene": scene}
    return {name: [value] * n for name, value in row.items()}


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


def test_answers_have_the_words_of_their_world(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_bytes(Path("configs/worlds/pucks.yaml").read_bytes())
    for world in (read_world("pucks"), "pucks", tmp_path / "mine.yaml"):
        assert exact(["It is a chip.", "<answer>cube</answer>"], ["<answer>chip</answer>"] * 2, [[], []], world) == [
            1,
            0,
        ]
        assert answer_format(["<answer>chip</answer>", "<answer>cube</answer>"], [[], []], world) == [1, 0]
    scores = verl("", "<answer>orange</answer>", "<answer>orange</answer>", {"options": []}, world="pucks")
    assert scores["score"] == scores["exact"] == 1
    with pytest.raises(DataError, match=r"<answer>chip</answer>.* or give the world of the answers"):
        exact(["chip"], ["<answer>chip</answer>"], [[]])


def test_messages_are_read_like_texts() -> None:
    texts = ["<answer>A,C</answer>", "<answer>B</answer>"]
    messages = [[{"role": "assistant", "content": text}] for text in texts]
    parts = [[{"role": "assistant", "content": [{"type": "text", "text": text}]}] for text in texts]
    for reward in (exact, per_option, answer_format):
        expected = reward(texts, **columns(2))
        assert reward(messages, **columns(2)) == reward(parts, **columns(2)) == expected
    text = "Frame 25: the purple cube enters.\n<answer>1</answer>"
    assert evidence([text, [{"role": "assistant", "content": text}]], **evidence_columns(TRUTH, 2)) == [1, 1]
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
    with pytest.raises(DataError, match=r"solution 'ruby': .*expected such as <answer>gray</answer>"):
        exact([""], ["ruby"], [[]])
    for name, value, message in (
        ("scene", None, r"column scene: has values that are null; expected .*nsdr export --scenes"),
        ("scene", 5, "column scene: expected paths, got 5"),
        ("program", None, "column program: has values that are null; expected programs"),
        ("program", 5, "expected programs of the question and its 0 options, got 5"),
        ("option_programs", 5, r"expected programs of the question and its 0 options, got \['events', .* and 5"),
        ("option_programs", [["objects"]], r"expected programs .* and \[\['objects'\]\]"),
    ):
        with pytest.raises(DataError, match=message):
            evidence([""], **(evidence_columns(TRUTH) | {name: [value]}))
    with pytest.raises(DataError, match="column solution: has values that are null"):
        exact(["", ""], ["<answer>red</answer>", None], [[], []])  # type: ignore[list-item]


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


@pytest.mark.parametrize(
    ("text", "right"),
    [
        (r"<think>A or B?</think><answer>A, C</answer>", 1),
        (r"So it is \boxed{A, C}", 1),
        (r"<think>A</think> \boxed{\text{A and C}}", 1),
        ("<answer>A.</answer>", 2 / 3),
        ("<answer>A. C.</answer>", 1),
        ("A.\nC.", 1),
        ("<answer>A. the cube exits\nC. the cylinder enters</answer>", 1),
        ("<answer>(A), (C)</answer>", 1),
        ("<answer>none</answer>", 1 / 3),
        ("<answer>A, D</answer>", 0),
        ("I do not know.", 0),
    ],
)
def test_every_framework_gives_the_same_reward(text: str, right: float) -> None:
    lettered = [f"{letter}. {option}" for letter, option in zip("ABC", OPTIONS, strict=True)]
    given = {"solution": [RIGHT], "options": [OPTIONS]}
    scores = verl(data_source="clevrer", solution_str=text, ground_truth=RIGHT, extra_info={"options": OPTIONS})
    truth = json.dumps({"solution": RIGHT, "options": OPTIONS})
    (overall,) = easyr1([{"response": text, "response_length": 9, "ground_truth": truth}])
    assert per_option([text], **given) == pytest.approx([right])
    assert scores["score"] == scores["per_option"] == overall["overall"] == pytest.approx(right)
    assert scores["exact"] == overall["exact"] == float(right == 1)
    assert video_r1([[{"role": "assistant", "content": text}]], [RIGHT], [lettered]) == pytest.approx([right])
    assert SWIFT["clevrer_per_option"](args=None)([text], **given, trainer_state=None) == pytest.approx([right])


def test_frameworks_choose_their_reward_by_name() -> None:
    text, info = "Frame 25: the purple cube enters.\n<answer>1</answer>", evidence_columns(str(TRUTH))
    row = {name: value[0] for name, value in info.items()}
    assert verl("", text, "<answer>1</answer>", row, reward="evidence")["score"] == 1
    assert verl("", "<answer>1</answer>", "<answer>1</answer>", row, reward="evidence")["score"] == 0
    assert verl("", text, "<answer>1</answer>", row, reward="exact")["score"] == 1
    assert SWIFT["clevrer_evidence"]()([text], **info) == [1]
    with pytest.raises(DataError, match="options: is missing in the row"):
        verl("", text, "<answer>1</answer>", {})
    with pytest.raises(DataError, match="ground_truth: "):
        easyr1([{"response": text, "ground_truth": "<answer>1</answer>"}])


@pytest.mark.parametrize(
    "unit", ["<answer>", "<think>", "</think>", r"\boxed{", "{", ".", "A. ", "I ", "answer: ", "```", "```["]
)
def test_rewards_read_any_text_in_linear_time(unit: str) -> None:
    """Four times the text takes about four times the processor's time; it would be 16 times if that were quadratic."""

    def seconds(length: int) -> float:
        text = "<answer>The" + unit * (length // len(unit)) + "red</answer>"
        started = process_time()
        per_option([text] * 2, [RIGHT] * 2, [OPTIONS] * 2)
        answer_format([text] * 2, [OPTIONS] * 2)
        return process_time() - started

    seconds(1000)
    long, short = (
        min(seconds(length) for _ in range(3)) for length in (96_000, 24_000)
    )  # once, memory may be collected
    assert long < 10 * short + 0.2


MOTION = "objects end get_frame filter_moving count"
COLLISIONS = "events objects filter_collision count"
FIRST = "Frame 20: the red cube and the blue sphere collide.\n"
BOTH = FIRST + "Frame 40: the blue sphere and the green cylinder collide.\n"
PAIR = "all_events objects {} unique filter_collision objects {} unique filter_collision unique"
CUBE, GREEN, BLUE = "cube filter_shape", "green filter_color", "blue filter_color"
RED_SPHERE = "red filter_color sphere filter_shape"
WITHOUT_BLUE = f"all_events objects {BLUE} unique get_counterfact belong_to"
NEW = "Without the blue sphere, the cube and the cylinder would collide.\n"
LATER = "After the video, the cylinder and the red sphere collide.\n"
BEFORE = "Frame 40: the blue sphere and the cylinder collide.\nFrame 10: the red sphere enters.\n"


@pytest.fixture
def earned(small_scene: Scene, tmp_path):
    """What a text earns with the answer to a program, and with a choice where there is one."""
    save(tmp_path / "scene.json", small_scene)

    def reward(text: str, program: str, answer: str, *choices: str) -> float | None:
        given = {
            "solution": [f"<answer>{answer}</answer>"],
            "options": [["it happens"] * len(choices)],
            "program": [program.split()],
            "option_programs": [[choice.split() for choice in choices]],
            "scene": [tmp_path / "scene.json"],
        }
        return evidence([f"{text}\n<answer>{answer}</answer>"], **given)[0]

    return reward


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        (BOTH, 1),
        (BOTH + "2 collisions happen in the video.", 1),
        ("At 0.8 s the cube hits the blue sphere.\nAt 1.6 s the blue sphere hits the cylinder.", 1),
        (FIRST, 2 / 3),
        ("1 collision happens before frame 30. 2 collisions happen in the video.", 0),
        # Without frames or objects.
        ("The cube hits the blue sphere. The cube hits the blue sphere after frame 2.", 0),
        ("Frame 20: an object hits an object.", 0),
        # Beside the point, said again, wrong, and taken back.
        (BOTH + "Frame 60: the blue sphere exits.", 4 / 5),
        (BOTH + "There is a red cube. The cube is metal. The red sphere does not exit.", 1),
        (BOTH + "After the video, the cube and the blue sphere do not collide.", 1),
        (3 * BOTH, 4 / 8),
        (BOTH + "The red sphere exits.", 4 / 5),
        (BOTH + "Frame 20: the red cube and the blue sphere do not collide.", 4 / 5),
        (BOTH + "Wait, that is wrong.", 2 / 3),
        ("Maybe the cube hits the blue sphere at frame 20.", 0),
        # A frame for every guess.
        ("".join(f"Frame {f}: the cube hits the blue sphere.\n" for f in range(2, 128, 3)), 2 / (2 + 42)),
    ],
)
def test_what_a_text_is_worth(earned, text: str, expected: float) -> None:
    assert earned(text, COLLISIONS, "2") == pytest.approx(expected)


def test_a_wrong_answer_has_no_evidence(small_scene: Scene, tmp_path) -> None:
    save(tmp_path / "scene.json", small_scene)
    row = {"solution": ["<answer>2</answer>"], "options": [[]], "program": [COLLISIONS], "option_programs": [[]]}
    assert evidence([f"{BOTH}<answer>3</answer>"], **row, scene=[tmp_path / "scene.json"]) == [0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (BOTH + NEW, 1),
        (BOTH, 4 / 5),
        (NEW, 0),
        ("The cube and the cylinder collide without the blue sphere.\n" + FIRST, 4 / 5),
        (BOTH + NEW + "Without the blue sphere, the cylinder and the red sphere would collide.", 6 / 7),
    ],
)
def test_a_what_if_rests_on_what_is_otherwise_in_the_video(earned, text: str, expected: float) -> None:
    assert earned(text, WITHOUT_BLUE, "A", PAIR.format(CUBE, GREEN)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "expected"), [(BEFORE + LATER, 1), (BEFORE, 4 / 5), (LATER, 0), ("The cylinder is stationary.", 0)]
)
def test_a_prediction_rests_on_what_happened_last(earned, text: str, expected: float) -> None:
    assert earned(text, "unseen_events belong_to", "A", PAIR.format(GREEN, RED_SPHERE)) == pytest.approx(expected)


def test_causes_count_with_their_frames(earned) -> None:
    question = f"events events objects {BLUE} unique filter_out unique filter_ancestor belong_to"
    told = f"{BOTH}Frame 60: the blue sphere exits.\n"
    cause = "The red cube is responsible for the exit of the blue sphere"
    assert earned(f"{told}{cause} at frame 60.", question, "A", f"objects {CUBE} unique") == 1
    assert earned(f"{told}{cause}.", question, "A", f"objects {CUBE} unique") == pytest.approx(6 / 7)
    assert earned(f"{cause}.", question, "A", f"objects {CUBE} unique") == 0


def test_motion_counts_at_its_frame(earned) -> None:
    assert earned("When the video ends, the red sphere is moving.", MOTION, "1") == 1
    assert earned("At 5.1 s the red sphere is moving.", MOTION, "1") == 1
    assert earned("Frame 60: the red sphere is moving. The red sphere moves in the video.", MOTION, "1") == 0


def test_a_question_that_nothing_seen_answers_has_no_reward(earned) -> None:
    assert earned("No cylinder enters.", "events objects cylinder filter_shape filter_in count", "0") is None
    assert earned(FIRST, COLLISIONS, "5") is None  # the scene gives 2
    assert earned(FIRST, f"objects {RED_SPHERE} unique end get_frame query_direction", "left") is None


def test_gaming_earns_less_than_reasons(example_scene: Scene) -> None:
    questions = read_questions(QUESTIONS)[0].questions
    columns: dict[str, list] = {
        "options": [[c.text for c in q.choices] for q in questions],
        "program": [q.program for q in questions],
        "option_programs": [[c.program for c in q.choices] for q in questions],
        "scene": [TRUTH] * len(questions),
    }
    right = [solution(q) for q in questions]
    wrong = ["<answer>none</answer>" if q.choices else "<answer>7</answer>" for q in questions]
    tell = reasoner(example_scene, "short")
    told = [str(tell(q)).removesuffix(answer) for q, answer in zip(questions, right, strict=True)]

    def mean(texts: list[str], answers: list[str] = right) -> float:
        rewards = evidence([t + a for t, a in zip(texts, answers, strict=True)], solution=right, **columns)
        return sum(rewards) / len(rewards)  # none is None

    def always(*sentences: str) -> list[str]:
        return ["\n".join(sentences) + "\n"] * len(questions)

    verbs = {"in": "enters", "out": "exits", "collision": "collide"}
    objects = [f"the {o.name}" for o in example_scene.objects]
    seen = [(e, " and ".join(objects[i] for i in e.objects)) for e in example_scene.events]
    facts = [f"Frame {e.frame}: {who} {verbs[e.kind]}." for e, who in seen]
    opposite = {"collide.": "do not collide.", "enters.": "does not enter.", " led to ": " did not lead to "}
    copied = [[f"{start}{c.text}." for c in q.choices for start in ("", "After the video, ")] for q in questions]
    gaming = {
        "one safe fact": always(facts[0]),
        "all observed facts": always(*facts),
        "facts of another question": told[1:] + told[:1],
        "shuffled frames": [re.sub(r"(?<=rame )\d+", lambda f: str((int(f[0]) + 40) % 128), t) for t in told],
        "repetition": [t * 10 for t in told],
        "contradictions": [t + re.sub("|".join(map(re.escape, opposite)), lambda f: opposite[f[0]], t) for t in told],
    }
    blind = {
        "copied question": [f"{q.text}\n" + "\n".join([*c, ""]) for q, c in zip(questions, copied, strict=True)],
        "negations": always(*(f"After the video, {a} and {b} do not collide." for a, b in combinations(objects, 2))),
        "motion": always(*(f"{o} moves in the video." for o in objects)),
        "one sentence": always("1 collision happens before frame 50."),
        "empty": always(),
    }
    assert mean(told) == 1
    assert mean(told, wrong) == 0
    for name, texts in gaming.items():
        assert mean(texts) <= 0.7, name
    for name, texts in blind.items():
        assert mean(texts) <= 0.15, name


def test_scenes_are_read_from_each_kind_of_file(tmp_path, example_scene: Scene) -> None:
    save(tmp_path / "scene.json", example_scene)
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
    text = "Frame 3: the cube enters.\n<answer>1</answer>"
    paths = [tmp_path / "annotation.json", tmp_path / "truth.json", tmp_path / "scene.json"]
    assert [evidence([text], **evidence_columns(path))[0] for path in paths] == [1, 1, 0]
    assert read_scene(str(tmp_path / "annotation.json")).predicted is None
    assert len(read_scene(str(TRUTH)).objects) == len(example_scene.objects)
    with pytest.raises(DataError, match=r"other\.json: .*`scene_index`"):
        evidence([text], **evidence_columns(tmp_path / "other.json"))
    (tmp_path / "broken.json").write_text(json.dumps({**truth, "frames": []}))
    with pytest.raises(DataError, match=r"broken\.json: frames"):
        evidence([text], **evidence_columns(tmp_path / "broken.json"))
    (tmp_path / "number.json").write_text(json.dumps({**annotation, "motion_trajectory": 5}))
    with pytest.raises(DataError, match=r"number\.json: .*motion_trajectory`"):
        evidence([text], **evidence_columns(tmp_path / "number.json"))
    (tmp_path / "part.json").write_text(json.dumps({"type": "Scene"}))
    with pytest.raises(DataError) as refused:
        evidence([text], **evidence_columns(tmp_path / "part.json"))
    assert str(refused.value).count("part.json") == 1


def test_messages_without_text_are_empty_answers() -> None:
    for message in ({"role": "assistant", "tool_calls": []}, {"content": ["x", {"type": "text"}]}, {"content": None}):
        assert exact([[message]], solution=["<answer>red</answer>"], options=[[]]) == [0.0]
