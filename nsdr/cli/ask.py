"""`nsdr answer`, `parse-question`, `execute` and `demo`: questions and programs."""

import json
from dataclasses import asdict
from typing import Any

from nsdr.cli.common import is_scene, load_scene, make_pipeline, question_parser
from nsdr.cli.status import failures_line
from nsdr.errors import DataError, EndpointError, QuestionError
from nsdr.types import Answer

__all__ = ["answer", "demo", "execute", "parse_question"]


def answer(options: Any) -> int:
    """`nsdr answer`: a question about a video or a saved scene."""
    saved = is_scene(options.video)
    given = [f"--{name}" for name in ("dynamics", "config", "force", "background") if getattr(options, name)]
    given += [f"--set {value}" for value in options.set]
    if saved and given:
        raise DataError(f"{options.video} is a saved scene: {', '.join(given)} would do nothing; leave it out")
    if not options.question.strip():
        raise QuestionError("the question is empty")
    if not all(choice.strip() for choice in options.choice):
        raise QuestionError("a choice is empty")
    source: Any = load_scene(options.video) if saved else options.video
    parser = question_parser(options)
    pipeline = make_pipeline(options)
    pipeline.question_parser = parser
    pipeline.responsible = options.responsible
    found = pipeline.answer(source, options.question, options.choice or None)
    if options.json:
        print(json.dumps(asdict(found)))
    else:
        _print_answer(found, options.trace)
    errors = [f"{choice.choice!r}: {choice.error}" for choice in found.choices if choice.error]
    return failures_line(len(errors), len(found.choices), "choices", "".join(errors[:1]), options.keep_going)


def _print_answer(found: Answer, trace: bool, probable: bool = True) -> None:
    from nsdr.symbolic import format_probability, format_trace
    from nsdr.symbolic.traces import disagreement

    say = format_probability if probable else lambda _: ""
    width = len("correct (>99 %)") if any(map(say, found.choices)) else len("correct ")
    if found.answer is not None:
        if trace:
            print(format_trace(found.trace))
        print(found.answer + say(found))
    for choice in found.choices:
        judgement = (choice.answer or "error") + say(choice)
        other = disagreement(choice)
        print(f"{judgement:<{width}} {choice.choice}{other}{': ' + choice.error if choice.error else ''}")
        if trace:
            print(format_trace(choice.trace))


def parse_question(options: Any) -> int:
    """`nsdr parse-question`: the program of a text."""
    if not options.text.strip():
        raise QuestionError("the text is empty")

    from nsdr.question_parser.suggestions import suggestion

    given = [f"--{k}" for k, v in (("checkpoint", "default"), ("device", "auto")) if getattr(options, k) != v]
    if options.parser and given:
        raise DataError(f"{', '.join(given)} would do nothing with --parser; leave it out")
    parser = question_parser(options)
    kinds = ["descriptive", "multiple_choice", "choice"] if options.kind == "auto" else [options.kind]
    for kind in kinds:
        try:
            program = parser.parse(options.text, kind)
            break
        except QuestionError as e:
            if isinstance(e, EndpointError):
                raise
            if kind == kinds[-1]:
                raise QuestionError(f"{e}{suggestion(options.text, None, kinds[0])}") from e
    print(program.tree() if options.tree else program)
    return 0


def execute(options: Any) -> int:
    """`nsdr execute`: a program on a saved scene, or with the official semantics on a prediction file."""
    from nsdr.clevrer.files.predictions import read_predictions
    from nsdr.symbolic import Executor

    if not options.scene:
        raise DataError("--scene is empty; expected a file")
    scene: Any = read_predictions(options.scene) if options.semantics == "official" else load_scene(options.scene)
    executor = Executor(scene, options.semantics, options.collisions)
    _print_answer(executor.answer(options.program), options.trace, probable=False)
    return 0


def demo(options: Any) -> int:
    """`nsdr demo`: questions about the clip that ships with the package."""
    from nsdr.cli.demo import run_demo

    return run_demo(options.checkpoint, options.output, options.device)
