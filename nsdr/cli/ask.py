"""`nsdr answer`, `program` and `demo`: questions and programs."""

import json
import shlex
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from nsdr.cli.common import (
    VIDEO,
    Command,
    failures_line,
    frames_of,
    is_scene,
    make_pipeline,
    print_notes,
    refuse_for_scene,
    refuse_idle,
    shared_options,
)
from nsdr.errors import DataError, EndpointError, ExecutionError, NsdrError, ProgramError, QuestionError
from nsdr.io.files import check_output
from nsdr.io.notes import distinct
from nsdr.io.storage import load
from nsdr.types import Answer, Scene

if TYPE_CHECKING:
    from nsdr.clevrer.files.questions import Question


def answer_options(parser: Any) -> None:
    add = parser.add_argument
    add("video", help=f"{VIDEO}, or a scene saved by nsdr parse")
    add("question", nargs="+", metavar="QUESTION", help="in English; several are answered from one look")
    option = "an option of the one question, or a candidate for its answer; repeatable"
    add("-c", "--choice", action="append", default=[], metavar="TEXT", help=option)
    system = "answer by a trained baseline: folder or name of a checkpoint, such as truth/mac"
    add("--system", default="", metavar="FOLDER|NAME", help=system)
    add("--trace", action="store_true", help="print every executed step")
    add("--json", action="store_true", help="print the answer as JSON; of several questions, one a line")
    shared_options(parser, "failures", "parser", "extensions", "checkpoint", "pipeline", "video")


def answer(options: Any) -> int:
    """`nsdr answer`: questions about a video or a saved scene, which is looked at once."""
    if not all(question.strip() for question in options.question):
        raise QuestionError("the question is empty" if len(options.question) == 1 else "a question is empty")
    if not all(choice.strip() for choice in options.choice):
        raise QuestionError("a choice is empty")
    if options.choice and len(options.question) > 1:
        raise DataError(_many_with_choices(options))
    ask = (_baseline_asker if options.system else _asker)(options)
    if len(options.question) > 1:
        return _answer_each(options, ask)
    (question,) = options.question
    found = ask(question)
    _print_found(found, options)
    errors = [f"{choice.choice!r}: {choice.error}" for choice in found.choices if choice.error]
    return failures_line(len(errors), len(found.choices), "choices", "".join(errors[:1]), options.keep_going)


def _many_with_choices(options: Any) -> str:
    """Why several questions cannot have choices, and how each gets its own without another look at the video."""
    message = f"--choice is of one question, and {len(options.question)} are asked; ask this one alone"
    if is_scene(options.video):
        return message
    look = f"nsdr parse {shlex.quote(options.video)} -o scene.json looks at the video once"
    return f"{message} ({look}, and nsdr answer scene.json answers each question at once)"


def _answer_each(options: Any, ask: Callable[[str], Answer]) -> int:
    """Answer several questions; one that cannot be parsed or does not fit the scene has the reason in place of an answer.

    A note that several answers have, such as one about the video, is printed with the first of them.
    """
    errors = []
    said: tuple[str, ...] = ()
    for question in options.question:
        try:
            found = ask(question)
        except EndpointError:  # other questions would fail, too
            raise
        except (QuestionError, ProgramError, ExecutionError) as e:
            errors.append(f"{question!r}: {e}")
            print(json.dumps({"question": question, "error": str(e)}) if options.json else f"{question}\nerror: {e}")
            continue
        if not options.json:
            print(question)
        _print_found(found, options, said)
        said = distinct(said, found.notes)
    return failures_line(len(errors), len(options.question), "questions", "".join(errors[:1]), options.keep_going)


def _asker(options: Any) -> Callable[[str], Answer]:
    """What answers a question of the command by the pipeline."""
    saved = is_scene(options.video)
    if saved:
        refuse_for_scene(options)
    source = load(options.video, Scene) if saved else options.video
    pipeline = make_pipeline(options)
    return lambda question: pipeline.answer(source, question, options.choice or None)


