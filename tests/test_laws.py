"""Scenes that break a law, and the judge that finds which."""

import json
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest

from nsdr import CLEVRER
from nsdr.clevrer import read_proposals, read_questions
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.cli.main import main
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.errors import DataError
from nsdr.generate.dataset import Files
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.physics.violations import SIZES, amount_in, break_law
from nsdr.generate.scene_files import annotation_document, proposal_document
from nsdr.generate.violations import ViolationsConfig, generate_violations
from nsdr.io.files import write_json
from nsdr.io.video import read_video, write_video
from nsdr.io.worlds import read_world
from nsdr.laws.evidence import evidence_in_time, evidence_of
from nsdr.laws.judge import judge_proposals as judge
from nsdr.laws.motion import Evidence, cut_motion, strongest
from nsdr.laws.presence import renamed
from nsdr.laws.timing import timing_of
from nsdr.tracking.tracker import track, tracks_from_annotation
from nsdr.types import LAWS, Judgement, VideoProposals, VideoTracks, Violation
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.world import CLEVRER_WORLD

SEEDS = {
    "permanence": 330000,
    "identity": 330001,
    "continuity": 330000,
    "inertia": 330000,
    "friction": 330013,
    "solidity": 330004,
    "reaction": 330015,
    "distance": 330002,
    "arrow": 330014,
    "standstill": 330000,
}
"""Scenes that give an occasion."""


@lru_cache
def lawful(seed: int) -> SimulatedScene:
    return simulate_scene(seed)


def tracks_of(scene: SimulatedScene) -> VideoTracks:
    return tracks_from_annotation(annotation_document(scene, 0, "video.mp4", CLEVRER_CAMERA))


def found_in(tracks: VideoTracks, late: np.ndarray | None = None) -> list[Evidence]:
    """Evidence in the frames at the times at which they were taken."""
    n = tracks.n_frames
    return evidence_in_time(tracks, timing_of(tracks, np.arange(n), np.zeros(n) if late is None else late))


def test_every_law_has_a_seed() -> None:
    assert list(SEEDS) == list(LAWS)


@pytest.mark.parametrize("law", LAWS)
def test_the_broken_law_is_found_and_the_lawful_scene_breaks_none(law: str) -> None:
    scene = lawful(SEEDS[law])
    assert not found_in(tracks_of(scene))
    made = break_law(scene, law, "clear", SEEDS[law])
    assert made is not None
    broken, violation = made
    assert violation.law == law
    tracks = tracks_of(broken)
    strongest = found_in(tracks)[0]
    assert strongest.law == law
    named = {tracks.tracks[i].object.name for i in strongest.objects}
    assert named == {broken.objects[i].name for i in violation.objects}
    assert abs(strongest.frame - violation.frame) <= 3


def test_what_takes_an_objects_place_does_not_hide_it() -> None:
    seed = 331000  # the other object's box covers that of the one that it replaces
    made = break_law(lawful(seed), "identity", "clear", seed)
    assert made is not None
    strongest = evidence_of(tracks_of(made[0]))[0]
    assert strongest.law == "identity"
    assert abs(strongest.frame - made[1].frame) <= 3


def test_a_half_hidden_object_jumps() -> None:
    made = break_law(simulate_scene(362022), "continuity", "clear", 362022)
    assert made is not None
    (found,) = evidence_of(tracks_of(made[0]))
    assert found.law == "continuity"
    assert abs(found.amount - made[1].amount) < 0.05


def test_a_rebound_out_of_all_proportion_is_no_reversed_video() -> None:
    seed = 332131
    made = break_law(lawful(seed), "reaction", "clear", seed)
    assert made is not None
    assert [e.law for e in evidence_of(tracks_of(made[0]))] == ["reaction"]


