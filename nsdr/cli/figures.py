"""`nsdr figures`: question sets and sample results as the paper shows them."""

import csv
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.questions import Question, SceneQuestions, read_questions
from nsdr.cli.common import frames_of, make_pipeline, refuse_idle, shared_options
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, check_installed, check_output_folder
from nsdr.io.reading import read_text

__all__ = ["figures"]

DISTRIBUTION, CURVE = "question_distribution.png", "program_curve.png"
SAMPLE = "sample_{:05d}.jpg"
"""Names of the files."""


def figures_options(parser: Any) -> None:
    add = parser.add_argument
    add("--questions", default="", help="question file whose distribution is drawn beside the release's")
    add("--ablation", default="", help="ablation.csv of `nsdr train question-parser --ablation`, whose curve is drawn")
    add("--samples", default="", help="question file for samples: pictures with questions, programs and answers")
    add("--videos", default="", help="samples: folder of their videos")
    add("--show", nargs="+", default=[], help="samples: which questions, as SCENE:QUESTION")
    add("-o", "--output", required=True, help="folder for the pictures")
    shared_options(parser, "checkpoint", "pipeline", "video")


def figures(options: Any) -> int:
    """`nsdr figures`: each figure whose input is given."""
    if not options.samples:
        names = ("videos", "show", "dynamics", "config", "force", "background", "set")
        refuse_idle(options, names, " without --samples")
    elif not (options.videos and options.show):
        raise DataError("--samples needs --videos FOLDER and --show SCENE:QUESTION")
    if not (options.questions or options.ablation or options.samples):
        raise DataError("nsdr figures: expected some of --questions, --ablation and --samples")
    check_output_folder(options.output)
    check_installed("matplotlib", "figures need matplotlib", "visualize")
    output = Path(options.output)
    chosen = _chosen(options.samples, options.show) if options.samples else {}
    if options.questions:
        _write(output / DISTRIBUTION, _distribution(options.questions))
    if options.ablation:
        _write(output / CURVE, _curve(options.ablation))
    if chosen:
        _write_samples(options, chosen, output)
    return 0


def _write(path: Path, figure: Any) -> None:
    from nsdr.visualize.figures import figure_png

    with atomic_path(path) as temporary:
        temporary.write_bytes(figure_png(figure))
    print(path)


def _distribution(questions: str) -> Any:
    from nsdr.generate.statistics import RELEASED_QUESTIONS, count_questions
    from nsdr.visualize.distributions import question_figure

    scenes = read_questions(questions)
    total, released = sum(len(s.questions) for s in scenes), sum(RELEASED_QUESTIONS["questions by kind"].values())
    counts = {
        f"{questions} ({total:,} questions)": count_questions(scenes),
        f"CLEVRER, train ({released:,} questions)": RELEASED_QUESTIONS,
    }
    return question_figure(counts)


def _curve(ablation: str) -> Any:
    from nsdr.visualize.distributions import program_curve

    try:
        return program_curve(list(csv.DictReader(read_text(ablation).splitlines())))
    except (KeyError, ValueError, TypeError, csv.Error) as e:
        message = f"{ablation}: not the CSV file of an ablation ({e}); see `nsdr train question-parser --ablation`"
        raise DataError(message) from e


def _chosen(samples: str, show: list[str]) -> dict[SceneQuestions, list[Question]]:
    """The scenes and questions that `--show` names."""
    scenes = {scene.scene_index: scene for scene in read_questions(samples)}
    chosen: dict[SceneQuestions, list[Question]] = {}
    for name in show:
        numbers = [int(part) if part.isdecimal() else -1 for part in name.split(":")]
        if len(numbers) != 2 or min(numbers) < 0:
            raise DataError(f"--show {name}: expected SCENE:QUESTION, such as 500002:13")
        scene = scenes.get(numbers[0])
        questions = [q for q in scene.questions if q.id == numbers[1]] if scene is not None else []
        if scene is None or not questions:
            raise DataError(f"--show {name}: {samples} has no such {'scene' if scene is None else 'question'}")
        chosen.setdefault(scene, []).extend(questions)
    return chosen


def _write_samples(options: Any, chosen: dict[SceneQuestions, list[Question]], output: Path) -> None:
    from nsdr.visualize.annotate import stroboscopic_image, write_image
    from nsdr.visualize.samples import sample_image

    pipeline = make_pipeline(options)
    for scene, questions in chosen.items():
        video = Path(options.videos) / scene.video_filename
        p = pipeline.perceive(video)
        answers = [pipeline.answer(p.scene, q.text, [c.text for c in q.choices] or None) for q in questions]
        image = stroboscopic_image(frames_of(pipeline, video), p.proposals, p.tracks)
        path = output / SAMPLE.format(scene.scene_index)
        write_image(path, sample_image(image, list(zip(questions, answers, strict=True))))
        print(path)
