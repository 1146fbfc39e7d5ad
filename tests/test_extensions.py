"""Questions beyond CLEVRER: what scenes know, the modules, the parser's rules, and the generator's questions."""

import json
import random
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nsdr import DataError, Event, ExecutionError, Executor, QuestionError, Scene, SetMass, SetVelocity
from nsdr.baselines import tag_options
from nsdr.claims.narration import narrate
from nsdr.claims.verification import verify
from nsdr.clevrer.answers.prompts import prompt
from nsdr.clevrer.answers.responses import read_response
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.questions import Choice, read_questions
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_truth
from nsdr.cli.main import main
from nsdr.dynamics import states_from_tracks
from nsdr.dynamics.physics.predictor import PhysicsPredictor
from nsdr.dynamics.physics.solver import log_mass_covariance
from nsdr.dynamics.physics.trajectory_fit import _Problem, fit_trajectories
from nsdr.dynamics.scene import motion_px, scene_from_prediction
from nsdr.generate.physics.changed import TruthSimulator
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.questions.candidates import EXTENSION_KINDS, changed_questions
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, generate_questions, select_questions
from nsdr.generate.scene_files import annotation_document, truth_document
from nsdr.io import storage
from nsdr.language.slots import Slot, with_filters
from nsdr.language.texts import clevrer, in_words
from nsdr.pipeline import Perception, Pipeline
from nsdr.question_parser.grammar import GrammarParser, extension_readings
from nsdr.rewards import exact
from nsdr.symbolic import format_trace
from nsdr.tracking.tracker import tracks_from_annotation
from nsdr.types import ObjectPhysics, UncertainEvent
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

from .test_physics_fit import PAIRS, measured

LOG_MASS_STD = CLEVRER_WORLD.physics.log_mass_std

RED, BLUE, GREEN = (
    f"objects {words} unique"
    for words in ("red filter_color cube filter_shape", "blue filter_color", "green filter_color")
)
START, END = "start get_frame", "end get_frame"
COLLIDES = f"all_events {BLUE} filter_collision {GREEN} filter_collision unique"
TWICE = f"all_events {BLUE} twice_as_heavy get_changed belong_to"


@pytest.fixture
def known(small_scene: Scene) -> Scene:
    """The small scene with numbers: the blue sphere is surely heavier than the red cube, the red sphere meets nothing."""
    velocity = np.zeros((4, 128, 2), np.float32)
    velocity[0, :50] = (0.0, 2.0)
    velocity[0, 24:50] = (0.3, 0.3)
    velocity[1, 20:60] = (-1.5, 0.2)
    velocity[3, 10:] = (1.96, 0.1)
    covariance = np.diag([0.02, 0.02, 0.02, LOG_MASS_STD]) ** 2
    return replace(small_scene, physics=ObjectPhysics(velocity, 0.02, np.log([0.8, 1.2, 1.19, 1.0]), covariance))


