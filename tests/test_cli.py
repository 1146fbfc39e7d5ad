import json
import subprocess
import sys
from dataclasses import replace

import pytest

from nsdr import Scene, load, save
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli.main import main
from nsdr.types import UncertainEvent


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    code = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def test_answer_from_a_saved_scene(capsys) -> None:
    code, out, _ = run(capsys, "answer", TRUTH, "How many collisions happen?", "--trace")
    assert code == 0
    assert out.splitlines()[-1] == "4"
    assert "filter_collision(1, 2)" in out


def test_answer_from_what_save_wrote(capsys, tmp_path) -> None:
    save(tmp_path / "scene.json", load(TRUTH, Scene))
    assert run(capsys, "answer", tmp_path / "scene.json", "How many collisions happen?")[:2] == (0, "4\n")
    execute = ("program", "objects count", "--run", tmp_path / "scene.json")
    assert run(capsys, *execute)[:2] == (0, "6\n")


def test_notes_are_lines_of_stderr_or_stand_in_the_json(capsys, tmp_path, small_scene) -> None:
    save(tmp_path / "scene.json", replace(small_scene, notes=("darker than usual",)))
    ask = ["answer", str(tmp_path / "scene.json"), "How many spheers are there?"]
    assert main(ask) == 0
    found = capsys.readouterr()
    assert found.out == "2\n"
    assert found.err.splitlines() == ["note: darker than usual", "note: read 'spheers' as 'spheres'"]
    assert main([*ask, "--json"]) == 0
    found = capsys.readouterr()
    assert json.loads(found.out)["notes"] == ["darker than usual", "read 'spheers' as 'spheres'"]
    assert found.err == ""
    assert main(["program", "How many spheers are there?"]) == 0
    assert capsys.readouterr().err == "note: read 'spheers' as 'spheres'\n"


def test_a_note_that_several_answers_have_is_printed_once(capsys, tmp_path, small_scene) -> None:
    save(tmp_path / "scene.json", replace(small_scene, notes=("darker than usual",)))
    ask = ["answer", str(tmp_path / "scene.json"), "How many spheres are there?", "How many spheers are there?"]
    assert main(ask) == 0
    assert capsys.readouterr().err.splitlines() == ["note: darker than usual", "note: read 'spheers' as 'spheres'"]
    assert main([*ask, "--json"]) == 0
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert first["notes"] == ["darker than usual"]
    assert second["notes"] == ["darker than usual", "read 'spheers' as 'spheres'"]


def test_answers_come_with_their_probabilities(capsys, tmp_path) -> None:
    scene = load(TRUTH, Scene)
    hit = next(e for e in scene.events if e.kind == "collision")
    save(tmp_path / "scene.json", replace(scene, uncertain=(UncertainEvent(hit, 0.75),)))
    assert run(capsys, "answer", tmp_path / "scene.json", "How many collisions happen?")[1] == "4 (75 %)\n"
    question = ("What will happen next?", "-c", "The brown cylinder collides with the brown metal sphere")
    assert run(capsys, "answer", tmp_path / "scene.json", *question)[1].splitlines() == [
        question[-1],
        f"correct (>99 %) {question[-1]}",
    ]


def test_answer_of_a_choice_question_as_json(capsys) -> None:
    choices = [
        "The brown cylinder collides with the brown metal sphere",
        "The purple metal object and the brown metal sphere collide",
    ]
    code, out, _ = run(capsys, "answer", TRUTH, "What will happen next?", "-c", choices[0], "-c", choices[1], "--json")
    answer = json.loads(out)
    assert code == 0
    assert [c["answer"] for c in answer["choices"]] == ["correct", "wrong"]
    assert answer["program"] == ["unseen_events", "belong_to"]


