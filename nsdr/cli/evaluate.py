"""`nsdr evaluate`, `experiment`, `score`, `compare-videos`, `controls` and `tag`: scores, tables, and what questions demand."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from jsonargparse.typing import NonNegativeInt, NotEmptyStr, PositiveInt

from nsdr.clevrer.dataset import SPLITS
from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, SceneQuestions, read_questions, write_questions
from nsdr.cli.common import Command, check_outputs, failures_line, print_notes, settings_of, shared_options
from nsdr.errors import DataError
from nsdr.io.files import check_installed, check_output_folder


def evaluate_options(parser: Any) -> None:
    from nsdr.evaluation import EvaluationConfig

    add = parser.add_argument
    add("--types", nargs="+", default=list(QUESTION_TYPES), help="question types")
    add("--set", action="append", default=[], help="one setting, such as tracker.score=0.8; repeatable")
    add("-o", "--output", default=None, help="write the table and every result as JSON")
    add("--submission", default=None, help="write the answers as an EvalAI submission")
    shared_options(parser, "parser", "failures")
    explicit = {"types", "set", "question_parser"}
    parser.add_class_arguments(EvaluationConfig, as_group=False, skip=explicit)


def evaluate(options: Any) -> int:
    """`nsdr evaluate`: score answers to a question file or a whole split."""
    from nsdr.clevrer.answers.answer_files import write_submission
    from nsdr.evaluation import EvaluationConfig, format_table, run_evaluation
    from nsdr.evaluation.score import first_failure
    from nsdr.io.files import write_json

    names = {f.name for f in fields(EvaluationConfig)}
    config = EvaluationConfig(**{k: v for k, v in vars(options).items() if k in names})
    inputs = [config.questions, config.data, config.videos, config.truth]
    outputs = ((options.output, (".json",)), (options.submission, (".json",)))
    check_outputs([path for path in inputs if path], *outputs)
    check_output_folder(config.cache)
    report = run_evaluation(config)
    print(format_table(report))
    if report["notes"]:
        scene, (first, *_) = next(iter(report["notes"].items()))
        kept = f"; {options.output} has them all" if options.output else "; -o FILE.json keeps them all"
        print_notes([f"scenes with notes: {len(report['notes'])}, such as scene {scene}: {first}{kept}"])
    if report["unlabelled"] and not (options.output or options.submission):
        print("nothing was written: --submission or --output names a file for the answers")
    if options.output:
        write_json(options.output, report, indent=1)
    failed, total = report["errors"], len(report["results"])
    if options.submission and (not failed or options.keep_going):
        write_submission(options.submission, report["results"])
    elif options.submission:
        print(f"{options.submission}: not written, because of the failures; --keep-going writes it")
    return failures_line(failed, total, "questions", first_failure(report), options.keep_going)


def experiment_options(parser: Any) -> None:
    add = parser.add_argument
    add("file", help="configs/experiments/….yaml")
    add("--device", default="auto", help="where networks run: auto, cpu, cuda or cuda:N")
    add("-o", "--output", default="results", help="folder for NAME.json and NAME.md")
    shared_options(parser, "failures")


def experiment(options: Any) -> int:
    """`nsdr experiment`: measure all rows of a table."""
    from nsdr.evaluation import run_experiment
    from nsdr.evaluation.experiments import failed_questions

    check_output_folder(options.output)
    table = run_experiment(options.file, options.output, options.device)
    print(table.read_text())
    failed, total, example = failed_questions(table)
    return failures_line(failed, total, "questions", example, options.keep_going)


def score_options(parser: Any) -> None:
    add = parser.add_argument
    add("predictions", help="JSON Lines, or an EvalAI submission")
    add("other", nargs="?", default=None, help="a second system's file, to be compared with the first")
    add("--questions", type=NotEmptyStr, required=True, help="question file with answers, in CLEVRER's format")
    add("--allow-missing", action="store_true", help="leave out questions without an answer; else they count as wrong")
    add("-o", "--output", default=None, help="write the report as JSON")


def score(options: Any) -> int:
    """`nsdr score`: the table of one system, or the difference of two."""
    from nsdr.clevrer.answers.answer_files import read_answers
    from nsdr.evaluation.measures import compare_reports, format_comparison
    from nsdr.evaluation.responses import format_report, score_responses
    from nsdr.io.files import write_json

    files = [options.predictions] if options.other is None else [options.predictions, options.other]
    check_outputs([options.questions, *files], (options.output, (".json",)))
    questions = read_questions(options.questions)
    reports = []
    for file in files:
        answers = read_answers(file)
        try:
            reports.append(score_responses(questions, answers, options.allow_missing))
        except DataError as e:
            raise DataError(f"{file} with {options.questions}: {e}") from e
        new = not any(reports[-1]["references"] == r["references"] for r in reports[:-1])
        print(f"{file}:\n{format_report(reports[-1], new)}\n")
    document: dict[str, Any] = reports[0]
    if len(reports) == 2:
        comparison = compare_reports(*reports)
        print(format_comparison(comparison, *map(str, files)))
        document = {"files": files, "reports": reports, "comparison": comparison}
    if options.output is not None:
        write_json(options.output, document, indent=1)
    return 0


def compare_videos_options(parser: Any) -> None:
    add = parser.add_argument
    add("--truth", type=NotEmptyStr, required=True, help="data set of `nsdr generate dataset`")
    generated = "folder with a video_N.mp4 for each, the given frames first"
    add("--generated", type=NotEmptyStr, required=True, help=generated)
    add("--given-frames", type=PositiveInt, default=32, help="number of frames that the video model was given")
    add("--split", default="", choices=["", *SPLITS], help="which videos (default: all)")
    add("--runs", type=PositiveInt, default=20, help="runs of Bullet for each of its noise floors")
    add("-o", "--output", required=True, help="folder for report.json, table.md, curves.png and report.html")
    shared_options(parser, "checkpoint", "pipeline", "work", "failures")


def compare_videos(options: Any) -> int:
    """`nsdr compare-videos`: continuations of videos; those that cannot be scored are listed with the reason."""
    o, settings = options, settings_of(options)
    check_output_folder(o.output)
    check_installed("matplotlib", "figures need matplotlib", "visualize")
    from nsdr.continuations.compare import compare_videos as run
    from nsdr.continuations.report import markdown_table, write_files

    about = (o.given_frames, o.runs, o.split, o.checkpoint, settings, o.engine, o.workers, o.device)
    report = run(o.truth, o.generated, o.output, *about)
    given = f"--truth {o.truth} --generated {o.generated} --given-frames {o.given_frames} --runs {o.runs}"
    command = f"nsdr compare-videos {given}{f' --split {o.split}' if o.split else ''} -o {o.output}"
    paths = write_files(report, Path(o.output), command)
    print(markdown_table(report))
    print("\n".join(map(str, paths)))
    failed = report["not_scored"]
    for name, reason in failed.items():
        print(f"not scored: {name}: {reason}")
    example = "".join(f"{name}: {reason}" for name, reason in [*failed.items()][:1])
    return failures_line(len(failed), len(failed) + len(report["videos"]), "videos", example, o.keep_going)


def controls_options(parser: Any) -> None:
    add = parser.add_argument
    add("root", help="data set in the official layout")
    add("--split", default="validation", choices=[*SPLITS], help="which videos")
    add("--kinds", nargs="+", default=["blind", "reversed", "shuffled"], help="which controls")
    add("--limit", type=NonNegativeInt, default=0, help="the first n videos and their questions; 0 for all")
    add("-o", "--output", required=True, help="folder, with one data set for each kind")
    shared_options(parser, "work", "failures")


def controls(options: Any) -> int:
    """`nsdr controls`: a data set of other videos for each kind of control."""
    from nsdr.evaluation.controls import write_controls

    o = options
    check_output_folder(o.output)
    failed: dict[str, str] = {}
    total = 0
    made = write_controls(o.root, o.output, o.split, o.kinds, o.limit, o.workers, o.engine)
    for kind, summary in made.items():
        print(f"{Path(o.output) / kind}: {len(summary.done)} videos written, {len(summary.skipped)} kept")
        failed |= {f"{kind} {name}": message for name, message in summary.failed.items()}
        total += len(summary.done) + len(summary.skipped) + len(summary.failed)
    example = ": ".join(min(failed.items())) if failed else ""
    return failures_line(len(failed), total, "videos", example, o.keep_going)


def tag_options(parser: Any) -> None:
    add = parser.add_argument
    add("questions", help="question file in CLEVRER's format, with programs and answers")
    truth = "tags counterfactual options: folders or files of annotations, truth files or compact ground truth"
    add("--truth", nargs="+", default=[], help=truth)
    add("--train", default="", help="questions of other scenes, which the texts' answers are learned from")
    add("--no-blind", action="store_true", help="leave out what the texts alone predict (needs the extra `blind`)")
    add("-o", "--output", required=True, help="question file to write")


def tag(options: Any) -> int:
    """`nsdr tag`: add `tag` and `blind` to a question file, and print how many have each."""
    if options.no_blind and options.train:
        raise DataError(
            "--train is what texts are learned from and would do nothing with --no-blind; leave one of them out"
        )
    if options.no_blind and not options.truth:
        raise DataError("--no-blind without --truth leaves nothing to tag; give --truth, or leave out --no-blind")
    inputs = [options.questions, *options.truth, options.train]
    check_outputs([path for path in inputs if path], (options.output, (".json",)))
    scenes = read_questions(options.questions)
    if options.truth:
        if all(q.type != "counterfactual" for s in scenes for q in s.questions):
            raise DataError(
                f"{options.questions}: has no counterfactual question, and --truth tags only those; leave it out"
            )
        scenes = _with_tags(scenes, options.truth, options.questions)
    if not options.no_blind:
        from nsdr.baselines.blind import tag_blind

        training = read_questions(options.train) if options.train else None
        try:
            scenes = tag_blind(scenes, training)
        except DataError as e:
            learned = f" with --train {options.train}" if options.train else ""
            raise DataError(f"{options.questions}{learned}: {e}") from e
    write_questions(options.output, scenes)
    print("\n".join(_shares(scenes)))
    return 0


def _with_tags(scenes: Sequence[SceneQuestions], truth: Iterable[str], file: str) -> list[SceneQuestions]:
    from nsdr.baselines.recording import tag_options
    from nsdr.clevrer.files.scenes import iterate_scenes

    tagged = {s.scene_index: s for s in scenes}
    wanted = {s.scene_index for s in scenes if any(q.type == "counterfactual" for q in s.questions)}
    for path in truth:
        for index, _, scene in iterate_scenes(path):
            if index in wanted:
                try:
                    tagged[index] = tag_options(tagged[index], scene)
                except DataError as e:
                    raise DataError(f"{file} with {path}: {e}") from e
                wanted.remove(index)
    if wanted:
        raise DataError(
            f"{file}: --truth {' '.join(truth)} lacks {len(wanted)} scenes with counterfactual questions, such as {min(wanted)}"
        )
    return list(tagged.values())


def _shares(scenes: Sequence[SceneQuestions]) -> list[str]:
    """Lines with the share of each tag, and what texts alone score by question type."""
    questions = [q for scene in scenes for q in scene.questions]
    options = [c for q in questions for c in q.choices if c.tag]
    lines = []
    if options:
        lines.append(f"{'counterfactual options':<24}{'share':>8}{'correct':>9}{'number':>8}")
        numbers = Counter((c.tag, c.answer) for c in options)
        for name in OPTION_TAGS:
            n = numbers[name, "correct"] + numbers[name, "wrong"]
            correct = f"{100 * numbers[name, 'correct'] / n:.1f} %" if n else "-"
            lines.append(f"  {name:<22}{f'{100 * n / len(options):.1f} %':>8}{correct:>9}{n:>8}")
    by_type = {
        kind: [row.blind for q in questions if q.type == kind for row in q.choices or (q,)] for kind in QUESTION_TYPES
    }
    known = {kind: rows for kind, rows in by_type.items() if rows and None not in rows}
    if known:
        lines.append(f"{'text alone':<24}{'right':>8}{'':>9}{'number':>8}")
        lines += [
            f"  {k:<22}{f'{100 * sum(map(bool, r)) / len(r):.1f} %':>8}{'':>9}{len(r):>8}" for k, r in known.items()
        ]
    return lines


FUNCTIONS = {
    "evaluate": Command(evaluate, evaluate_options),
    "experiment": Command(experiment, experiment_options),
    "score": Command(score, score_options),
    "compare-videos": Command(compare_videos, compare_videos_options),
    "controls": Command(controls, controls_options),
    "tag": Command(tag, tag_options),
}
"""What runs the commands of this file."""
