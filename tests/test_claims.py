"""Narrated answers, claims of texts, and whether they hold."""

import contextlib
import io
import random
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from nsdr import Answer, DataError, Event, ExecutionError, Scene, SceneObject, narrate, verify
from nsdr.claims.reading import read_sentence, written
from nsdr.claims.verification import TOLERANCE_FRAMES
from nsdr.generate.questions.candidates import descriptive_questions, multiple_choice_questions
from nsdr.symbolic import Executor
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

COLORS, MATERIALS, SHAPES = CLEVRER.words.values()
FPS = CLEVRER_WORLD.timeline.fps
N_FRAMES = 30


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Scenes of 3 to 5 objects with everything known; objects may enter and exit twice, and pairs collide twice."""
    rng = draw(st.randoms(use_true_random=False))
    n = rng.randint(3, 5)
    triples = rng.sample([(c, m, s) for c in COLORS[:3] for m in MATERIALS for s in SHAPES], n)
    objects = tuple(SceneObject(i, *t) for i, t in enumerate(triples))
    visible, moving = np.ones((n, N_FRAMES), bool), np.zeros((n, N_FRAMES), bool)
    events = []
    for i in range(n):
        for kind, first in (("in", 2), ("out", 12), ("in", 20)):
            if rng.random() < 0.4 and (kind, bool(visible[i, first - 1])) != ("in", first == 2):
                frame = rng.randrange(first, first + 6)
                visible[i, :frame] &= kind == "out"
                visible[i, frame:] = kind == "in"
                events.append(Event(kind, frame, (i,)))
        moving[i, rng.randrange(N_FRAMES) : rng.randrange(N_FRAMES)] = True

    def collisions(first: int, last: int, without: int = -1) -> tuple[Event, ...]:
        pairs = [tuple(sorted(rng.sample(range(n), 2))) for _ in range(rng.randint(0, 4))]
        frames = range(first, last + 1, 2)  # so far apart that the tolerance tells collisions of a pair apart
        return tuple({Event("collision", rng.choice(frames), p): None for p in pairs if without not in p})

    predicted = collisions(N_FRAMES, N_FRAMES + 9)
    counterfactual = {i: collisions(0, N_FRAMES + 9, i) for i in range(n)}
    events += collisions(0, N_FRAMES - 1)
    return Scene(objects, N_FRAMES, visible, moving, tuple(events), predicted, counterfactual)


def answers(scene: Scene, seed: int, n: int) -> list[Answer]:
    """Answers to random questions of all types about a scene."""
    rng, executor = random.Random(seed), Executor(scene)
    open_ones = list(descriptive_questions(scene, rng))
    found = [executor.answer(d.program, d.text) for d in rng.sample(open_ones, min(n, len(open_ones)))]
    multiple = list(multiple_choice_questions(scene, rng))
    for m in rng.sample(multiple, min(n, len(multiple))):
        found.append(executor.answer_choices(m.program, [(o.text, o.program) for o in m.choices], m.text))
    return found


@settings(max_examples=5, deadline=None)
@given(scenes(), st.integers(0, 999), st.sampled_from(["short", "long"]))
def test_every_narrated_sentence_is_read_back_and_holds(scene: Scene, seed: int, length: str) -> None:
    for answer in answers(scene, seed, 30):
        text = narrate(answer, scene, length)
        found = verify(text, scene)
        sentences = text.splitlines()[:-1]
        assert sentences, answer.question
        assert [c.text for c in found.claims] == sentences, answer.question
        assert [(c.text, c.reason) for c in found.claims if not c.holds] == [], answer.question
        assert found.skipped == ()


def told(executor: Executor, program: str, choice: str = "", length: str = "short") -> list[str]:
    if not choice:
        return narrate(executor.answer(program.split()), executor.scene, length).splitlines()
    return narrate(
        executor.answer_choices(program.split(), [("", choice.split())]), executor.scene, length
    ).splitlines()


PAIR = "all_events objects {} unique filter_collision objects {} unique filter_collision unique"
RED_CUBE, GREEN, BLUE = "cube filter_shape", "green filter_color", "blue filter_color"


def test_a_count_is_told_with_its_events_and_boundary(executor: Executor) -> None:
    before = "events events objects blue filter_color unique filter_out unique filter_before"
    assert told(executor, f"{before} objects filter_collision count") == [
        "Frame 20: the red cube and the blue sphere collide.",
        "Frame 40: the blue sphere and the green cylinder collide.",
        "Frame 60: the blue sphere exits.",
        "2 collisions happen before frame 60.",
        "<answer>2</answer>",
    ]
    assert told(executor, "objects end get_frame filter_moving exist") == [
        "Frame 127: the red sphere is moving.",
        "Frame 127: 1 object is moving.",
        "<answer>yes</answer>",
    ]


def test_a_query_names_the_object_without_what_is_asked(executor: Executor) -> None:
    program = "events objects filter_in unique get_object query_shape"
    assert told(executor, program) == [
        "Frame 10: the red sphere enters.",
        "The shape of the red rubber object is sphere.",
        "<answer>sphere</answer>",
    ]


def test_a_chain_of_causes(executor: Executor) -> None:
    target = "events events objects blue filter_color unique filter_out unique filter_ancestor belong_to"
    choice = "events objects cube filter_shape unique filter_collision unique"
    assert told(executor, target, choice, "long")[-4:] == [
        "The collision of the red cube and the blue sphere at frame 20 led to the collision of the blue sphere and the green "
        "cylinder at frame 40.",
        "The collision of the blue sphere and the green cylinder at frame 40 led to the exit of the blue sphere at frame 60.",
        "The collision of the red cube and the blue sphere at frame 20 led to the exit of the blue sphere at frame 60.",
        "<answer>A</answer>",
    ]
    entered = "events objects sphere filter_shape red filter_color unique filter_in unique"
    assert told(executor, target, entered)[-2:] == [
        "The entrance of the red sphere at frame 10 did not lead to the exit of the blue sphere at frame 60.",
        "<answer>none</answer>",
    ]
    assert told(executor, target, "objects cube filter_shape unique")[-2] == (
        "The red cube is responsible for the exit of the blue sphere at frame 60."
    )


def test_what_is_not_seen_is_told(executor: Executor) -> None:
    choice = PAIR.format(RED_CUBE, GREEN)
    without = "all_events objects blue filter_color unique get_counterfact belong_to negate"
    assert told(executor, without, choice) == [
        "Frame 20: the red cube and the blue sphere collide.",
        "Frame 40: the blue sphere and the green cylinder collide.",
        "Without the blue sphere, the red cube and the green cylinder would collide.",
        "<answer>none</answer>",
    ]
    assert told(executor, "unseen_events belong_to", choice) == [
        "After the video, the green cylinder and the red sphere collide.",
        "After the video, the red cube and the green cylinder do not collide.",
        "<answer>none</answer>",
    ]
    assert told(executor, "unseen_events belong_to", PAIR.format(GREEN, "sphere filter_shape red filter_color")) == [
        "Frame 10: the red sphere enters.",
        "Frame 40: the blue sphere and the green cylinder collide.",
        "After the video, the green cylinder and the red sphere collide.",
        "<answer>A</answer>",
    ]


def test_narrate_refuses_what_it_cannot_tell(executor: Executor) -> None:
    answer = executor.answer(["objects", "count"])
    with pytest.raises(ExecutionError, match="length 'huge': expected short or long"):
        narrate(answer, executor.scene, "huge")
    with pytest.raises(ExecutionError, match="no trace"):
        narrate(replace(answer, trace=()), executor.scene)


HOLDS = [
    ("Frame 20: the red cube and the blue sphere collide.", "collision"),
    ("At frame 21, the cube hits the blue ball.", "collision"),
    ("The blue sphere is hit by the red cube around frame 19.", "collision"),
    ("Then the red sphere enters the scene at frame 10 and never hits the cube.", "entrance"),
    ("The blue sphere leaves the video (frame 60).", "exit"),
    ("At 0.8 s the cube hits the blue sphere.", "collision"),
    ("1.62 s: the blue sphere and the cylinder collide.", "collision"),
    ("The blue sphere exits (2.4 seconds).", "exit"),
    ("No collision happens before 0.7s.", "count"),
    ("The red sphere is moving at 5.1 s.", "motion"),
    ("The red sphere doesn't exit.", "exit"),
    ("There is no collision between the cube and the cylinder.", "collision"),
    ("There is a blue rubber sphere.", "presence"),
    ("There are two spheres.", "presence"),
    ("2 collisions happen in the video.", "count"),
    ("No collision happens before frame 19.", "count"),
    ("1 collision of the red cube happens.", "count"),
    ("Frame 30: 3 objects are moving.", "count"),
    ("The color of the cube is red.", "attribute"),
    ("The cylinder is made of rubber.", "attribute"),
    ("The red cube is not a sphere.", "attribute"),
    ("The red sphere enters before the blue sphere exits.", "order"),
    ("The collision of the cube and the blue sphere happens before the blue sphere's exit.", "order"),
    ("After the red sphere enters, the red cube hits the blue sphere.", "order"),
    ("The last collision is between the blue sphere and the cylinder.", "order"),
    ("The second object to collide with the blue sphere is the cylinder.", "order"),
    ("The cylinder is stationary at frame 30.", "motion"),
    ("The red cube is moving when the video begins.", "motion"),
    ("The cylinder never moves.", "motion"),
    ("After the video ends, the cylinder and the red sphere will collide.", "future"),
    ("Without the blue sphere, the cube would hit the cylinder.", "counterfactual"),
    ("If the red cube is removed, the blue sphere and the cylinder will not collide.", "counterfactual"),
    ("Without the blue sphere, the collision of the cube and the cylinder would happen.", "counterfactual"),
    ("The collision of the cube and the blue sphere caused the exit of the blue sphere.", "cause"),
    ("The presence of the red cube led to the exit of the blue sphere.", "cause"),
    ("The red sphere is not responsible for the exit of the blue sphere.", "cause"),
]


@pytest.mark.parametrize(("text", "kind"), HOLDS)
def test_what_holds(small_scene: Scene, text: str, kind: str) -> None:
    found = verify(text, small_scene)
    assert found.skipped == ()
    assert found.claims[0].kind == kind
    assert [(c.holds, c.reason) for c in found.claims] == [(True, "")] * len(found.claims)
    assert (found.claims[0].start, found.claims[0].end) == (0, len(text))


FAILS = [
    ("Frame 23: the red cube and the blue sphere collide.", "it happens at frame 20, not at frame 23"),
    ("The collision of the cube and the blue sphere at frame 90 happens.", "it happens at frame 20, not at frame 90"),
    ("At 0.9 s the red cube and the blue sphere collide.", "it happens at frame 20, not at frame 22"),
    ("The cube and the cylinder collide.", "it does not happen"),
    ("The purple cube enters.", "no object of the video fits 'the purple cube'"),
    ("The red sphere exits.", "it does not happen"),
    ("There are three cubes.", "there are 1"),
    ("Frame 30: 2 objects are moving.", "there are 3"),
    ("The cube is blue.", "it is a red metal cube"),
    ("The red sphere enters after the blue sphere exits.", "the first is at frame 10, the second at frame 60"),
    ("The cylinder is moving at frame 30.", "it is not moving then"),
    ("The cube is moving at frame 200.", "the video ends at frame 127"),
    ("After the video, the cube and the cylinder collide.", "it does not happen"),
    ("Without the red cube, the blue sphere would hit the cylinder.", "it does not happen"),
    ("The red sphere's entrance led to the exit of the blue sphere.", "it is not among what led to it"),
]


@pytest.mark.parametrize(("text", "reason"), FAILS)
def test_what_fails(small_scene: Scene, text: str, reason: str) -> None:
    found = verify(text, small_scene)
    assert [(c.holds, c.reason) for c in found.claims] == [(False, reason)]


@pytest.mark.parametrize("text", [text for text, _ in (*HOLDS, *FAILS)])
def test_what_is_read_is_written_and_read_back(small_scene: Scene, text: str) -> None:
    found = verify(text, small_scene)
    again = verify(" ".join(written(claim.statement, CLEVRER) for claim in found.claims), small_scene)
    assert [(c.kind, c.holds, c.objects, c.frame) for c in again.claims] == [
        (c.kind, c.holds, c.objects, c.frame) for c in found.claims
    ]


UNREAD = [
    "The red sphere enters at frame 3 before frame 40.",
    "The collision of the red cube and the blue sphere at frame 90 happens at frame 20.",
    "Maybe the red sphere enters.",
    "The red cube almost hits the cylinder.",
    "It is not true that the red sphere enters.",
    "The red cube would hit the cylinder.",
    "The red cube will hit the cylinder.",
    "Does the red sphere enter?",
    "A. The red cube and the cylinder collide",
    "- (B) The red cube and the cylinder collide",
    "Option C: the cylinder enters the scene",
    "Option A says the red sphere exits.",
    "The red cube hits the cylinder or the red sphere.",
    "The cylinder that the red cube hits exits.",
    "Neither the cube nor the cylinder collide.",
    "The cubes collide.",
    "Frames 10-20: the cube and the cylinder collide.",
    "From frame 10 the cylinder is moving.",
    "Between 0.4 s and 0.8 s the red sphere enters.",
    "At 0.3-0.5 s the red sphere enters.",
    "During 2 s the red sphere is moving.",
    "2 seconds later the blue sphere exits.",
    "The cube hits the cylinder and the red sphere enters without the blue sphere.",
    "<answer>The red cube and the cylinder collide</answer>",
    "The red sphere enters at frame 10 " + 20 * "and the red sphere enters " + "at frame 10.",
]


@pytest.mark.parametrize("text", UNREAD)
def test_what_is_not_read_is_skipped_and_counted(small_scene: Scene, text: str) -> None:
    found = verify(text, small_scene)
    assert not found.claims
    assert (len(found.skipped) > 0) == (not text.startswith("<answer>"))


def test_times_in_tenths_of_a_second_are_frames_within_the_tolerance() -> None:
    for frame in range(128):
        (said,) = read_sentence(f"At {frame / FPS:.1f} s the cube enters", 127, CLEVRER, FPS)
        assert abs(said.events[0].frame - frame) <= TOLERANCE_FRAMES
        (said,) = read_sentence(f"At {frame / FPS:.2f} s the cube enters", 127, CLEVRER, FPS)
        assert said.events[0].frame == frame


UNDECIDED = [
    ("The sphere exits.", "'the sphere' fits 2 objects"),
    ("It exits.", "'it' does not say which object is meant"),
    ("The purple cube does not exit.", "no object of the video fits 'the purple cube'"),
    ("The cube does not hit a sphere.", "'a sphere' in a denied sentence may mean any or a particular object"),
    ("The cube is moving.", "it moves and rests, and no frame is given"),
    ("Without the cube, the red sphere would enter.", "only collisions are known without an object"),
    (
        "Frame 21: the red cube and the blue sphere do not collide.",
        "it happens at frame 20, which is within the tolerance",
    ),
    ("The blue sphere exits. Wait, that is wrong.", "the next sentence takes it back"),
    ("The blue sphere exits. No.", "the next sentence takes it back"),
    ("The red cube and the blue sphere collide. Not really.", "the next sentence takes it back"),
    ("The cube and the cylinder collide. They do not.", "the next sentence takes it back"),
    ("The cube and the cylinder collide. There was no such collision.", "the next sentence takes it back"),
    (
        "Suppose the cube is removed. The cube and the cylinder collide.",
        "a sentence before it may open another course of events",
    ),
    ("If the cube is removed:\n- the red sphere exits", "a sentence before it may open another course of events"),
    ("Take the cube away. The red sphere exits.", "a sentence before it may open another course of events"),
    ("Ignoring the cube:\n- the red sphere exits", "a sentence before it may open another course of events"),
    ("The cube does not exist. The red sphere exits.", "a sentence before it may open another course of events"),
]


@pytest.mark.parametrize(("text", "reason"), UNDECIDED)
def test_what_cannot_be_checked(small_scene: Scene, text: str, reason: str) -> None:
    found = verify(text, small_scene)
    assert [(c.holds, c.reason) for c in found.claims] == [(None, reason)]


def test_what_a_scene_does_not_know_cannot_be_checked(small_scene: Scene) -> None:
    poor = replace(small_scene, moving=None, predicted=None, counterfactual=None)
    text = "The cube never moves.\nAfter the video, 2 collisions happen.\nWithout the cube, the spheres would collide."
    text = text.replace("the spheres", "the cylinder and the red sphere")
    assert [c.holds for c in verify(text, poor).claims] == [None, None, None]
    assert [c.holds for c in verify(text, small_scene).claims] == [False, False, True]


def test_a_blank_line_ends_another_course_of_events(small_scene: Scene) -> None:
    text = "Suppose the cube is removed.\nThe red sphere exits.\n\nThe red sphere exits."
    assert [c.holds for c in verify(text, small_scene).claims] == [None, False]


def test_claims_have_spans_objects_and_frames_in_long_texts(small_scene: Scene) -> None:
    text = (
        "<think>Let me look.\n1. First, the **red sphere** enters at frame 10.\n"
        "2. The cube hits the blue ball at frame 20 and the blue ball exits at frame 60, so the answer is 2.</think>\n"
        "<answer>2</answer>"
    )
    found = verify(text, small_scene)
    assert [(c.kind, c.objects, c.frame, c.holds) for c in found.claims] == [
        ("entrance", (3,), 10, True),
        ("collision", (0, 1), 20, True),
        ("exit", (1,), 60, True),
    ]
    assert text[found.claims[0].start : found.claims[0].end] == "First, the **red sphere** enters at frame 10."
    assert [text[a:b] for a, b in found.skipped] == ["Let me look."]
    assert found.claims[0].event == Event("in", 10, (3,))


def test_texts_and_tolerances_are_checked(small_scene: Scene) -> None:
    with pytest.raises(DataError, match=r"verify\.text: expected a text, got None"):
        verify(None, small_scene)  # type: ignore[arg-type]
    for tolerance in (-1, 0.5, "x"):
        with pytest.raises(DataError, match="tolerance_frames"):
            verify("", small_scene, tolerance)  # type: ignore[arg-type]


def test_the_tolerance_is_an_argument(small_scene: Scene) -> None:
    text = "Frame 22: the red cube and the blue sphere collide."
    assert [verify(text, small_scene, t).claims[0].holds for t in (0, 1, 2)] == [False, False, True]


def test_a_sentence_of_several_worlds_is_not_read() -> None:
    assert read_sentence("The cube exits and the cube hits the sphere without the cylinder", 127, CLEVRER, FPS) == ()
    assert (
        len(
            read_sentence(
                "Without the cylinder, the cube hits the sphere and the sphere hits the cone", 127, CLEVRER, FPS
            )
        )
        == 0
    )
    assert (
        len(
            read_sentence(
                "Without the cylinder, the cube hits the sphere and the sphere hits the ball", 127, CLEVRER, FPS
            )
        )
        == 2
    )


def test_the_page_shows_what_its_code_prints() -> None:
    page = (Path(__file__).parent.parent / "docs" / "claims.md").read_text()
    names: dict[str, object] = {}
    shown = 0
    for code, output in re.findall(r"```python\n(.*?)```(?:[^`]*```text\n(.*?)```)?", page, re.DOTALL):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(code, names)
        if output:
            assert printed.getvalue() == output
            shown += 1
    assert shown == 2


def with_events(scene: Scene, *events: Event) -> Scene:
    return replace(scene, events=events)


def test_a_scene_without_collisions_has_no_last_one(small_scene: Scene) -> None:
    text = "The last collision is between the red cube and the blue sphere."
    (claim,) = verify(text, with_events(small_scene)).claims
    assert (claim.holds, claim.reason) == (False, "there are 0 collisions")


def test_the_end_of_the_video_is_its_last_frame(small_scene: Scene) -> None:
    says = "The red cube and the blue sphere {}collide at the end of the video."
    late = with_events(small_scene, Event("collision", 127, (0, 1)))
    early = with_events(small_scene, Event("collision", 0, (0, 1)))
    assert [verify(says.format(word), late).claims[0].holds for word in ("", "do not ")] == [True, False]
    assert [verify(says.format(word), early).claims[0].holds for word in ("", "do not ")] == [False, True]
    assert verify(says.format(""), late).claims[0].frame == 127


def test_long_runs_of_marks_are_read_at_once(small_scene: Scene) -> None:
    start = time.process_time()
    verify("." * 50_000 + "a", small_scene)
    verify("! " * 20_000, small_scene)
    assert time.process_time() - start < 5