@pytest.mark.parametrize(
    ("law", "size", "seed"),
    [
        ("friction", "clear", 366026),  # a cube that stops short, which is no reversed video
        ("friction", "clear", 366362),  # a sphere that is braked until it rolls
        ("reaction", "small", 366751),  # two others collide nearby, but touch neither
        ("inertia", "clear", 366065),  # another object changes at the same time, far away and for a reason of its own
        ("inertia", "clear", 372065),  # what another one did before its last contact says nothing of where it is now
        ("friction", "clear", 366114),  # a sphere whose track is cut five frames after the change
        ("continuity", "clear", 374018),  # after the jump it is partly hidden for long
    ],
)
def test_a_law_broken_once_is_told_from_others(law: str, size: str, seed: int) -> None:
    made = break_law(simulate_scene(seed, removals=False), law, size, seed)
    assert made is not None
    strongest = evidence_of(tracks_of(made[0]))[0]
    assert strongest.law == law
    assert abs(strongest.frame - made[1].frame) <= 3


def test_both_objects_of_a_broken_collision_are_one_violation() -> None:
    def one(objects: tuple[int, ...], frame: int, nats: float) -> Evidence:
        return Evidence("reaction", objects, frame, frame + 1, 1.5, "restitution", nats)

    found = [one((0, 1), 50, 20.0), one((0, 1), 51, 30.0), one((1, 2), 90, 10.0), one((2, 3), 52, 5.0)]
    assert [e.nats for e in strongest(found)] == [30.0, 10.0, 5.0]


def test_another_ground_in_two_stretches_is_one_violation() -> None:
    made = break_law(lawful(SEEDS["friction"]), "friction", "clear", SEEDS["friction"])
    assert made is not None
    explanation = cut_motion(states_from_tracks(tracks_of(made[0])))
    (whole,) = (e for e in explanation.motion() if e.law == "friction")
    (i,) = whole.objects
    explanation.stretches[i] = [s for s in explanation.stretches[i] for _ in range(2 if s.gain else 1)]
    (both,) = (e for e in explanation.motion() if e.law == "friction")
    assert both == whole._replace(nats=2 * whole.nats)


def test_before_the_violation_nothing_is_changed() -> None:
    scene = lawful(SEEDS["inertia"])
    made = break_law(scene, "inertia", "small", 1)
    assert made is not None
    broken, violation = made
    before = slice(0, violation.frame)
    assert np.array_equal(broken.motion.location_world[:, before], scene.motion.location_world[:, before])
    (i,) = violation.objects
    change = broken.motion.velocity[i, violation.frame] - scene.motion.velocity[i, violation.frame]
    assert np.linalg.norm(change[:2]) == pytest.approx(0.3, abs=1e-6)


def test_the_same_seed_breaks_a_law_in_the_same_way() -> None:
    scene = lawful(SEEDS["continuity"])
    first, second = (break_law(scene, "continuity", "limit", 5) for _ in range(2))
    assert first is not None
    assert second is not None
    assert first[1] == second[1]
    assert np.array_equal(first[0].motion.location_world, second[0].motion.location_world)


def test_how_long_a_law_is_broken_is_a_time() -> None:
    assert [amount_in(CLEVRER_WORLD, "standstill", size) for size in SIZES] == [15, 8, 5]
    pucks = read_world("pucks")  # 20 frames a second
    assert [amount_in(pucks, "standstill", size) for size in SIZES] == [12, 6, 4]
    slow = replace(pucks, timeline=replace(pucks.timeline, fps=1))
    assert amount_in(slow, "standstill", "limit") == 1


def test_a_scene_without_an_occasion_gives_none() -> None:
    assert break_law(lawful(SEEDS["permanence"]), "solidity", "clear", 0) is None


def test_what_is_not_seen_is_not_judged() -> None:
    nothing = VideoProposals(
        128,
        np.zeros(0, int),
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((0, 2)),
        np.zeros(0, int),
        np.zeros((0, 4), int),
    )
    assert judge(nothing) == Judgement((), 128, (), 0.0)


def test_a_colour_that_changes_is_seen_in_the_proposals(tmp_path) -> None:
    scene = lawful(SEEDS["identity"])
    made = break_law(scene, "identity", "limit", 0)
    assert made is not None
    broken, violation = made
    path = tmp_path / "proposal_00000.json"
    write_json(path, proposal_document(broken, 0, "video.mp4", CLEVRER_CAMERA))
    found = judge(read_proposals(path))
    assert [v.law for v in found.violations] == ["identity"]
    assert abs(found.violations[0].frame - violation.frame) <= 1
    assert found.objects[found.violations[0].objects[0]].name == broken.objects[violation.objects[0]].name
    assert found.probability > 0.85
    assert [look.split()[0] for look in found.violations[0].looks] == [
        broken.objects[i].color for i in violation.objects
    ]