@pytest.mark.parametrize(
    ("question", "program", "answer"),
    [
        ("How fast is the red cube when the video begins?", f"{RED} {START} query_speed", "2.0 world units per second"),
        ("Where does the red cube move when the video begins?", f"{RED} {START} query_direction", "right"),
        (
            "… the blue sphere … at frame 60 …?",
            "events objects filter_out unique get_object query_name",
            "blue rubber sphere",
        ),
        ("Is the red cube faster than the green cylinder …?", f"{RED} {GREEN} {START} is_faster", "yes"),
        ("Which is slower …?", f"{RED} {GREEN} {START} get_slower query_name", "green rubber cylinder"),
        ("Which is faster …?", f"{GREEN} {RED} {START} get_faster query_name", "red metal cube"),
        (
            "What shape is the fastest object when the video begins?",
            f"objects {START} filter_fastest unique query_shape",
            "cube",
        ),
        (
            "What color is the slowest rubber object …?",
            f"objects sphere filter_shape {END} filter_slowest unique query_color",
            "red",
        ),
        ("Is the blue sphere heavier than the red cube?", f"{BLUE} {RED} is_heavier", "yes"),
        ("Which is heavier …?", f"{RED} {BLUE} get_heavier query_name", "blue rubber sphere"),
        ("Which is lighter …?", f"{RED} {BLUE} get_lighter query_name", "red metal cube"),
        (
            "What is the heaviest rubber cylinder?",
            "objects cylinder filter_shape filter_heaviest unique query_color",
            "green",
        ),
    ],
)
def test_numbers_are_answers(known: Scene, question: str, program: str, answer: str) -> None:
    found = Executor(known).answer(program, question)
    assert found.answer == answer
    assert answer in format_trace(found.trace)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (f"{RED} null query_speed", "speed of the red metal cube changes; ask for a time"),
        (f"{BLUE} {END} query_speed", "blue rubber sphere is not in the image at frame 127"),
        (f"{RED} events objects filter_collision first filter_order get_frame query_speed", "collides at frame 20"),
        (f"{GREEN} {END} query_direction", "green rubber cylinder hardly moves at frame 127"),
        (
            f"{RED} events {BLUE} filter_collision second filter_order get_frame query_direction",
            "between towards .* and right",
        ),
        (f"{RED} {GREEN} {END} is_faster", "are about equally fast"),
        ("objects null filter_fastest unique query_color", "about equally fast"),
        (
            f"{BLUE} {GREEN} is_heavier",
            "blue rubber sphere or the green rubber cylinder is heavier is not known: their collisions",
        ),
        ("objects filter_heaviest unique query_color", "is heavier is not known"),
        (
            f"objects red filter_color sphere filter_shape unique {BLUE} get_heavier query_name",
            "red rubber sphere collides with",
        ),
        (f"{RED} {RED} is_heavier", "both are the red metal cube"),
        (
            "objects brown filter_color filter_heaviest unique query_shape",
            "no object in this video is heaviest brown",
        ),
    ],
)
def test_what_is_not_known_surely_is_refused(known: Scene, program: str, message: str) -> None:
    with pytest.raises(ExecutionError, match=message):
        Executor(known).answer(program)


def test_scenes_without_numbers_refuse(small_scene: Scene) -> None:
    for program, message in (
        (f"{RED} {START} query_speed", "velocities are not known"),
        (f"{RED} {BLUE} is_heavier", "masses are"),
    ):
        with pytest.raises(ExecutionError, match=message):
            Executor(small_scene).answer(program)


def test_changed_objects_are_simulated_once_each(known: Scene) -> None:
    asked: list[object] = []

    def simulate(change: object, frame: int) -> list[Event]:
        asked.append((change, frame))
        return [Event("collision", 30, (1, 2))]

    executor = Executor(known, simulate=simulate)
    answer = executor.answer_choices(
        TWICE, [("b", COLLIDES), ("a", COLLIDES.replace("green", "red"))][:1], "What if …?"
    )
    assert [c.answer for c in answer.choices] == ["correct"]
    assert executor.run(f"{COLLIDES} {TWICE} negate") is False
    assert asked == [(SetMass(1, 2.0), 0)]
    sphere = "objects red filter_color sphere filter_shape unique"
    executor.run(f"all_events {sphere} standing_still get_changed count")
    assert asked[1:] == [(SetVelocity(3, vx=0.0, vy=0.0), 10)]  # when it enters


def test_entrances_and_exits_with_a_changed_object_are_those_of_the_simulation(known: Scene) -> None:
    happening = [Event("collision", 30, (1, 2)), Event("out", 90, (1,))]
    executor = Executor(known, simulate=lambda change, frame: happening)
    choices = [("exits", f"all_events {BLUE} filter_out unique"), ("enters", f"all_events {BLUE} filter_in unique")]
    judged = executor.answer_choices(TWICE, [*choices, ("collide", COLLIDES)])
    assert [c.answer for c in judged.choices] == ["correct", "wrong", "correct"]
    assert executor.run(f"all_events {BLUE} twice_as_heavy get_changed count") == 2