def test_several_questions_are_answered_from_one_look(capsys) -> None:
    cubes, zebras, hits = "How many cubes are there?", "How many zebras enter?", "How many collisions happen?"
    code, out, err = run(capsys, "answer", TRUTH, cubes, zebras, hits)
    assert code == 1
    assert out.startswith(f"{cubes}\n2\n{zebras}\nerror: unknown word 'zebras'")
    assert out.endswith(f"\n{hits}\n4\n")
    assert err.startswith(f"error: 1 of 3 questions failed: '{zebras}': unknown word 'zebras'")
    code, out, _ = run(capsys, "answer", TRUTH, cubes, zebras, hits, "--json", "--keep-going")
    found = [json.loads(line) for line in out.splitlines()[:3]]
    assert code == 0
    assert [row.get("answer") for row in found] == [2, None, 4]
    assert found[1]["question"] == zebras
    assert "unknown word 'zebras'" in found[1]["error"]
    _, _, err = run(capsys, "answer", TRUTH, cubes, hits, "-c", "4")
    assert "--choice is of one question, and 2 are asked" in err
    _, _, err = run(capsys, "answer", VIDEO, cubes, hits, "-c", "4")
    assert f"nsdr parse {VIDEO} -o scene.json looks at the video once" in err


def test_a_question_that_does_not_fit_the_scene_is_an_error_among_the_others(capsys, tmp_path) -> None:
    save(tmp_path / "scene.json", replace(load(TRUTH, Scene), moving=None))
    reasons = {
        "What color is the cube?": "'the cube' fits two objects: ",
        "What color is the yellow cube?": "no object in this video is a yellow cube; ",
        "How many moving objects are there?": "motion is not known in this scene ",
        "count(red)": "fits no program",
    }
    cubes, hits = "How many cubes are there?", "How many collisions happen?"
    asked = ["answer", tmp_path / "scene.json", cubes, *reasons, hits]
    code, out, err = run(capsys, *asked)
    lines = out.splitlines()
    assert code == 1
    assert lines[:2] + lines[-2:] == [cubes, "2", hits, "4"]
    assert lines[2:-2:2] == [*reasons]
    for line, reason in zip(lines[3:-2:2], reasons.values(), strict=True):
        assert line.startswith("error: ")
        assert reason in line
    assert err.startswith(
        "error: 4 of 6 questions failed, such as 'What color is the cube?': 'the cube' fits two objects: "
    )
    code, out, _ = run(capsys, *asked, "--json")
    found = [json.loads(line) for line in out.splitlines()]
    assert code == 1
    assert [row["question"] for row in found] == [cubes, *reasons, hits]
    assert ["error" in row for row in found] == [False, True, True, True, True, False]
    code, out, err = run(capsys, "answer", TRUTH, "What color is the cube?")
    assert (code, out) == (2, "")
    assert err.startswith("error: 'the cube' fits two objects: ")


def test_a_failed_choice_is_printed_with_its_reason_and_the_others_are_judged(capsys) -> None:
    choices = [
        "-c",
        "the presence of the sphere",
        "-c",
        "the presence of the zebra",
        "-c",
        "the presence of the green cylinder",
    ]
    asked = ["answer", TRUTH, "Which of the following is responsible for the cyan object's exit?", *choices]
    code, out, err = run(capsys, *asked)
    lines = out.splitlines()
    assert code == 1
    assert lines[0] == "the presence of the green cylinder"
    assert lines[1].startswith(
        "error   the presence of the sphere: 'the sphere' in choice A fits two objects: the brown metal "
    )
    assert lines[2].startswith("error   the presence of the zebra: ")
    assert "; the nearest options: the presence of " in lines[2]
    assert lines[3] == "correct the presence of the green cylinder"
    assert err.startswith(
        "error: 2 of 3 choices failed, such as 'the presence of the sphere': 'the sphere' in choice A fits"
    )
    code, out, _ = run(capsys, *asked, "--json", "--keep-going")
    found = json.loads(out.splitlines()[0])["choices"]
    assert code == 0
    assert [c["answer"] for c in found] == [None, None, "correct"]
    assert found[0]["error"].startswith("'the sphere' in choice A fits two objects")
    assert found[2]["error"] == ""