@pytest.mark.parametrize(
    "seed",
    [
        410100,  # a third object touches one of the two, but its motion stays the same
        410104,  # two others collide near the two, but touch neither
        410845,  # in the frames after the collision, no stretch of the brick is long
    ],
)
def test_a_reaction_is_judged_beside_what_has_no_part_in_it(seed: int, tmp_path) -> None:
    scene = simulate_scene(seed, removals=False, world=read_world("blocks"))
    made = break_law(scene, "reaction", "clear", seed)
    assert made is not None
    path = tmp_path / "proposal_00000.json"
    for one, laws in ((scene, []), (made[0], ["reaction"])):
        write_json(path, proposal_document(one, 0, "video.mp4", scene.world.camera))
        assert [v.law for v in judge(read_proposals(path)).violations] == laws


@pytest.mark.parametrize("changes", [30, 100])
def test_a_new_look_is_reported_where_it_begins_however_long_it_is_seen(changes: int, tmp_path) -> None:
    path = tmp_path / "proposal_00000.json"
    write_json(path, proposal_document(lawful(SEEDS["identity"]), 0, "video.mp4", CLEVRER_CAMERA))
    proposals = read_proposals(path)
    name = track(proposals).tracks[0].object.name
    color, *others = name.split()
    other = " ".join(("red" if color != "red" else "blue", *others))
    mine = (proposals.attribute == CLEVRER_WORLD.vocabulary.index(*name.split())) & (proposals.frame_index >= changes)
    attribute = np.where(mine, CLEVRER_WORLD.vocabulary.index(*other.split()), proposals.attribute)
    (found,) = judge(replace(proposals, attribute=attribute)).violations
    assert (found.law, found.looks) == ("identity", (name, other))
    assert abs(found.frame - changes) <= 2
    head, line = str(judge(replace(proposals, attribute=attribute))).splitlines()
    assert head.startswith("probability that a law is broken: ")
    assert line.startswith(f"  frame {found.frame}: identity, the ")
    assert f"was {color}, is {other.split()[0]}" in line


def converted(proposals: VideoProposals, original: np.ndarray) -> VideoProposals:
    """A video whose frame k shows frame `original[k]` of another one."""
    rows = [np.flatnonzero(proposals.frame_index == f) for f in original]
    frames, every = np.repeat(np.arange(len(rows)), [len(r) for r in rows]), np.concatenate(rows)
    names = ("attribute", "score", "centroid_px", "area_px", "box_xyxy_px")
    return VideoProposals(len(rows), frames, *(getattr(proposals, name)[every] for name in names))


def copied(proposals: VideoProposals, rate: float) -> tuple[VideoProposals, np.ndarray]:
    """A copy at another rate, as FFmpeg makes it from the frames that there are, and how late the processed frames are."""
    begins = np.floor(np.arange(proposals.n_frames) * rate / 25 + 0.5)
    original = np.searchsorted(begins, np.arange(round(proposals.n_frames * rate / 25)), side="right") - 1
    time = np.arange(len(original)) * 25 / rate
    slots = np.ceil(time - 0.5).astype(int)
    nearest = [min(np.flatnonzero(slots == n), key=lambda j: abs(time[j] - slots[j])) for n in np.unique(slots)]
    picked, late = converted(proposals, original[nearest]), np.zeros(slots[-1] + 1)
    late[slots[nearest]] = (time - slots)[nearest]
    at = slots[nearest]
    moved = replace(picked, n_frames=len(late), frame_index=at[picked.frame_index], processed=at)
    return moved, late


@pytest.fixture(scope="module")
def pair_of_proposals(tmp_path_factory) -> tuple[VideoProposals, VideoProposals]:
    """Of a lawful scene, and of the same in which an object jumps."""
    scene, made = lawful(SEEDS["continuity"]), break_law(lawful(SEEDS["continuity"]), "continuity", "clear", 1)
    assert made is not None
    found = []
    for k, one in enumerate((scene, made[0])):
        path = tmp_path_factory.mktemp("pair") / f"proposal_{k:05d}.json"
        write_json(path, proposal_document(one, k, "video.mp4", CLEVRER_CAMERA))
        found.append(read_proposals(path))
    return found[0], found[1]


