"""What a researcher touches in Python: what is printed, scenes and programs by hand, pixels, frames, and parts of their own."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import nsdr
from nsdr.clevrer.example import TRUTH, VIDEO
from nsdr.clevrer.files.proposals import proposals_from_masks
from nsdr.dynamics import StoredExplanation
from nsdr.io.files import write_json
from nsdr.io.images import video_of
from nsdr.io.video import read_video
from nsdr.io.worlds import stored_world
from nsdr.types.answers import ChoiceAnswer
from nsdr.types.events import enter_exit_events
from nsdr.world.world import CLEVRER_WORLD


@pytest.fixture(scope="module")
def scene() -> nsdr.Scene:
    return nsdr.load(TRUTH)


def test_a_printed_scene_is_its_objects_and_events(scene: nsdr.Scene) -> None:
    lines = str(scene).splitlines()
    assert lines[:2] == ["128 frames, 6 objects", "  object 0: brown metal cylinder"]
    assert lines[7:9] == [
        "  brown metal cylinder and cyan metal sphere collide (frame 17)",
        "  purple metal cube enters (frame 25)",
    ]
    assert len(lines) == 1 + len(scene.objects) + len(scene.events)
    assert scene.describe(scene.events[1]) == "purple metal cube enters (frame 25)"


def test_a_printed_answer_is_a_line_and_one_for_each_choice(scene: nsdr.Scene) -> None:
    executor = nsdr.Executor(scene)
    count = executor.answer("events objects filter_collision count")
    assert (count.answer, count.text, str(count)) == (4, "4", "4")
    assert isinstance(count.answer, int)
    assert executor.answer("objects exist").answer == "yes"
    assert executor.answer("events objects filter_in last filter_order get_frame").answer == "frame 112"
    collides = "all_events objects {} filter_shape filter_collision objects {} filter_shape filter_collision unique"
    choices = [
        ("yes", "events objects filter_in first filter_order"),
        ("no", "all_events objects cyan filter_color filter_in unique"),
        ("what", collides.format("cube", "sphere")),
    ]
    judged = executor.answer_choices("events belong_to", choices)
    lines = str(judged).splitlines()
    assert (judged.answer, lines[:3]) == ("yes", ["yes", "correct yes", "wrong   no"])
    assert lines[3].startswith("error   what: ")
    assert str(judged.choices[1]) == "wrong no"
    assert len(repr(judged)) < 1000


@pytest.mark.parametrize(
    ("judgements", "answer", "text"),
    [
        (("correct", "wrong"), "a", "a"),
        (("correct", "correct"), ("a", "b"), "a; b"),
        (("wrong", None), (), "none"),
    ],
)
def test_the_answer_of_a_multiple_choice_question_is_what_is_correct(judgements, answer, text) -> None:
    choices = [ChoiceAnswer(name, judged, (), ()) for name, judged in zip("ab", judgements, strict=True)]
    found = nsdr.Answer.of_choices("?", (), choices)
    assert (found.answer, found.text, found.is_multiple_choice) == (answer, text, True)


def test_a_printed_choice_says_how_probable_its_judgement_is() -> None:
    choices = [ChoiceAnswer("it exits", "correct", (), (), probability=0.98), ChoiceAnswer("it stays", "wrong", (), ())]
    assert str(nsdr.Answer.of_choices("?", (), choices)).splitlines() == [
        "it exits",
        "correct (98 %) it exits",
        "wrong          it stays",
    ]


def test_a_printed_track_names_its_object() -> None:
    frames = np.arange(3, 6)
    place = np.zeros((3, 2))
    track = nsdr.Track(
        nsdr.SceneObject(2, "red", "metal", "cube"), frames, place, place, np.zeros((3, 4), int), np.ones(3)
    )
    assert repr(track) == "Track(object 2, red metal cube: 3 detections from frame 3 to 5)"


def test_a_printed_pipeline_names_its_parts_and_what_is_special_about_them() -> None:
    class Mine:
        def __init__(self, gate: float = 0.5, backend: object = None) -> None:
            self.gate, self.backend = gate, backend

        def parse(self, frames: object, progress: bool = False) -> None: ...

    video = nsdr.frame_parser.VideoConfig(check="warn")
    pipeline = nsdr.Pipeline(Mine(0.25), None, nsdr.GrammarParser(extensions=True), video=video)  # type: ignore[arg-type]
    assert repr(pipeline) == (
        "Pipeline(frame_parser=Mine(gate=0.25), dynamics=NoneType(), "
        "question_parser=GrammarParser(extensions=True), video=VideoConfig(check='warn'))"
    )


def test_what_is_printed_says_what_it_is(tmp_path) -> None:
    blocks = nsdr.read_world("blocks")
    manifest = {"splits": {"train": [0, 7], "validation": [10000, 10002], "test": [15000, 15000]}, "kinds": ["videos"]}
    write_json(tmp_path / "manifest.json", {**manifest, "n_frames": 100, **stored_world(blocks)})
    data, scene = nsdr.CLEVRER(tmp_path), nsdr.Scene.of(["red metal cube"], [])
    assert repr(data) == f"CLEVRER('{tmp_path}', train=7, validation=2, test=0, world=World('blocks'))"
    assert repr(data.split("train")) == f"Split('{tmp_path}', train, 7 videos, world=World('blocks'))"
    (tmp_path / "manifest.json").unlink()
    assert repr(nsdr.CLEVRER(tmp_path)) == f"CLEVRER('{tmp_path}', train=10000, validation=5000, test=5000)"
    assert repr(nsdr.Executor(scene)) == f"Executor({scene.n_frames} frames, 1 objects)"
    assert repr(nsdr.GrammarParser(vocabulary=blocks.vocabulary)).startswith("GrammarParser(words='orange white black ")
    assert "world=World('blocks'), notes" in repr(nsdr.VideoTracks(5, (), blocks))
    assert repr(nsdr.World(camera=nsdr.Camera(lens_mm=28))) == "World('CLEVRER', other camera.lens_mm)"
    assert str(blocks).splitlines()[2] == "  materials: plastic, metal"
    pipeline = nsdr.Pipeline.from_pretrained("blocks", device="cpu")
    assert repr(pipeline.frame_parser) == "FrameParser(device=cpu, world=World('blocks'))"
    assert repr(pipeline.dynamics) == "PhysicsPredictor(detector=TrackCollisionDetector(device=cpu))"
    assert repr(pipeline).endswith("world=World('blocks'))")


def test_public_classes_are_not_printed_as_an_address() -> None:
    kinds = [kind for kind in map(nsdr.__getattr__, nsdr.__all__) if isinstance(kind, type)]
    assert [
        kind for kind in kinds if kind.__repr__ is object.__repr__ and not getattr(kind, "_is_protocol", False)
    ] == []


def detections(mask: np.ndarray) -> nsdr.VideoProposals:
    rows = [(1, ("red", "metal", "cube"), 0.9, mask), (0, ("blue", "rubber", "sphere"), 0.8, mask > 0)]
    return proposals_from_masks(2, rows)


def test_detections_have_words_and_masks() -> None:
    mask = np.zeros((320, 480))
    mask[100:120, 200:230] = 0.9
    mask[100:120, 230:240] = 0.4
    found = detections(mask)
    assert found.words == ("blue rubber sphere", "red metal cube")
    assert (found.mask(0).dtype, found.mask(0).shape) == (np.dtype(bool), (320, 480))
    assert np.array_equal(found.mask(0), mask > 0)
    assert np.array_equal(found.mask(1), mask >= 0.5)
    assert found.box_xyxy_px[1].tolist() == [200, 100, 230, 120]
    with pytest.raises(nsdr.DataError, match="have no masks"):
        replace(found, masks=None).mask(0)


def test_positions_on_the_ground_and_in_the_image() -> None:
    camera = nsdr.Camera()
    place = np.array([[0.5, -1.0], [-2.0, 0.3]])
    np.testing.assert_allclose(camera.pixels(place), camera.pixels(np.c_[place, [0.2, 0.2]]))
    np.testing.assert_allclose(camera.ground(camera.pixels(place)), place, atol=1e-9)
    assert camera.pixels((0.5, -1.0)).shape == (2,)
    location = np.stack([place, np.full((2, 2), np.nan)])
    rollout = nsdr.Rollout(location, ~np.isnan(location[..., 0]), ())
    np.testing.assert_array_equal(rollout.pixels(camera), camera.pixels(location))
    assert np.isnan(rollout.pixels()[1]).all()


def test_tracks_by_frame() -> None:
    frames, boxes = np.array([1, 3]), np.array([[10, 20, 30, 40], [12, 20, 32, 40]])
    centres = np.array([[20.0, 30.0], [22.0, 30.0]])
    track = nsdr.Track(
        nsdr.SceneObject(0, "red", "metal", "cube"), frames, np.zeros((2, 2)), centres, boxes, np.ones(2)
    )
    tracks = nsdr.VideoTracks(5, (track,))
    assert (tracks.centroid_px.shape, tracks.box_xyxy_px.shape) == ((1, 5, 2), (1, 5, 4))
    np.testing.assert_array_equal(tracks.centroid_px[0, frames], centres)
    np.testing.assert_array_equal(tracks.box_xyxy_px[0, frames], boxes)
    assert np.isnan(tracks.centroid_px[0, [0, 2, 4]]).all()


OBJECTS = ["red metal cube", "sphere rubber blue", "green rubber cube"]
EVENTS = [("in", 10, "sphere"), ("collision", 30, "blue sphere", "red cube"), ("out", 60, 2)]


def test_a_scene_by_hand_answers_questions() -> None:
    scene = nsdr.Scene.of(OBJECTS, EVENTS)
    assert str(scene).splitlines()[-3:] == [
        "  blue rubber sphere enters (frame 10)",
        "  red metal cube and blue rubber sphere collide (frame 30)",
        "  green rubber cube exits (frame 60)",
    ]
    seen = [np.flatnonzero(row)[[0, -1]].tolist() for row in scene.visible]
    assert (seen, scene.visible.shape) == ([[0, 127], [10, 127], [0, 59]], (3, 128))
    assert enter_exit_events(scene.visible) == [scene.events[0], scene.events[2]]
    executor = nsdr.Executor(scene)
    why = "events events objects green filter_color filter_out unique filter_ancestor belong_to"
    hit = "events objects filter_collision unique"
    assert executor.answer("objects count").answer == 3
    assert executor.answer_choices(why, [("a collision", hit)]).answer == ()
    for unknown, reason in (
        ("objects null filter_moving count", "motion is not known"),
        ("unseen_events count", "after the video are not known"),
        (
            "all_events objects red filter_color unique get_counterfact count",
            "events without red metal cube are not known",
        ),
        ("objects red filter_color unique start get_frame query_speed", "velocities are not known"),
    ):
        with pytest.raises(nsdr.ExecutionError, match=reason):
            executor.run(unknown)


def test_a_scene_by_hand_may_know_more() -> None:
    moving = np.zeros((3, 50), bool)
    moving[0, 20] = True
    scene = nsdr.Scene.of(
        OBJECTS,
        [nsdr.Event("in", 40, (1,)), ("out", 44, "sphere"), ("in", 48, 1)],
        50,
        predicted=[("collision", 60, 0, 1)],
        counterfactual={"green cube": [("collision", 30, "red cube", "sphere")], 0: []},
        moving=moving,
    )
    assert np.flatnonzero(scene.visible[1]).tolist() == [*range(40, 44), 48, 49]
    executor = nsdr.Executor(scene)
    assert executor.answer("objects null filter_moving count").answer == 1
    assert executor.answer("unseen_events count").answer == 1
    assert executor.answer("all_events objects green filter_color unique get_counterfact count").answer == 1
    assert executor.answer("all_events objects red filter_color unique get_counterfact count").answer == 0


@pytest.mark.parametrize(
    ("objects", "events", "reason"),
    [
        (["red cube"], [], r"object 0: expected one color \(gray, red, .* such as 'red metal cube', got 'red cube'"),
        (["orange metal cube"], [], "one color .*, yellow.* and one material .*got 'orange metal cube'"),
        (["red blue cube"], [], "expected one color"),
        (["red metal cube", "red metal cube"], [], "unique attribute triples"),
        (OBJECTS, [("collision", 30, "red cube", "yellow cube")], "'yellow cube': no object fits"),
        (OBJECTS, [("in", 30, "cube")], "'cube': 2 objects fit"),
        (OBJECTS, [("hit", 30, "red cube")], "Event: kind: Expected one of in, out, collision, got 'hit'"),
        (OBJECTS, [("collision", 30, "red cube")], "two different ids in ascending order"),
        (OBJECTS, [("in", "sphere")], "event: expected its kind, frame and objects"),
        (OBJECTS, [("in", 200, "sphere")], "frames from 0 to 127"),
    ],
)
def test_a_scene_by_hand_is_checked(objects, events, reason) -> None:
    with pytest.raises(nsdr.DataError, match=reason):
        nsdr.Scene.of(objects, events)


def test_programs_are_taken_in_each_notation(scene: nsdr.Scene) -> None:
    tokens = ["events", "objects", "filter_collision", "count"]
    programs = [tokens, " ".join(tokens), ", ".join(tokens), "count(filter_collision(events, objects))"]
    programs.append(nsdr.Program.parse(tokens))
    pipeline = bare_pipeline()
    assert {nsdr.Executor(scene).answer(program).answer for program in programs} == {4}
    assert {pipeline.answer(scene, program=program).answer for program in programs} == {4}
    assert {pipeline.answer(scene, program).answer for program in programs if isinstance(program, str)} == {4}


def test_choices_are_texts_or_programs(scene: nsdr.Scene) -> None:
    collides = "unique(filter_collision(filter_collision(all_events, {}), {}))"
    brown, sphere = "filter_shape(objects, cylinder)", "filter_material(filter_shape(objects, sphere), metal)"
    program = collides.format(f"filter_color({brown}, brown)", f"filter_color({sphere}, brown)")
    text = "The brown cylinder collides with the brown metal sphere"
    judged = bare_pipeline().answer(scene, "What will happen next?", [text, program])
    assert judged.answer == (text, program)
    (wrong,) = bare_pipeline().answer(scene, "What will happen next?", ["objects"]).choices
    assert "objects" in wrong.error
    alone = nsdr.Executor(scene).answer_choices("belong_to(unseen_events)", [program])
    assert alone.answer == str(nsdr.Program.parse(program))


def test_a_saved_scene_is_asked_about_by_its_path(scene: nsdr.Scene, tmp_path) -> None:
    pipeline = bare_pipeline()
    nsdr.save(tmp_path / "scene.json", scene)
    assert pipeline.answer(tmp_path / "scene.json", "How many collisions happen?").answer == 4
    assert pipeline.answer(str(TRUTH), "How many collisions happen?").answer == 4
    with pytest.raises(nsdr.DataError, match="no such file"):
        pipeline.answer("none.json", "How many collisions happen?")
    with pytest.raises(nsdr.VideoError, match=r"is a JSON file; expected a video .*nsdr\.load"):
        pipeline.perceive(tmp_path / "scene.json")


def bare_pipeline(**parts) -> nsdr.Pipeline:
    """A pipeline without networks."""
    given = {"frame_parser": None, "dynamics": None, "question_parser": nsdr.GrammarParser()}
    return nsdr.Pipeline(**(given | parts))


class Failing:
    """A part that fails by itself."""

    def parse(self, *_: object, **__: object) -> nsdr.Program:
        raise KeyError("my own fault")

    explain = parse


class Wrong:
    """A part that gives something else than what is expected."""

    def parse(self, *_: object, **__: object) -> str:
        return "objects count"

    explain = parse


def seen(words: str = "red metal cube") -> nsdr.VideoTracks:
    frames, place = np.arange(20), np.zeros((20, 2))
    color, material, shape = words.split()
    track = nsdr.Track(
        nsdr.SceneObject(0, color, material, shape), frames, place, place + 200, np.full((20, 4), 200), np.ones(20)
    )
    return nsdr.VideoTracks(20, (track,))


def test_errors_of_ones_own_part_keep_their_kind_and_traceback(scene: nsdr.Scene) -> None:
    for fails in (
        lambda: bare_pipeline(question_parser=Failing()).answer(scene, "What?"),
        lambda: bare_pipeline(dynamics=Failing()).perceive(tracks=seen()),
        lambda: bare_pipeline(frame_parser=Failing()).perceive(VIDEO),
    ):
        with pytest.raises(KeyError, match="my own fault") as failure:
            fails()
        assert failure.traceback[-1].name == "parse"


def test_a_wrong_result_of_ones_own_part_is_refused_in_words(scene: nsdr.Scene) -> None:
    with pytest.raises(nsdr.DataError, match=r"Wrong\.parse returned a str; expected an nsdr\.Program"):
        bare_pipeline(question_parser=Wrong()).answer(scene, "What?")
    with pytest.raises(nsdr.DataError, match=r"Wrong\.parse returned a str; expected an nsdr\.VideoProposals"):
        bare_pipeline(frame_parser=Wrong()).perceive(VIDEO)
    with pytest.raises(nsdr.DataError, match=r"Wrong\.explain returned a str; expected an nsdr\.Explanation"):
        bare_pipeline(dynamics=Wrong()).perceive(tracks=seen())

    class Rolls(nsdr.Explanation):
        def run(self, changes, from_frame, frames):
            return {"location_world": []}

    class Explains:
        def explain(self, states, collisions=None):
            return Rolls(states.objects, states.n_frames)

    with pytest.raises(nsdr.DataError, match=r"Rolls\.run returned a dict; expected an nsdr\.Rollout"):
        bare_pipeline(dynamics=Explains()).perceive(tracks=seen())


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read_video(VIDEO)


class Keeps:
    """A frame parser that keeps what it is given."""

    def parse(self, frames, progress: bool = False) -> nsdr.VideoProposals:
        self.frames = list(frames)
        mask = np.zeros((320, 480), bool)
        mask[140:180, 220:260] = True
        rows = [(f, ("red", "metal", "cube"), 0.99, mask) for f in range(len(self.frames))]
        return proposals_from_masks(len(self.frames), rows)


def test_a_video_is_a_path_an_array_or_images(frames: np.ndarray) -> None:
    images = [Image.fromarray(frame) for frame in frames]
    for video in (VIDEO, str(VIDEO), frames, list(frames), images, iter(images)):
        parser = Keeps()
        pipeline = bare_pipeline(frame_parser=parser, dynamics=Stands())
        perception = pipeline.perceive(video)
        assert isinstance(perception.explanation, StoredExplanation)
        assert np.array_equal(parser.frames, frames)
        assert perception.scene.notes == perception.tracks.notes


def test_frames_of_another_size_are_scaled_with_a_note(frames: np.ndarray) -> None:
    large = [Image.fromarray(frame).resize((960, 640)) for frame in frames[:40]]
    parser = Keeps()
    pipeline = bare_pipeline(frame_parser=parser, dynamics=Stands())
    scene = pipeline.scene(large)
    assert parser.frames[0].shape == (320, 480, 3)
    assert np.abs(parser.frames[0].astype(int) - frames[0]).mean() < 3
    assert "960x640 px, resized to 480x320" in scene.notes
    assert "40 frames, CLEVRER's videos have 128" in scene.notes
    assert pipeline.answer(large, "How many objects are there?").answer == 1
    kept = parser.frames
    pipeline.scene(large)  # perceived once for each content
    assert parser.frames is kept


@pytest.mark.parametrize(
    ("video", "reason"),
    [
        ([], "no frames to parse: expected at least 1"),
        (3, "expected a video's path or its frames, got an int"),
        (
            np.zeros((2, 320, 480, 3)),
            r"frame 0: expected an image or an array .* of uint8, .* got \(320, 480, 3\) float64",
        ),
        (np.zeros((320, 480, 3), np.uint8), r"got \(480, 3\) uint8"),
        ([np.zeros((4, 6, 3), np.uint8), np.zeros((4, 5, 3), np.uint8)], r"frame 1: expected \(4, 6, 3\) as the first"),
        (["a.png"], "frame 0: expected an image or an array"),
    ],
)
def test_what_is_no_video_is_refused(video, reason) -> None:
    with pytest.raises(nsdr.DataError, match=reason):
        bare_pipeline(frame_parser=Keeps()).perceive(video)


def test_questions_about_detections_are_refused_with_what_to_ask() -> None:
    given = detections(np.ones((320, 480), bool))
    with pytest.raises(nsdr.DataError, match=r"got proposals; ask pipeline\.perceive\(proposals=…\)\.scene"):
        bare_pipeline(frame_parser=Keeps()).answer(given, "How many objects are there?")


def test_frames_of_a_generator_may_share_memory() -> None:
    def shared():
        buffer = np.zeros((4, 6, 3), np.uint8)
        for level in (1, 2):
            buffer[:] = level
            yield buffer

    assert [int(frame.max()) for frame in video_of(shared()).images] == [1, 2]
    one = np.ones((4, 6, 3), np.uint8)
    first, second = video_of([one, one]).images
    assert first is second


def test_frames_that_are_not_of_clevrers_scene_are_refused() -> None:
    black = np.zeros((30, 320, 480, 3), np.uint8)
    with pytest.raises(
        nsdr.VideoError, match="30 frames in memory: not a video of CLEVRER's scene: the background is black"
    ):
        bare_pipeline(frame_parser=Keeps()).perceive(black)


def test_a_frame_parser_takes_what_a_pipeline_takes(frames: np.ndarray) -> None:
    parser = nsdr.FrameParser.from_pretrained(device="cpu")
    few = frames[:2]
    found = parser.parse(few)
    assert len(found) > 0
    assert parser.parse([Image.fromarray(frame) for frame in few]) == found
    large = parser.parse([Image.fromarray(frame).resize((960, 640)) for frame in few])
    assert large.n_frames == 2
    assert "960x640 px, resized to 480x320" in large.notes
    assert set(large.words) == set(found.words)
    streamed = parser.parse(iter(few))
    assert (streamed.notes, replace(found, notes=())) == ((), streamed)


class Stands:
    """A backend after which nothing moves."""

    def explain(self, states, collisions=None):
        total = CLEVRER_WORLD.timeline.horizon_frame(states.n_frames) + 1
        location = np.repeat(states.location_world[:, :1], total, 1)
        rollout = nsdr.Rollout(location, np.ones(location.shape[:2], bool), ())
        return StoredExplanation(nsdr.types.DynamicsPrediction(states.objects, states.n_frames, rollout))