def test_a_refused_question_offers_the_nearest_ones_about_the_scene(capsys) -> None:
    _, _, err = run(capsys, "answer", TRUTH, "How many zebras enter before the purple cube?")
    assert "; the nearest questions: " in err
    assert " enter the scene before the purple cube enters the scene? | " in err
    _, _, err = run(capsys, "program", "How many big cubes are there?")
    assert "(understood: How many cubes are there; the word 'big' was not used)" in err
    _, _, err = run(capsys, "program", "How many zebras enter?")
    assert "; the nearest questions: How many cubes enter the scene? | " in err


def test_programs_that_list_events_or_give_a_frame(capsys) -> None:
    code, out, _ = run(capsys, "program", "unseen_events", "--run", TRUTH)
    assert (code, out) == (0, "the brown metal cylinder and the brown metal sphere collide (about frame 141)\n")
    _, out, _ = run(capsys, "program", "events objects filter_in", "--run", TRUTH)
    assert out == "the purple metal cube enters (frame 25)\nthe brown metal sphere enters (frame 112)\n"
    _, out, _ = run(capsys, "program", "events objects filter_out unique get_frame", "--run", TRUTH)
    assert out == "frame 118\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["answer", "none.mp4", "How many collisions happen?"],
        ["answer", "none.json", "How many collisions happen?"],
        ["answer", ".", "How many collisions happen?"],
        ["answer", VIDEO, " "],
        ["answer", VIDEO, "What will happen next?", "-c", ""],
        ["program", ""],
        ["program", "Who?", "--kind", "any"],
        ["answer", QUESTIONS, "How many collisions happen?"],
        ["answer", VIDEO, "How many collisions happen?", "--dynamics", "none"],
        ["answer", VIDEO, "How many collisions happen?", "--set", "tracker.none=1"],
        ["answer", VIDEO, "How many collisions happen?", "--checkpoint", "none"],
        ["parse", "none.mp4", "-o", "scene.json"],
        ["visualize", "none.mp4", "-o", "image.png"],
        ["visualize", VIDEO, "-o", "image.png", "-c", "the cube"],
    ],
)
def test_errors_that_need_no_weights_come_before_torch(arguments) -> None:
    code = "import sys; from nsdr.cli.main import main; sys.exit(main(sys.argv[1:]) + 90 * ('torch' in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr[:7]) == (2, "error: "), done.stderr