@pytest.mark.parametrize("rate", [24.0, 24000 / 1001, 30000 / 1001, 30.0, 50.0, 60.0, 15.0])
def test_a_copy_at_another_rate_breaks_what_the_original_breaks(rate: float, pair_of_proposals) -> None:
    lawful_one, broken = (judge(p, late=late) for p, late in (copied(p, rate) for p in pair_of_proposals))
    assert not lawful_one.violations
    assert [v.law for v in broken.violations] == ["continuity"]
    assert abs(broken.violations[0].frame - judge(pair_of_proposals[1]).violations[0].frame) <= 3
    assert bool(broken.notes) == (rate != 50.0)
    assert broken.n_frames == pytest.approx(128, abs=2)


def test_frames_shown_again_are_noticed_where_the_rate_says_nothing(pair_of_proposals) -> None:
    original = np.arange(128) // 3 * 3
    found = judge(converted(pair_of_proposals[0], original))
    assert not found.violations
    assert "shown again" in found.notes[0]
    assert "8.33 frames a second are few" in found.notes[1]
    assert not judge(pair_of_proposals[0]).notes


def test_a_pause_is_one_violation_and_none_where_nothing_should_move(pair_of_proposals) -> None:
    proposals = pair_of_proposals[0]
    original = np.concatenate([np.arange(50), np.full(14, 50), np.arange(50, 114)])
    (found,) = judge(converted(proposals, original)).violations
    assert (found.law, found.frame, found.end) == ("standstill", 50, 65)
    assert "time stands still from frame 50 to 64" in judge(proposals).describe(found)
    still = judge(converted(proposals, np.full(128, 50)))
    assert not still.violations


@pytest.mark.parametrize(("words", "law"), [(("red", "rubber", "cube"), "identity"), (None, "permanence")])
def test_what_turns_up_was_there_before_with_other_words_at_a_stride(words, law: str, tmp_path) -> None:
    path = tmp_path / "proposal_00000.json"
    write_json(path, proposal_document(lawful(SEEDS["identity"]), 0, "video.mp4", CLEVRER_CAMERA))
    proposals = read_proposals(path)
    tracks = track(proposals)
    whole = tracks.tracks[0]
    assert whole.object.name != "red rubber cube"
    arrays = {f.name: getattr(whole, f.name) for f in fields(whole) if f.name != "object"}
    later = replace(whole, **{name: values[whole.frame_index >= 40] for name, values in arrays.items()})
    if words:
        mine = proposals.attribute == CLEVRER_WORLD.vocabulary.index(*whole.object.name.split())
        proposals = replace(
            proposals, attribute=np.where(mine, CLEVRER_WORLD.vocabulary.index(*words), proposals.attribute)
        )
    turns_up = Evidence("permanence", (0,), 40, 40, 39, "frames", 9.0)
    (found,) = renamed([turns_up], replace(tracks, tracks=(later,)), proposals, np.arange(128) % 2 == 0)
    assert found.law == law


def test_pairs_are_a_data_set_with_questions(tmp_path) -> None:
    config = ViolationsConfig(
        str(tmp_path / "data"), videos=4, first_scene=SEEDS["continuity"], laws=("continuity", "permanence"), renderer="none",
        masks=False, sizes=("clear",), workers=1,
    )  # fmt: skip
    root = generate_violations(config)
    truths = [read_truth_file(Files(root, "validation", 10000 + i).truth) for i in range(4)]
    assert [t.get("violation", {}).get("law") for t in truths] == [None, "continuity", None, "permanence"]
    assert truths[0]["frames"][0] == truths[1]["frames"][0]
    questions = read_questions(root / "questions" / "validation.json")
    assert [s.questions[0].answer for s in questions] == ["yes", "no", "yes", "no"]
    objects = truths[1]["violation"]["objects"]
    right = [c.id for c in questions[1].questions[1].choices if c.answer == "correct"]
    assert right == objects
    assert CLEVRER(root).split("validation").question_file is not None
    made = Files(root, "validation", 10000).truth.stat().st_mtime_ns
    generate_violations(config)  # what is finished is not made again
    assert Files(root, "validation", 10000).truth.stat().st_mtime_ns == made