def test_changes_that_cannot_be_simulated_are_refused(known: Scene) -> None:
    def impossible(change: object, frame: int) -> list[Event]:
        raise DataError("too fast")

    with pytest.raises(ExecutionError, match="with the blue rubber sphere 2 times as heavy is not known in this scene"):
        Executor(known).answer_choices(TWICE, [("", COLLIDES)])
    with pytest.raises(ExecutionError, match="too fast"):
        Executor(known, simulate=impossible).answer_choices(TWICE, [("", COLLIDES)])


def test_physics_is_saved_and_old_scenes_load(known: Scene, small_scene: Scene, tmp_path) -> None:
    storage.save(tmp_path / "a.json", known)
    assert storage.load(tmp_path / "a.json", Scene) == known
    storage.save(tmp_path / "old.json", small_scene)
    text = (tmp_path / "old.json").read_text()
    (tmp_path / "old.json").write_text(text.replace(', "physics": null', "").replace(',"physics":null', ""))
    assert "physics" not in (tmp_path / "old.json").read_text()
    assert storage.load(tmp_path / "old.json", Scene) == small_scene


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"velocity_world_per_s": np.zeros((4, 128, 3))}, "expected the shape"),
        ({"velocity_error_world_per_s": -1.0}, "velocity_error_world_per_s"),
        ({"log_mass": None}, "expected log_mass and log_mass_covariance, or neither"),
        ({"log_mass_covariance": -np.eye(4)}, "expected variances"),
        ({"log_mass": np.full(4, np.inf)}, "expected finite"),
    ],
)
def test_physics_is_checked(known: Scene, values: dict, message: str) -> None:
    assert known.physics is not None
    with pytest.raises(DataError, match=message):
        replace(known.physics, **values)


def test_physics_fits_its_scene(known: Scene) -> None:
    assert known.physics is not None
    short = ObjectPhysics(known.physics.velocity_world_per_s[:, :100], 0.0)
    with pytest.raises(DataError, match=r"Scene.physics: expected 4 objects and 128 frames"):
        replace(known, physics=short)


@pytest.mark.parametrize(
    ("text", "program"),
    [
        ("How fast is the red cube moving at the end of the video?", f"{RED} {END} query_speed"),
        ("When the video begins, how fast is the red cube?", f"{RED} {START} query_speed"),
        ("Which direction is the red cube moving when the video ends?", f"{RED} {END} query_direction"),
        ("Does the red cube weigh less than the blue object?", f"{BLUE} {RED} is_heavier"),
        ("Which of the red cube and the blue object is heavier?", f"{RED} {BLUE} get_heavier query_name"),
        ("Which sphere moves the fastest?", "objects sphere filter_shape null filter_fastest unique query_name"),
        ("What colour is the lightest object?", "objects filter_lightest unique query_color"),
    ],
)
def test_rules_read_other_wordings(text: str, program: str) -> None:
    assert extension_readings(text, "descriptive", CLEVRER) == [program.split()]


@pytest.mark.parametrize(
    ("text", "negated"),
    [
        ("What would happen if the blue sphere were twice as heavy?", ""),
        ("If the blue sphere had twice its mass, which event would not happen?", " negate"),
        ("Suppose that the blue sphere weighed twice as much. What would happen?", ""),
        ("What if the blue sphere was twice as heavy as it is?", ""),
    ],
)
def test_rules_read_what_ifs(text: str, negated: str) -> None:
    program = (
        f"all_events objects blue filter_color sphere filter_shape unique twice_as_heavy get_changed belong_to{negated}"
    )
    assert extension_readings(text, "multiple_choice", CLEVRER) == [program.split()]


@pytest.mark.parametrize(
    "text",
    [
        "How heavy is the red cube?",
        "How fast is the red cube?",
        "How fast is the big red cube when the video begins?",
        "Is the red cube much heavier than the blue sphere?",
        "Is the red cube twice as heavy as the blue sphere?",
        "How fats is the red cube when the video begins?",
        "Is the red cube heavier?",
    ],
)
def test_what_no_module_says_has_no_reading(text: str) -> None:
    assert extension_readings(text, "descriptive", CLEVRER) == []


