"""`nsdr evaluate`, `experiment`, `score` and `compare-videos`: scores, tables, and differences of systems."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from jsonargparse.typing import NotEmptyStr, PositiveInt

from nsdr.clevrer.dataset import SPLITS
from nsdr.clevrer.files.questions import QUESTION_TYPES, has_answer, read_questions
from nsdr.cli.common import Command, check_outputs, failures_line, print_notes, settings_of, shared_options
from nsdr.errors import DataError
from nsdr.io.files import check_installed, check_output_folder

WHAT = ("root", "split", "available", "questions", "data", "source", "programs", "limit")
"""Options of `nsdr evaluate` that say what is evaluated."""
RARE = (
    *("types", "every", "tags_from", "videos", "truth", "truth_source", "semantics", "collisions", "counterfactuals"),
    *("data_set_rules", "engine"),
)
"""Options of `nsdr evaluate` for experiments."""


def evaluate_options(parser: Any) -> None:
    from nsdr.evaluation import EvaluationConfig

    add = parser.add_argument
    parser.headings["what is evaluated"], parser.more = WHAT, RARE
    add("--types", nargs="+", default=list(QUESTION_TYPES), help="question types")
    setting = "one setting, such as tracker.score=0.8; repeatable"
    add("--set", action="append", default=[], metavar="NAME=VALUE", help=setting)
    add("-o", "--output", default=None, metavar="FILE", help="write the table and every result as JSON")
    add("--submission", default=None, metavar="FILE", help="write the answers as an EvalAI submission")
    add(
        "--available",
        action="store_true",
        help="score the videos of the data set that are there; else all must be there",
    )
    shared_options(parser, "parser", "failures")
    explicit = {"types", "set", "question_parser", "available"}
    parser.add_class_arguments(EvaluationConfig, as_group=False, skip=explicit)


def evaluate(options: Any) -> int:
    """`nsdr evaluate`: score answers to a question file or a whole split."""
    from nsdr.clevrer.answers.answer_files import write_submission
    from nsdr.evaluation import EvaluationConfig, run_evaluation

    names = {f.name for f in fields(EvaluationConfig)}
    config = EvaluationConfig(**{k: v for k, v in vars(options).items() if k in names})
    inputs = [config.questions, config.data, config.videos, config.truth, config.tags_from]
    outputs = ((options.output, (".json",)), (options.submission, (".json",)))
    check_outputs([path for path in inputs if path], *outputs)
    check_output_folder(config.cache)
    if not (options.output or options.submission):
        _check_scored(config)
    report = run_evaluation(config)
    print(report)
    if report.notes:
        scene, (first, *_) = next(iter(report.notes.items()))
        kept = f"; {options.output} has them all" if options.output else "; -o FILE.json keeps them all"
        of_many = f"scenes with notes: {len(report.notes)}, such as " if len(report.notes) > 1 else ""
        print_notes([f"{of_many}scene {scene}: {first}{kept}"])
    if report.unlabelled and not (options.output or options.submission):
        print("nothing was written: --submission or --output names a file for the answers")
    if options.output:
        report.save(options.output)
    failed, total = report.errors, len(report.results)
    if options.submission and (not failed or options.keep_going):
        write_submission(options.submission, report.results)
    elif options.submission:
        print(f"{options.submission}: not written, because of the failures; --keep-going writes it")
    return failures_line(failed, total, "questions", report.first_failure, options.keep_going)


def _check_scored(config: Any) -> None:
    """Refuse work whose results would neither be scored nor written."""
    from nsdr.evaluation.settings import selected_questions

    scenes, _ = selected_questions(config)
    questions = [q for scene in scenes for q in scene.questions if q.type in config.types]
    if questions and not any(map(has_answer, questions)):
        file = config.questions or f"{config.root}, split {config.split}"
        raise DataError(f"{file}: the questions have no answers to score; name a file for ours by --submission or -o")


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
    add("--questions", type=NotEmptyStr, required=True, help="question file with answers, CLEVRER's or MVBench's")
    whose = "the world of the questions: a file, or the name of one that ships (default: that of their data set, or CLEVRER's)"
    add("--world", default="", metavar="FILE|NAME", help=whose)
    add("--allow-missing", action="store_true", help="leave out questions without an answer; else they count as wrong")
    add("-o", "--output", default=None, metavar="FILE", help="write the report as JSON")


def score(options: Any) -> int:
    """`nsdr score`: the table of one system, or the difference of two."""
    from nsdr.clevrer.answers.answer_files import read_answers
    from nsdr.evaluation.candidates import is_candidate_file
    from nsdr.evaluation.measures import compare_results, format_comparison
    from nsdr.evaluation.responses import score_responses
    from nsdr.io.files import write_json
    from nsdr.io.worlds import read_world, world_beside

    files = [options.predictions] if options.other is None else [options.predictions, options.other]
    check_outputs([options.questions, *files], (options.output, (".json",)))
    if is_candidate_file(options.questions):
        if options.world:
            raise DataError(f"--world would do nothing: {options.questions} is about CLEVRER's videos; leave it out")
        return _score_candidates(options, files)
    world = read_world(options.world) if options.world else world_beside(options.questions)
    questions = read_questions(options.questions, world)
    reports = []
    for file in files:
        answers = read_answers(file)
        try:
            reports.append(score_responses(questions, answers, options.allow_missing, world))
        except DataError as e:
            raise DataError(f"{file} with {options.questions}: {e}") from e
        print(f"{file}:\n{reports[-1]}\n")
    document = reports[0].document()
    if len(reports) == 2:
        comparison = compare_results(*(report.results for report in reports))
        print(format_comparison(comparison, *map(str, files)))
        document = {"files": files, "reports": [r.document() for r in reports], "comparison": comparison}
    if options.output is not None:
        write_json(options.output, document, indent=1)
    return 0


def _score_candidates(options: Any, files: list[str]) -> int:
    """Scores of questions with candidates of which one is right, a system after the other."""
    from nsdr.clevrer.answers.answer_files import read_answers
    from nsdr.evaluation.candidates import candidates_text, read_candidate_questions, score_candidates
    from nsdr.io.files import write_json

    questions, reports = read_candidate_questions(options.questions), {}
    for file in files:
        reports[file] = score_candidates(questions, read_answers(file), options.allow_missing)
        print(f"{file}:\n{candidates_text(reports[file])}\n")
    if options.output is not None:
        write_json(options.output, reports[files[0]] if len(files) == 1 else reports, indent=1)
    return 0


def compare_videos_options(parser: Any) -> None:
    add = parser.add_argument
    add("--root", type=NotEmptyStr, required=True, help="folder of a data set of `nsdr generate dataset`")
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
    report = run(o.root, o.generated, o.output, *about)
    given = f"--root {o.root} --generated {o.generated} --given-frames {o.given_frames} --runs {o.runs}"
    chosen = f"--checkpoint {o.checkpoint}{f' --split {o.split}' if o.split else ''}"
    command = f"nsdr compare-videos {given} {chosen} -o {o.output}"
    paths = write_files(report, Path(o.output), command)
    print(markdown_table(report))
    print("\n".join(map(str, paths)))
    failed = report["not_scored"]
    for name, reason in failed.items():
        print(f"not scored: {name}: {reason}")
    example = "".join(f"{name}: {reason}" for name, reason in [*failed.items()][:1])
    return failures_line(len(failed), len(failed) + len(report["videos"]), "videos", example, o.keep_going)


FUNCTIONS = {
    "evaluate": Command(evaluate, evaluate_options),
    "experiment": Command(experiment, experiment_options),
    "score": Command(score, score_options),
    "compare-videos": Command(compare_videos, compare_videos_options),
}
"""What runs the commands of this file."""
