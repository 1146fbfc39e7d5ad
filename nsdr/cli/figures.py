"""`nsdr figures`: question sets and sample results as the paper shows them."""

import csv
from pathlib import Path
from typing import Any

from nsdr.cli.common import frames_of, settings_of, shared_options
from nsdr.errors import DataError
from nsdr.io.files import check_installed, check_output_folder

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
    given = [
        f"--{name}"
        for name in ("videos", "show", "dynamics", "config", "set", "force", "background")
        if getattr(options, name)
    ]
    if given and not options.samples:
        raise DataError(f"{', '.join(given)} would do nothing without --samples; leave it out")
    if options.samples and not (options.videos and options.show):
        raise DataError("--samples needs --videos FOLDER and --show SCENE:QUESTION")
    if not (options.questions or options.ablation or options.samples):
        raise DataError("nsdr figures: expected some of --questions, --ablation and --samples")
    check_output_folder(options.output)
    check_installed("matplotlib", "figures need matplotlib", "visualize")
    output = Path(options.output)
    chosen = _chosen(options.samples, options.show) if options.samples else {}
    if options.questions:
        _write_distribution(options.questions, output / DISTRIBUTION)
    if options.ablation:
        _write_curve(options.ablation, output / CURVE)
    if chosen:
        _write_samples(options, chosen, output)
    return 0


def _write_distribution(questions: str, path: Path) -> None:
    from nsdr.clevrer.files.questions import read_questions
    from nsdr.generate.statistics import RELEASED_QUESTIONS, count_questions
    from nsdr.visualize.distributions import question_figure

    scenes = read_questions(questions)
    counts = {
        f"{questions} ({_total(scenes):,} questions)": count_questions(scenes),
        f"CLEVRER, train ({sum(RELEASED_QUESTIONS['questions by kind'].values()):,} questions)": RELEASED_QUESTIONS,
    }
    _write(path, question_figure(counts))


def _total(scenes: Any) -> int:
    return sum(len(scene.questions) for scene in scenes)


def _write_curve(ablation: str, path: Path) -> None:
    from nsdr.io.reading import read_text
    from nsdr.visualize.distributions import program_curve

    try:
        figure = program_curve(list(csv.DictReader(read_text(ablation).splitlines())))
    except (KeyError, ValueError, TypeError, csv.Error) as e:
        message = f"{ablation}: not the CSV file of an ablation ({e}); see `nsdr train question-parser --ablation`"
        raise DataError(message) from e
    _write(path, figure)


def _write(path: Path, figure: Any) -> None:
    from nsdr.io.files import atomic_path
    from nsdr.visualize.figures import figure_png

    with atomic_path(path) as temporary:
        temporary.write_bytes(figure_png(figure))
    print(path)


def _chosen(samples: str, show: list[str]) -> dict[Any, list[Any]]:
    """The scenes and questions that `--show` names."""
    from nsdr.clevrer.files.questions import read_questions

    scenes = {scene.scene_index: scene for scene in read_questions(samples)}
    chosen: dict[Any, list[Any]] = {}
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


def _write_samples(options: Any, chosen: dict[Any, list[Any]], output: Path) -> None:
    from nsdr.pipeline import Pipeline
    from nsdr.visualize.annotate import stroboscopic_image, write_image
    from nsdr.visualize.samples import sample_image

    pipeline = Pipeline.from_pretrained(options.checkpoint, config=settings_of(options), device=options.device)
    for scene, questions in chosen.items():
        video = Path(options.videos) / scene.video_filename
        perception = pipeline.perceive(video)
        assert perception.proposals is not None
        assert perception.tracks is not None
        texts = [[choice.text for choice in q.choices] or None for q in questions]
        answers = [
            pipeline.answer(perception.scene, q.text, choices) for q, choices in zip(questions, texts, strict=True)
        ]
        image = stroboscopic_image(frames_of(pipeline, video), perception.proposals, perception.tracks)
        path = output / SAMPLE.format(scene.scene_index)
        write_image(path, sample_image(image, list(zip(questions, answers, strict=True))))
        print(path)