class _Any:
    """Every description of two objects."""

    def words(self, choose, use: str, without: str) -> tuple[str, ...]:
        assert (use, without) == ("one", "")
        return choose.pick([("red", "cube"), ("metal", "sphere")])


@pytest.mark.parametrize("name", [*EXTENSION_KINDS, "changed"])
def test_rules_read_every_template(name: str) -> None:
    kind = "multiple_choice" if name == "changed" else "descriptive"
    for seed in range(3):
        for text, program in clevrer(CLEVRER).every(name.upper(), _Any(), random.Random(seed)):
            assert extension_readings(text, kind, CLEVRER) == [program], text
    assert Slot("N", ("red",)).text(CLEVRER) == "red object"


@pytest.fixture(scope="module")
def parsers() -> tuple[GrammarParser, GrammarParser]:
    return GrammarParser(), GrammarParser(extensions=True)


def test_extensions_are_off_by_default(parsers) -> None:
    default, extended = parsers
    text = "Is the red cube heavier than the blue sphere?"
    with pytest.raises(QuestionError, match="unknown word 'heavier'"):
        default.parse(text)
    assert extended.parse(text).tokens[-1] == "is_heavier"
    with pytest.raises(QuestionError, match="has the character"):
        extended.parse(text + " \N{BROKEN HEART}")


def test_extensions_leave_clevrers_texts_and_refusals_as_they_are(parsers) -> None:
    default, extended = parsers
    texts = [
        "How many big cubes are there?",
        "How many cubes are moving?",
        "Which object enters first?",
        "Is the cube red?",
        "",
    ]
    for kind in ("descriptive", "multiple_choice", "choice"):
        for a, b in zip(default.parse_batch(texts, kind), extended.parse_batch(texts, kind), strict=True):
            assert str(a) == str(b)


def test_pipelines_answer_about_changed_objects_of_videos(known: Scene, parsers) -> None:
    class Simulates(Pipeline):
        def __init__(self) -> None:
            super().__init__(None, None, parsers[1])  # type: ignore[arg-type]

        def perceive(self, video=None, **stages) -> Perception:
            return Perception(None, None, None, known)

        def simulate(self, video, interventions, from_frame=0):
            assert interventions == [SetMass(1, 2.0)]

            return SimpleNamespace(events=(Event("collision", 30, (1, 2)), Event("out", 90, (1,))))

    question = "What would happen if the blue sphere were twice as heavy?"
    choices = ["The blue sphere collides with the green cylinder", "The blue sphere and the red cube collide"]
    choices += ["The blue sphere exits the scene", "The red cube exits the scene"]
    answer = Simulates().answer(VIDEO, question, choices)
    assert [c.answer for c in answer.choices] == ["correct", "wrong", "correct", "wrong"]
    with pytest.raises(ExecutionError, match="ask about the video"):
        Simulates().answer(known, question, choices)


def test_the_command_line_has_the_switch(capsys: pytest.CaptureFixture[str]) -> None:
    text = "How fast is the red cube when the video ends?"
    assert main(["program", text, "--extensions"]) == 0
    assert capsys.readouterr().out.split() == f"{RED} {END} query_speed".split()
    assert main(["program", text]) == 2
    assert main(["program", text, "--extensions", "--question-parser", "network"]) == 2


@pytest.fixture(scope="module")
def simulated() -> list[SimulatedScene]:
    return [simulate_scene(seed) for seed in (500500, 500501)]


@pytest.fixture(scope="module")
def truths(simulated) -> list[dict]:
    return [truth_document(scene, n, Camera()) for n, scene in enumerate(simulated)]


def test_truth_files_tell_velocities_and_masses(truths) -> None:
    truth = truths[0]
    physics = scene_from_truth(truth).physics
    assert physics is not None
    assert physics.log_mass is not None
    for o in truth["objects"]:
        row = next(r for r in truth["frames"][9]["objects"] if r["object_id"] == o["object_id"])
        np.testing.assert_allclose(physics.velocity_world_per_s[o["object_id"], 9], row["velocity"][:2], atol=1e-6)
        assert np.exp(physics.log_mass[o["object_id"]]) == pytest.approx(o["mass"])
    with pytest.raises(DataError, match="mass: expected a positive number, got -1"):
        scene_from_truth(truth | {"objects": [o | {"mass": -1} for o in truth["objects"]]})
    without = scene_from_truth(
        truth | {"objects": [{k: v for k, v in o.items() if k != "mass"} for o in truth["objects"]]}
    )
    assert without.physics is not None
    assert without.physics.log_mass is None