def _baseline_asker(options: Any) -> Callable[[str], Answer]:
    """What answers a question of the command by a trained baseline."""
    from nsdr.baselines.trained import TrainedBaseline
    from nsdr.frame_parser.check.video import VideoConfig, check_video
    from nsdr.io.checkpoint import find_checkpoint
    from nsdr.question_parser.loading import GRAMMAR, load_parser

    refuse_idle(options, ("extensions", "trace", "keep_going", "dynamics", "config", "fps", "set"), " with --system")
    baseline = TrainedBaseline.from_pretrained(find_checkpoint(options.system, "baselines"), options.device)
    reads = "program" in baseline.network.needs
    if not reads:
        refuse_idle(options, ("question_parser", "checkpoint"), f": {options.system} reads no programs")
    unusual: tuple[str, ...] = ()
    if is_scene(options.video):
        refuse_idle(options, ("force", "background"), f": {options.video} is no video")
    else:
        check = check_video(options.video, VideoConfig("warn" if options.force else "refuse", options.background))
        unusual = (*check.refused, *check.warned)
    name, words = options.question_parser or GRAMMAR, baseline.vocabulary.objects
    parser = load_parser(name, options.checkpoint, device=options.device, vocabulary=words) if reads else None

    def ask(question: str) -> Answer:
        found = baseline.answer(options.video, question, options.choice or None, parser)
        return replace(found, notes=distinct(unusual, found.notes))

    return ask


def _print_found(found: Answer, options: Any, said: Sequence[str] = ()) -> None:
    """Print an answer, and those of its notes that were not said before; as JSON, it has all its notes."""
    if options.json:
        print(json.dumps(asdict(found)))
    else:
        _print_answer(found, options.trace)
        print_notes(note for note in found.notes if note not in said)


def _print_answer(found: Answer, trace: bool) -> None:
    from nsdr.symbolic import format_trace

    if trace:
        for choice in found.choices:
            if choice.trace:
                print(f"{choice.choice}:\n{format_trace(choice.trace)}")
        if found.trace:
            print(format_trace(found.trace))
    print(found)


def program_options(parser: Any) -> None:
    add = parser.add_argument
    add("text", help="a question or choice in English; with --run, the tokens of a program")
    add("--kind", default="auto", choices=["auto", "descriptive", "multiple_choice", "choice"], help="kind of text")
    shared_options(parser, "parser", "extensions", "checkpoint")
    add(
        "--run",
        default=None,
        metavar="FILE",
        help="run it on a scene of nsdr parse; official: a prediction file",
    )
    add("--semantics", default=None, choices=["paper", "official"], help="with --run: of the executor (default: paper)")
    velocity = "with the official semantics: velocity is NE (default: predicted)"
    add("--collisions", default=None, choices=["predicted", "velocity"], help=velocity)
    add("--trace", action="store_true", help="with --run: print every executed step")


def program(options: Any) -> int:
    """`nsdr program`: the program of a text, or what a program gives on a scene."""
    if not options.text.strip():
        raise QuestionError("the text is empty")
    if options.run is not None:
        return _run(options)
    refuse_idle(options, ("semantics", "collisions", "trace"), " without --run")

    from nsdr.io.checkpoint import find_checkpoint, world_of_checkpoint
    from nsdr.question_parser.loading import GRAMMAR, NETWORK, load_parser
    from nsdr.question_parser.suggestions import QUESTION_KINDS, nearest_questions
    from nsdr.world.vocabulary import CLEVRER

    name = options.question_parser or GRAMMAR
    vocabulary = world_of_checkpoint(find_checkpoint(options.checkpoint)).vocabulary
    if name != NETWORK:
        idle = ("checkpoint", "device") if vocabulary == CLEVRER else ("device",)
        refuse_idle(options, idle, f" with the question parser {name}")
    parser = load_parser(name, options.checkpoint, options.extensions, options.device, vocabulary)
    kinds = ["multiple_choice", "descriptive", "choice"] if options.kind == "auto" else [options.kind]
    errors = []
    for kind in kinds:
        try:
            program = parser.parse(options.text, kind)
            print(program)
            print_notes(program.notes)
            return 0
        except EndpointError:
            raise
        except QuestionError as e:
            errors.append(e)
    suggested = QUESTION_KINDS if options.kind == "auto" else [options.kind]
    longest = max(errors, key=lambda e: len(str(e)))  # says what is understood as some kind
    what = "options" if options.kind == "choice" else "questions"
    raise QuestionError(
        str(longest), nearest_questions(options.text, None, *suggested, vocabulary=vocabulary), what
    ) from longest