def test_a_question_is_parsed_without_heavy_libraries() -> None:
    code = (
        "import sys; from nsdr.cli.main import main; main(['program', 'How many collisions happen?']); "
        "sys.exit(str({'torch', 'cv2', 'numba', 'scipy', 'loky'} & set(sys.modules) or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "events objects filter_collision count\n"
    assert not done.stderr.strip()


@pytest.mark.parametrize(
    ("arguments", "names"), [(["answer", "answer.mp4"], "QUESTION"), (["export", "."], "--format, --output")]
)
def test_missing_arguments_are_named_as_the_help_names_them(capsys, arguments, names) -> None:
    command = arguments[0]
    wanted = f"error: nsdr {command}: {names} must be given; nsdr {command} --help shows the options\n"
    assert run(capsys, *arguments) == (2, "", wanted)


def test_parse_video_writes_scene_and_proposals(capsys, tmp_path) -> None:
    scene, proposals = (tmp_path / name for name in ("scene.json", "proposals.json"))
    nobody = "question_parser=http://127.0.0.1:9/v1"  # is not needed, as nothing is asked
    code, out, _ = run(capsys, "parse", VIDEO, "-o", scene, "--proposals-out", proposals, "--set", nobody)
    assert code == 0
    assert "6 objects" in out
    assert "purple metal cube enters (frame " in out
    saved = load(scene, Scene)
    assert len(saved.objects) == 6
    assert saved.dynamics is not None
    assert sorted(saved.dynamics.counterfactual) == list(range(6))
    assert saved.dynamics.observed.speed_world_per_s is not None
    assert all(r.yaw is not None and r.speed_world_per_s is None for r in saved.dynamics.counterfactual.values())
    document = json.loads(proposals.read_text())
    assert document["video_index"] == 500002
    assert len(document["frames"]) == 128
    code, out, _ = run(capsys, "program", "objects count", "--run", scene)
    assert (code, out) == (0, "6 (>99 %)\n")
    code, out, _ = run(capsys, "parse", proposals, "-o", tmp_path / "again", "--workers", "1")
    assert (code, out) == (0, f"{tmp_path / 'again'}: 1 done, 0 kept from before, 0 failed\n")
    (file,) = (tmp_path / "again").glob("scene_*.json")
    assert len(load(file, Scene).objects) == 6


def test_parse_question(capsys) -> None:
    code, out, _ = run(capsys, "program", "What will happen without the red cube?")
    assert code == 0
    assert out.strip() == "all_events objects red filter_color cube filter_shape unique get_counterfact belong_to"
    assert run(capsys, "program", "What will happen next?")[1] == "unseen_events belong_to\n"
    _, _, error = run(capsys, "program", "What will happen if the cube and the sphere are removed?")
    assert "without the cube" in error.lower() or "the cube is removed" in error


def test_evaluate_prints_the_table_and_writes_results(capsys, tmp_path) -> None:
    code = main(["evaluate", "--questions", str(QUESTIONS), "--source", "truth", "--data", str(_truth(tmp_path)),
                 "-o", str(tmp_path / "out.json")])  # fmt: skip
    out = capsys.readouterr().out
    report = json.loads((tmp_path / "out.json").read_text())
    assert code == 0
    assert report["descriptive"]["accuracy"] == 1.0
    assert report["counterfactual"]["per_option"] == report["predictive"]["per_question"] == 1.0
    assert len(report["results"]) == 10
    assert "100.0" in out


def _truth(folder):
    """The example's true scene as a generator's truth file."""
    scene = load(TRUTH, Scene)
    assert scene.moving is not None
    assert scene.predicted is not None
    assert scene.counterfactual is not None

    def rows(events):
        return [{"frame_id": e.frame, "object_ids": list(e.objects)} for e in events if e.kind == "collision"]

    frames = []
    for f in range(179):  # 7/5 of the video
        frames.append(
            {
                "frame_id": f,
                "objects": [
                    {
                        **{key: [0, 0, 0] for key in ("location", "orientation", "angular_velocity")},
                        "object_id": o.id,
                        "velocity": [float(scene.moving[o.id, min(f, 127)]), 0, 0],
                        "inside_camera_view": bool(scene.visible[o.id, min(f, 127)]),
                    }
                    for o in scene.objects
                ],
            }
        )
    objects = [{"object_id": o.id, "color": o.color, "material": o.material, "shape": o.shape} for o in scene.objects]
    truth = {
        "scene_index": 500002,
        "seed": 0,
        "objects": objects,
        "frames": frames,
        "collisions": rows(scene.events) + rows(scene.predicted),
        "counterfactual": {str(k): rows(v) for k, v in scene.counterfactual.items()},
    }
    (folder / "truth_500002.json").write_text(json.dumps(truth))
    return folder


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["answer", "none.mp4", "How many collisions happen?"], "none.mp4: no such file"),
        (["answer", TRUTH, ""], "the question is empty"),
        (["answer", TRUTH, "How many zebras enter the scene?"], "unknown word 'zebras'"),
        (["answer", TRUTH, "Which of these is responsible for the purple cube's exit?"], "give choices with it"),
        (["answer", TRUTH, "How many collisions happen?", "--checkpoint", "nowhere"], "no checkpoint 'nowhere'"),
        (["program", "objects count", "--run", QUESTIONS], "nothing that"),
        (["program", "objects boggle", "--run", TRUTH], "unknown module or word 'boggle'"),
        (["parse", VIDEO, "-o", "scene.txt"], "expected a name ending in .json"),
        (["parse", "nowhere", "-o", "out"], "nowhere: no such file or folder"),
        (["parse", VIDEO, "-o", "scene.json", "--workers", "2"], "is one video; leave it out"),
        (
            ["parse", VIDEO, "-o", "scene.json", "--form", "predictions"],
            "--form predictions is of mask proposals, and ",
        ),
        (["parse", VIDEO.parent, "-o", "out", "--proposals-out", "p.json"], "--proposals-out would do nothing: "),
        (["parse", "x.npz", "-o", "out"], "x.npz: no such file or folder"),
        (["program", "How many collisions happen?", "--trace"], "--trace would do nothing without --run"),
        (["program", "objects count", "--run", TRUTH, "--extensions"], "--extensions would do nothing with --run"),
        (["data", "everything"], "unknown command 'data everything'; expected one of data verify, data download"),
        (["train", "everything"], "expected one of frame-parser, dynamics, collisions, question-parser"),
        (["train", "dynamics", "--config", "none.yaml"], "none.yaml"),
        (["evaluate", "--questions", "none.json", "--source", "videos", "--data", "."], "none.json: no such file"),
        (["nonsense"], "nonsense"),
        (["evaluate", "--quest", "q.json", "--data", "."], "unrecognized arguments: --quest"),
        (
            ["answer", TRUTH, "How many collisions happen?", "--dynamics", "propnet"],
            "--dynamics would do nothing",
        ),
        (
            ["answer", TRUTH, "Who?", "--set", "tracker.score=0.8", "--config", "configs/pipeline/default.yaml"],
            "--config configs/pipeline/default.yaml, --set tracker.score=0.8 would do",
        ),
        (["visualize", VIDEO, "-o", "x.mp4", "-q", "Who?"], "they need an output ending in .html"),
        (["visualize", VIDEO, "-o", "x.html", "-c", "this"], "--choice does nothing without --question"),
        (["visualize", VIDEO, "-o", "x.html", "--image", "plan"], "--image does nothing here"),
        (["visualize", VIDEO, "-o", "x.png", "--removed", "1"], "--removed does nothing here; it needs --image plan"),
    ],
)
def test_errors_are_one_line_and_exit_code_2(capsys, arguments, message) -> None:
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert message in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1