def test_the_fit_knows_how_well_it_knows_masses() -> None:
    states, collision = measured(PAIRS["spheres"])
    met, unmet = fit_trajectories(states, [collision]), fit_trajectories(states, [])
    np.testing.assert_allclose(unmet.log_mass_covariance, LOG_MASS_STD**2 * np.eye(2))
    problem = _Problem(states, [collision]).problem
    failed = log_mass_covariance(problem, np.eye(1), 1.01, LOG_MASS_STD)
    np.testing.assert_allclose(failed, LOG_MASS_STD**2 * np.eye(2))
    c = met.log_mass_covariance
    assert c[0, 0] + c[1, 1] - 2 * c[0, 1] < (0.4 * LOG_MASS_STD) ** 2  # the ratio is known
    assert c[0, 0] + c[1, 1] + 2 * c[0, 1] == pytest.approx(2 * LOG_MASS_STD**2, rel=0.2)  # the product is not


def test_the_physics_backend_measures_velocities_and_masses(truths) -> None:
    truth = truths[0]
    true = scene_from_truth(truth)
    annotation = {"object_property": truth["objects"], "motion_trajectory": truth["frames"][: truth["n_frames"]]}
    tracks = tracks_from_annotation(annotation)
    ids = {t.object.name: t.object.id for t in tracks.tracks}
    seen = [e for e in true.events if e.kind == "collision"]
    names = [[true.objects[i].name for i in e.objects] for e in seen]
    events = [replace(e, objects=tuple(sorted(ids[n] for n in pair))) for e, pair in zip(seen, names, strict=True)]
    scene = scene_from_prediction(PhysicsPredictor(None).explain(states_from_tracks(tracks), events).prediction)  # type: ignore[arg-type]
    assert scene.physics is not None
    assert scene.physics.velocity_error_world_per_s == 0.02
    answered = 0
    for a, b in names:
        program = f"{_described(a)} {_described(b)} is_heavier"
        try:
            found = Executor(scene).run(program)
        except ExecutionError:
            continue
        answered += 1
        assert found is Executor(true).run(program)
    assert answered


def _described(name: str) -> str:
    return " ".join(["objects", *(with_filters([Slot("N", tuple(name.split()))], CLEVRER) or ()), "unique"])


def test_annotations_tell_velocities_only(simulated) -> None:
    scene = simulated[0]
    physics = scene_from_annotation(annotation_document(scene, 0, "v", Camera())).physics
    assert physics is not None
    assert physics.log_mass is None
    np.testing.assert_allclose(physics.velocity_world_per_s[0], scene.motion.velocity[0, :128, :2], atol=1e-3)


def test_generated_questions_agree_with_their_programs(truths) -> None:
    scenes = [(n, "v", scene_from_truth(t)) for n, t in enumerate(truths)]
    plain, extended = (list(generate_questions(scenes, QuestionConfig(extensions=on))) for on in (False, True))
    for (_, _, scene), few, more in zip(scenes, plain, extended, strict=True):
        n = len(few.questions)
        assert more.questions[:n] == few.questions  # CLEVRER's questions are the same
        added = more.questions[n:]
        assert [q.id for q in added] == list(range(n, n + len(added)))
        assert {q.subtype for q in added} >= {"speed", "faster", "heavier"}
        for q in added:
            assert Executor(scene).answer(q.program).text == q.answer
            example = prompt(q).partition("<answer>")[2].partition("<")[0]
            assert len(example.split()) == len(q.answer.split()) or q.subtype == "direction"
            assert extension_readings(q.text, "descriptive", CLEVRER) == [list(q.program)]
            *claims, answer = narrate(Executor(scene).answer(q.program), scene).splitlines()
            assert answer == f"<answer>{q.answer}</answer>"
            assert all(len(verify(claim, scene).claims) >= 1 for claim in claims)