def test_the_test_split_has_no_answers(tmp_path) -> None:
    """As in the release and in `nsdr generate dataset`: they are in `truth/` alone."""
    config = ViolationsConfig(
        str(tmp_path / "data"), videos=2, first_scene=SEEDS["continuity"], laws=("continuity",), renderer="none",
        masks=False, sizes=("clear",), workers=1, splits={"test": 1.0},
    )  # fmt: skip
    root = generate_violations(config)
    asked, answered = (read_questions(root / name) for name in ("questions/test.json", "truth/questions_test.json"))
    assert [s.questions[0].answer for s in asked] == [None, None]
    assert {c.answer for s in asked for q in s.questions for c in q.choices} == {None}
    assert [s.questions[0].answer for s in answered] == ["yes", "no"]
    assert "questions" in {row.kind for row in CLEVRER(root).inventory()}


def test_scenes_of_large_sets_stay_those_of_their_seed(tmp_path, monkeypatch) -> None:
    seeds = []
    monkeypatch.setattr("nsdr.generate.violations.simulate_scene", lambda seed, *_, **__: seeds.append(seed))
    monkeypatch.setattr("nsdr.generate.violations.break_law", lambda *_: None)
    config = ViolationsConfig(str(tmp_path), videos=10_000, splits={"train": 1.0}, seed=3)
    with pytest.raises(DataError, match="no occasion"):
        config.made_together(9998)
    assert len(seeds) == 200
    assert max(seeds) < 4_000_000


def test_a_video_called_like_the_list_of_failures_is_judged(tmp_path) -> None:
    video, report = tmp_path / "failures.mp4", tmp_path / "r.json"
    video.write_text("no video")
    assert main(["judge", str(video), "-o", str(report), "--workers", "1"]) == 1
    kept = [path for path in (tmp_path / "r").iterdir() if "failures" in path.name]
    assert [json.loads(path.read_text()) for path in kept] == json.loads(report.read_text())


def test_the_command_judges_videos_and_says_which_it_cannot(tmp_path, capsys) -> None:
    other = tmp_path / "other.mp4"
    other.write_text("no video")
    report = tmp_path / "report.json"
    page = tmp_path / "page.html"
    assert main(["judge", str(other), str(VIDEO), "-o", str(report), "--report", str(page), "--workers", "1"]) == 1
    refused, judged = json.loads(report.read_text())
    assert str(other) in refused["error"]
    assert judged["video"] == str(VIDEO)
    assert judged["violations"] == []
    assert judged["probability"] < 0.1
    assert (
        f"probability that a law is broken: {judged['probability']:.0%}".replace("%", " %") in capsys.readouterr().out
    )
    assert "0 of 1 judged videos break a law" in page.read_text()


def test_a_reversed_video_is_reported_with_its_frames(tmp_path, capsys) -> None:
    write_video(tmp_path / "back.mp4", read_video(VIDEO)[::-1], preset="veryfast")
    assert main(["judge", str(tmp_path / "back.mp4"), "--report", str(tmp_path / "page.html")]) == 0
    assert "frame 0: arrow, all objects" in capsys.readouterr().out
    page = (tmp_path / "page.html").read_text()
    assert "1 of 1 judged videos break a law" in page
    assert page.count("<img alt=") == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"splits": {"train": 1, "validation": 1}}, "one split"),
        ({"laws": ("gravity",)}, "laws"),
        ({"sizes": ()}, "sizes"),
        ({"videos": 3}, "videos"),
        ({"counterfactual_videos": 1}, "counterfactual_videos"),
    ],
)
def test_settings_that_do_not_fit_are_refused(change, message: str, tmp_path) -> None:
    with pytest.raises(DataError, match=message):
        ViolationsConfig(str(tmp_path), **change)


def test_a_judgement_names_its_objects() -> None:
    with pytest.raises(DataError, match="objects of the video"):
        Judgement((), 128, (Violation("inertia", (0,), 3, 4, 0.5, "world units/s"),), 1.0)