def _run(options: Any) -> int:
    """Run a program on a saved scene, or with the official semantics on a prediction file."""
    from nsdr.clevrer.files.predictions import read_predictions
    from nsdr.symbolic import Executor, OfficialExecutor

    if not options.run:
        raise DataError("--run is empty; expected a file")
    refuse_idle(options, ("kind", "question_parser", "extensions", "checkpoint", "device"), " with --run")
    if options.semantics == "official":
        found = OfficialExecutor(read_predictions(options.run), options.collisions or "predicted").answer(options.text)
    else:
        if options.collisions == "velocity":
            raise DataError("--collisions velocity needs --semantics official")
        found = Executor(load(options.run, Scene)).answer(options.text)
    _print_answer(found, options.trace)
    print_notes(found.notes)
    return 0


def demo_options(parser: Any) -> None:
    parser.add_argument("-o", "--output", default="nsdr_demo.png", metavar="FILE", help="annotated image to write")
    shared_options(parser, "checkpoint")


def demo(options: Any) -> int:
    """`nsdr demo`: perceive the package's clip, answer its questions from pixels, compare with the truth, write an image."""
    check_output(options.output, (".png", ".jpg"))
    from nsdr.clevrer.example import QUESTIONS, VIDEO
    from nsdr.clevrer.files.questions import read_questions
    from nsdr.pipeline import Pipeline
    from nsdr.visualize import annotated_image
    from nsdr.visualize.annotate import write_image

    pipeline = Pipeline.from_pretrained(options.checkpoint, device=options.device)
    print(f"Watching {VIDEO.name} ...")
    perception = pipeline.perceive(VIDEO)
    scene = perception.scene
    collisions = sum(e.kind == "collision" for e in scene.events)
    print(f"{scene.n_frames} frames, {len(scene.objects)} objects, {collisions} collisions\n")
    right, failed = 0, []
    questions = read_questions(QUESTIONS)[0].questions
    for question in questions:
        print(f"[{question.type}] {question.text}")
        try:
            found = pipeline.answer(VIDEO, question.text, [c.text for c in question.choices] or None)
            right += _print_compared(question, found)
        except NsdrError as e:
            print(f"  could not be answered: {e}\n")
            failed.append(f"{question.text!r}: {e}")
    print(f"{right} of {len(questions)} answers equal the ground truth")
    assert perception.tracks is not None
    image = annotated_image(
        frames_of(pipeline, VIDEO)[-1], scene.n_frames - 1, perception.proposals, perception.tracks, scene
    )
    write_image(options.output, image)
    print(f"Image: {options.output}")
    return failures_line(len(failed), len(questions), "questions", "".join(failed[:1]), keep_going=False)


def _print_compared(question: "Question", found: Answer) -> bool:
    """Print an answer beside the true one; returns whether they are equal."""
    print(textwrap.fill(" ".join(found.program), 110, initial_indent="  program: ", subsequent_indent=" " * 11))
    if not question.choices:
        print(f"  answer:  {found.text} (truth: {question.answer})")
    for choice, true in zip(found.choices, question.choices, strict=True):
        print(f"  {choice.answer or 'error':<7}  {choice.choice} (truth: {true.answer})")
    given = [c.answer for c in found.choices] or [found.text]
    agrees = given == ([c.answer for c in question.choices] or [question.answer])
    print(f"  {'equal to' if agrees else 'DIFFERS from'} the ground truth\n")
    return agrees


FUNCTIONS = {
    "answer": Command(answer, answer_options),
    "program": Command(program, program_options),
    "demo": Command(demo, demo_options),
}
"""What runs the commands of this file."""