def test_what_if_questions_are_simulated_by_bullet(truths) -> None:
    truth = truths[0]
    scene, simulate = scene_from_truth(truth), TruthSimulator(truth)
    found = next(changed_questions(scene, simulate, random.Random(0), 1))
    executor = Executor(scene, simulate=simulate)
    assert all(executor.run([*o.program, *found.program]) is (o.answer == "correct") for o in found.choices)
    candidates = find_candidates((0, "v", scene, simulate), QuestionConfig(extensions=True, changed_per_video=1))
    (questions,) = select_questions([candidates], QuestionConfig(extensions=True, changed_per_video=1), scene.world)
    assert all(isinstance(c, Choice) for q in questions.questions for c in q.choices)


def test_the_command_writes_questions_that_can_be_read_and_tagged(truths, tmp_path) -> None:
    for truth in truths[:2]:
        (tmp_path / f"truth_{truth['scene_index']:05d}.json").write_text(json.dumps(truth))
    output = str(tmp_path / "questions.json")
    wanted = ["--questions.extensions", "true", "--questions.changed-per-video", "2", "--questions.max-options", "2"]
    assert main(["generate", "questions", "--scenes", str(tmp_path), "-o", output, "--workers", "1", *wanted]) == 0
    questions = [q for scene in read_questions(output) for q in scene.questions]
    answers = {q.subtype: q.answer for q in questions}
    assert answers["speed"].endswith(" world units per second")
    assert len(answers["faster"].split()) == 3
    assert max(len(q.choices) for q in questions if "get_changed" in q.program) == 2
    assert "Descriptive questions beyond CLEVRER" in (tmp_path / "questions.statistics.md").read_text()
    for scene in read_questions(output):
        true = scene_from_truth(json.loads((tmp_path / f"truth_{scene.scene_index:05d}.json").read_text()))
        for q in (q for q in tag_options(scene, true).questions if q.type == "counterfactual"):
            assert all((c.tag is None) == ("get_changed" in q.program) for c in q.choices)


@pytest.mark.parametrize("answer", ["1.8 world units per second", "towards the camera", "right", "red rubber sphere"])
def test_answers_beyond_clevrer_are_read_and_rewarded(answer) -> None:
    right, wrong = f"<answer>{answer}</answer>", "<answer>cylinder</answer>"
    assert read_response(f"Final answer: {answer.capitalize()}.").answer == answer
    assert exact([right, wrong], solution=[right, right], options=[[], []]) == [1.0, 0.0]


def test_bullet_repeats_the_truth_and_says_so_if_not(truths) -> None:
    truth = truths[0]
    hit = truth["collisions"][0]
    same = TruthSimulator(truth)(SetMass(hit["object_ids"][0], 1.0), 0)
    assert {e.objects for e in same} == {tuple(sorted(c["object_ids"])) for c in truth["collisions"]}
    with pytest.raises(DataError, match="does not have its own collisions"):
        TruthSimulator(truth | {"collisions": []})(SetMass(0, 2.0), 0)
    with pytest.raises(DataError, match="expected a SetMass or SetVelocity"):
        TruthSimulator(truth)(SetMass("red cube", 2.0), 0)


def test_what_ifs_need_the_extension() -> None:
    with pytest.raises(DataError, match="changed_per_video: expected 0 without extensions"):
        QuestionConfig(changed_per_video=1)


@pytest.mark.parametrize(
    "text",
    [
        "In which direction does the red cube move in the video?",
        "What direction is the red cube moving in within the video?",
        "Which direction is the red cube moving?",
        "Can you identify the direction of the red cube's movement in the video?",
        "What is the direction of the red cube's motion?",
        "In what direction is the red cube moving throughout the video?",
    ],
)
def test_directions_in_the_image_are_always_read(text: str) -> None:
    assert str(GrammarParser().parse(text)) == f"{RED} query_image_direction"
    assert (
        str(GrammarParser().parse(in_words(f"{RED} query_image_direction", CLEVRER))) == f"{RED} query_image_direction"
    )