def test_debug_shows_the_traceback(capsys) -> None:
    code, _, err = run(capsys, "answer", "none.mp4", "How many collisions happen?", "--debug")
    assert code == 2
    assert "Traceback" in err


def test_no_command_prints_help(capsys) -> None:
    code, out, _ = run(capsys)
    assert code == 2
    assert "parse" in out


def test_demo(capsys, tmp_path) -> None:
    code, out, _ = run(capsys, "demo", "-o", tmp_path / "demo.png")
    assert code == 0
    for kind in ("descriptive", "explanatory", "predictive", "counterfactual"):
        assert f"[{kind}]" in out
    assert "of 10 answers equal the ground truth" in out
    assert (tmp_path / "demo.png").stat().st_size > 10_000


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such terminals")
def test_a_terminal_shows_what_is_done_from_the_start(tmp_path) -> None:
    import os
    import pty
    import termios

    ours, theirs = pty.openpty()
    termios.tcsetwinsize(ours, (24, 100))
    code = "import sys; from nsdr.cli import run; sys.exit(run())"
    command = [sys.executable, "-c", code, "parse", str(VIDEO), "-o", str(tmp_path / "scene.json"), "--set", "stride=4"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        while b"explaining the motion" not in shown:
            shown += os.read(ours, 4096)  # an error where the command ends
        process.kill()
    os.close(ours)
    stages = [b"loading the networks", b"looking for objects", b"explaining the motion"]
    assert sorted(stages, key=shown.index) == stages