def test_moving_in_the_video_is_not_entering_it() -> None:
    for text in ("Does the red cube move in the video?", "Is the red cube moving in the clip?"):
        assert str(GrammarParser().parse(text)) == f"{RED} null filter_moving exist"
    assert "filter_in" in str(GrammarParser().parse("Does the red cube move into the scene?"))


@pytest.mark.parametrize(
    ("motion_px", "answer", "least", "most"),
    [
        ((-80.0, -40.0), "up and to the left", 0.99, 1.0),
        ((80.0, 40.0), "down and to the right", 0.99, 1.0),
        ((80.0, -0.1), "up and to the right", 0.5, 0.6),  # right for sure, but neither up nor down
    ],
)
def test_directions_in_the_image_are_sure_away_from_the_axes(
    known: Scene, motion_px: tuple[float, float], answer: str, least: float, most: float
) -> None:
    scene = replace(known, motion_px=np.array([motion_px] * 4))
    options = ["Up and to the left.", "Down and to the right.", "Up and to the right.", "The object is stationary."]
    found = Executor(scene).answer(f"{RED} query_image_direction", candidates=options)
    assert found.answer == answer
    assert least <= (found.probability or 0) <= most
    assert sum(c.answer == "correct" for c in found.choices) == 1
    assert {c.choice.casefold().strip(".") for c in found.choices if c.answer == "correct"} == {answer}
    assert found.choices[3].probability == 0


def test_what_never_moves_is_stationary(known: Scene) -> None:
    scene = replace(known, motion_px=np.ones((4, 2)), moving=np.zeros_like(known.moving))
    found = Executor(scene).answer(f"{RED} query_image_direction", candidates=["A. The object is stationary.", "B. Up"])
    assert (found.answer, [c.answer for c in found.choices]) == ("stationary", ["correct", None])


@pytest.mark.parametrize("candidate", ["The ball is stationary.", "It is not moving", "The object doesn't move."])
def test_what_stands_still_may_be_said_in_other_words(known: Scene, candidate: str) -> None:
    scene = replace(known, motion_px=np.ones((4, 2)), moving=np.zeros_like(known.moving))
    found = Executor(scene).answer(f"{RED} query_image_direction", candidates=[candidate, "Up and to the left", "Up"])
    assert [c.answer for c in found.choices] == ["correct", "wrong", None]
    assert read_response(candidate).answer == "stationary"


def test_the_probability_of_a_direction_is_of_the_world_that_was_supposed(known: Scene) -> None:
    """The last object to hit the blue sphere is known only where an uncertain collision happens."""
    hit = Event("collision", 60, (0, 3))
    scene = replace(known, motion_px=np.array([(-80.0, -40.0)] * 4), uncertain=(UncertainEvent(hit, 0.4),))
    partner = "events objects cube filter_shape filter_collision second filter_order objects cube filter_shape unique"
    found = Executor(scene).answer(f"{partner} get_col_partner query_image_direction")
    assert found.answer == "up and to the left"
    assert (found.probability or 0) > 0.99


def test_motion_in_the_image_is_from_the_first_to_the_last_visible_frame() -> None:
    """Away from CLEVRER's camera, along x, is up in its image; to the right, along y, is to the right."""
    location = np.zeros((2, 10, 3))
    location[..., 2] = 0.2
    location[0, :, 0] = np.linspace(1, -1, 10)
    location[1, :, 1] = np.linspace(-1, 1, 10)
    visible = np.ones((2, 8), bool)
    visible[1, 4:] = False
    (right, down), (sideways, _) = motion_px(location, visible, Camera())
    assert abs(right) < 1e-6
    assert down < -50
    shown = Camera().pixels([[0.0, location[1, f, 1], 0.2] for f in (0, 3)])
    assert sideways == pytest.approx(shown[1, 0] - shown[0, 0])
    assert np.isnan(motion_px(location, np.zeros((2, 8), bool), Camera())).all()
