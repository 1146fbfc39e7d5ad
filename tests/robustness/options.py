"""Wrong options, and outputs that cannot be written."""

from collections.abc import Iterator
from pathlib import Path

import yaml

from nsdr.clevrer.example import TRUTH
from tests.robustness.case import Case, Write, text_writer
from tests.robustness.good import (
    ANSWER,
    COUNT,
    EVALUATE_TRUTH,
    EXPORT,
    GENERATE,
    MCP,
    MOTION,
    PARSE,
    PARSE_ONE,
    PREDICT,
    QUESTIONS_OF,
    ROW,
    SCORE,
    SERVE,
    SIMULATE,
    TRAIN,
)

OPTIONS: dict[str, tuple[tuple[str, ...], dict[str, tuple[str, ...]]]] = {
    "answer": (ANSWER, {"--checkpoint": ("nowhere", "a/b", "/dev/null", ""),
                        "--device": ("zebra", "cuda:99", "cuda:x", ""), "--zebra": ("1",), "--set": ("tracker.score",),
                        "--dynamics": ("zebra",), "--extensions": ("zebra",)}),
    "evaluate": (EVALUATE_TRUTH, {
        "--types": ("zebra", ""), "--limit": ("-1", "x", "1.5", ""), "--every": ("0", "-1", "x"),
        "--workers": ("-1", "x", "1.5"), "--programs": ("zebra", "none.json", ""),
        "--source": ("zebra", ""), "--split": ("zebra", "train"),
        "--semantics": ("zebra", "official"), "--collisions": ("zebra", "velocity"), "--engine": ("zebra",),
        "--device": ("zebra",), "--checkpoint": ("nowhere",), "--data": ("nowhere",), "--questions": ("nowhere.json",),
        "--root": ("nowhere",), "--truth-source": ("zebra", "truth"), "--truth": ("nowhere",)}),
    "parse (proposals)": (PREDICT, {
        "--workers": ("-1", "x"), "--form": ("zebra",), "--dynamics": ("zebra", "nowhere.yaml"), "--engine": ("zebra",),
        "--config": ("nowhere.yaml",), "--set": (
            "zebra=1", "tracker=1", "tracker.score", "tracker.score=x", "tracker.score=2", "tracker.score=-1",
            "tracker.score=nan", "stride=0", "stride=-1", "batch_size=0", "batch_size=x", "dynamics.backend=zebra",
            "dynamics.collisions=zebra",
            "dynamics.physics.runs=0", "dynamics.physics.runs=1000000000", "=", "")}),
    "parse (videos)": (PARSE, {"--workers": ("-1", "x"), "--engine": ("zebra",),
                             "--device": ("zebra",), "--checkpoint": ("nowhere",)}),
    "program --run": (("program", *COUNT, "--run", str(TRUTH)), {
        "--semantics": ("zebra",), "--collisions": ("zebra", "velocity"),
        "--run": ("nowhere.json", "/dev/null", ".", "")}),
    "program": (("program", "How many collisions happen?"),
                       {"--kind": ("zebra", "choice", "multiple_choice"), "--checkpoint": ("nowhere",),
                        "--question-parser": ("zebra", "http://u:p@host", "network#a"),
                        "--device": ("zebra",)}),
    "visualize": (("visualize", "{good}/video.mp4", "-o", "x.png"), {"--image": ("zebra",), "--removed": ("x", "1"),
                                                                    "--checkpoint": ("nowhere",)}),
    "data motion": (MOTION, {"--split": ("zebra", "train"), "--workers": ("-1", "x"), "--engine": ("zebra",),
                             "--every": ("2",)}),
    "data download": (("data", "download", "out", "--split", "validation"), {"--split": ("zebra",), "--what": ("zebra",)}),
    "data frames": (("data", "frames", "{good}", "--proposals", "{good}/release/derender_proposals", "-o", "out"),
                    {"--every": ("0", "-1", "x"), "--proposals": ("nowhere",)}),
    "generate dataset": (GENERATE, {
        "--videos": ("0", "-1", "x", "1000000"), "--seed": ("-1", "x", "1000000000001"), "--first-scene": ("-1", "1000000"),
        "--renderer": ("zebra",), "--workers": ("-1",), "--engine": ("zebra",), "--zebra": ("1",),
        "--splits": ("{zebra: 1}", "{train: 0}", "{train: -1}", "{train: x}", "5", "{}", "{train: .nan}"),
        "--scene.objects": ("{0: 1}", "{1: 1}", "{4: -1}", "{4: x}", "{x: 1}", "{400: 1}", "{}"),
        "--scene.held-out": ("[qube]", "[red qube]", "qube"), "--scene.only": ("[qube]",),
        "--scene.shapes": ("[qube]", "[]"), "--scene.colors": ("[]", "[pink]"), "--scene.materials": ("[wood]", "[]"),
        "--scene.speed": ("[3, 2]", "[-1, 2]", "[1]", "[.nan, 1]"), "--scene.mass": ("[0, 1]", "[2, 1]", "[-1, 1]"),
        "--scene.n-frames": ("0", "1000000"), "--scene.physics.restitution": ("1.5", "-0.1"),
        "--scene.participants": ("0", "1", "100"),
        "--questions.per-video": ("{zebra: 1}", "{count: -1}"), "--questions.max-options": ("0", "-1"),
        "--render.width": ("0", "-2", "481", "100000"), "--render.crf": ("-1", "99"),
        "--render.samples": ("0", "-1")}),
    "train": (TRAIN, {
        "--loop.steps": ("0", "-1", "x", "1.5"), "--loop.batch-size": ("0", "-1", "x"), "--loop.save-every": ("0", "-1"),
        "--loop.log-every": ("0", "-1"), "--loop.evaluate-every": ("-1",),
        "--loop.learning-rate": ("0", "-1", "nan", "inf", "x"),
        "--loop.weight-decay": ("-1", "nan"), "--loop.clip-norm": ("0", "-1"), "--loop.ema": ("1", "-0.1", "2"),
        "--loop.precision": ("zebra", "bf17"), "--loop.optimizer": ("zebra",), "--loop.schedule": ("zebra",),
        "--loop.seed": ("-1", "x"), "--loop.device": ("zebra", "cuda:99"), "--device": ("zebra",), "--zebra": ("1",),
        "--paraphrase": ("-1", "1.5", "nan"), "--other": ("-1", "1.5"), "--samples": ("-1",),
        "--evaluation-texts": ("0", "-1")}),
    "score": (SCORE, {"--questions": ("nowhere.json", "/dev/null", ".", ""), "--allow-missing": ("zebra",), "--zebra": ("1",)}),
    "export": (EXPORT, {"--format": ("zebra", ""), "--split": ("zebra", "train", "test"), "--questions": ("nowhere.json", "."),
                        "--videos": ("zebra", ""), "--limit": ("-1", "x"),
                        "--reasoning": ("zebra",)}),
    "simulate": (SIMULATE, {
        "--remove": ("", " ", "zebra", "red cube sphere", "-1"), "--freeze": ("", "zebra"),
        "--mass": ("cube", "cube=", "cube=x", "cube=0", "cube=-1", "cube=1e9", "cube=nan", "cube=1,2", "=2", "zebra=2"),
        "--velocity": ("cube=1", "cube=x", "cube=9,9", "cube=nan,0", "cube=inf,0", "cube=1,2,3", "cube=xx2", "cube=xnan",
                       "=1,0"),
        "--move": ("cube", "cube=1", "cube=99,0", "cube=nan,0", "cube=x,y", "=1,0"),
        "--shift": ("cube", "cube=1", "cube=inf,0", "cube=99,0"),
        "--add": ("red metal cube", "red metal=1,0", "red metal pyramid=1,0", "red metal cube=1", "red metal cube=1,0,1",
                  "red metal cube=99,0", "red metal cube=1,0,99,0", "cube metal red=1,0", "=1,0", "red metal cube=nan,0"),
        "--from-frame": ("-1", "x", "1.5", "100000"), "--dynamics": ("zebra",), "--set": ("zebra=1",),
        "--background": ("nowhere.png",), "-o": ("x.txt", "out.mp4")}),
    "serve": (SERVE, {"--port": ("0", "-1", "65536", "x"), "--max-seconds": ("0", "-1", "x", "nan", "inf"),
                      "--max-megabytes": ("0", "-1", "1.5"), "--checkpoint": ("nowhere",), "--set": ("zebra=1",)}),
    "mcp": (MCP, {"--checkpoint": ("nowhere",), "--set": ("zebra=1",)}),
}  # fmt: skip
"""Wrong values of options, with a command that is right without them."""
COMMANDS_WRONG = {
    "unknown command": ("zebra",), "empty command": ("",), "command missing an argument": ("answer",),
    "no question": ("answer", str(TRUTH)), "argument too much": (*ANSWER, "zebra"),
    "unknown part": ("train", "zebra"), "no part": ("train",), "unknown thing": ("generate", "zebra"),
    "no thing": ("generate",), "unknown action": ("data", "zebra", "."), "no action": ("data",),
    "action without output": ("data", "motion", "."), "no run folder": ("train", "question-parser"),
    "no frames": ("train", "frame-parser", "--run-dir", "run"), "missing folder": ("data", "verify", "nowhere"),
    "missing data set": ("data", "motion", "nowhere", "-o", "out"),
    "missing proposals": ("parse", "nowhere", "-o", "out"),
    "missing scenes": ("generate", "questions", "--scenes", "nowhere", "-o", "out.json"),
    "missing answers": ("score", "nowhere.jsonl", *QUESTIONS_OF),
    "answers without questions": ("score", "{good}/answers.jsonl"),
    "export of no data set": ("export", "nowhere", "--format", "chat", "-o", "out"),
    "export of no questions": ("export", "{good}/truth", "--format", "chat", "-o", "out"),
    "export without a format": ("export", "{good}/dataset", "-o", "out"),
    "export into the data set": ("export", "{good}/dataset", "--format", "chat", "-o", "{good}/dataset"),
    "export a split twice": (*EXPORT, "--split", "validation", "validation"),
    "export pairs without videos": ("export", "{good}/dataset", "--format", "pairs", "--videos", "none", "-o", "out"),
    "export pairs with scenes": ("export", "{good}/dataset", "--format", "pairs", "--scenes", "-o", "out"),
    "export questions of no split": (*EXPORT, "--questions", "{good}/questions/questions.json"),
    "simulate nothing": ("simulate", "{good}/video.mp4"), "simulate a scene": ("simulate", str(TRUTH), "--remove", "cube"),
    "simulate no video": ("simulate", "nowhere.mp4", "--remove", "cube"),
    "simulate gray frames": ("simulate", "{good}/gray.mp4", "--remove", "cube"),
    "simulate one output twice": (*SIMULATE[:4], "-o", "out.mp4", "-o", "out.mp4"),
    "simulate into the input": (*SIMULATE[:4], "-o", "{good}/video.mp4"),
    "serve no folder": ("serve", "nowhere"), "serve a file": ("serve", "{good}/video.mp4"),
    "serve no clips": ("serve", "{good}/truth"),
    "mcp of no folder": ("mcp", "nowhere"), "mcp of a file": ("mcp", "{good}/video.mp4"),
}  # fmt: skip


def _wrong_options() -> Iterator[Case]:
    for command, (argv, options) in OPTIONS.items():
        for option, values in options.items():
            for value in values:
                setting = (value.split("=")[0] if option == "--set" else option).split(".")[-1].lstrip("-")
                named = f"{setting}|{value or option}|{value.replace('_', '-') or option}"
                yield Case(f"option, {command}", f"{option} {value!r}", (*argv, f"{option}={value}"), named=named)
    for name, argv in COMMANDS_WRONG.items():
        yield Case("option, command", name, argv)


OUTPUTS: dict[str, tuple[str, Write, str]] = {
    "missing device": ("/proc/nowhere/{file}", lambda folder, _: None, "/proc"),
    "below a file": ("file/{file}", text_writer("file", "x"), "file"),
    "read-only": ("/sys/{file}", lambda folder, _: None, "/sys"),
    "name too long": ("x" * 300 + "{file}", lambda folder, _: None, "xxx"),
    "empty": ("", lambda folder, _: None, ""),
    "zero byte": ("a\x00{file}", lambda folder, _: None, "a"),
}
"""Targets that cannot be written to, for files and folders, and what the error must hold."""
WRITERS: dict[str, tuple[tuple[str, ...], str, str]] = {
    "evaluate": (EVALUATE_TRUTH[:-2], "-o", "out.json"),
    "evaluate submission": (EVALUATE_TRUTH[:-2], "--submission", "out.json"),
    "parse": (PARSE_ONE, "-o", "scene.json"),
    "parse proposals": ((*PARSE_ONE, "-o", "scene.json"), "--proposals-out", "proposals.json"),
    "visualize": (("visualize", "{good}/video.mp4"), "-o", "image.png"),
    "visualize video": (("visualize", "{good}/video.mp4"), "-o", "out.mp4"),
    "demo": (("demo",), "-o", "demo.png"),
    "generate scene": (("generate", "scene"), "--output", "out.json"),
    "score": (SCORE[:-2], "-o", "out.json"),
    "simulate": (SIMULATE[:4], "-o", "out.mp4"),
    "simulate document": (SIMULATE[:4], "-o", "out.json"),
    "generate questions": (("generate", "questions", "--scenes", "{good}/truth", "--workers", "1"), "--output", "out.json"),
}  # fmt: skip
FOLDER_WRITERS: dict[str, tuple[tuple[str, ...], str]] = {
    "parse (videos)": (PARSE[:2] + PARSE[4:], "-o"),
    "parse (proposals)": (PREDICT[:2] + PREDICT[4:], "-o"),
    "data motion": (("data", "motion", "{good}/release", "--split", "validation", "--workers", "1"), "-o"),
    "generate dataset": (("generate", "dataset", *GENERATE[4:]), "--output"),
    "experiment": (("experiment", "rows.yaml"), "-o"),
    "train": (("train", "question-parser", *TRAIN[4:]), "--run-dir"),
    "export": (EXPORT[:4], "-o"),
}
ENDING_DECIDES = ("parse", "visualize", "demo")
"""Outputs whose form the ending decides."""
NO_ENDINGS = ("visualize video",)
"""Outputs whose endings are tried by another of these commands."""


def _output_cases() -> Iterator[Case]:
    for name, (argv, option, file) in WRITERS.items():
        for label, (target, write, named) in OUTPUTS.items():
            path = target.format(file=file)
            yield Case(f"output, {label}", name, (*argv, f"{option}={path}"), write, named)
        folder = lambda f, _, file=file: (f / file).mkdir()  # noqa: E731
        yield Case("output, folder instead of a file", name, (*argv, f"{option}={file}"), folder, file)
        if name not in NO_ENDINGS:
            yield Case("output, unknown ending", name, (*argv, f"{option}=x.zebra"), named="x.zebra")
        if name in ENDING_DECIDES:
            yield Case("output, no ending", name, (*argv, f"{option}=zebra"), named="zebra")
    for name, (argv, option) in FOLDER_WRITERS.items():
        for label, (target, write, named) in OUTPUTS.items():
            path = target.format(file="out")
            yield Case(f"output, {label}", name, (*argv, f"{option}={path}"), _with_rows(write), named)
        write = _with_rows(text_writer("out", "x"))
        yield Case("output, file instead of a folder", name, (*argv, f"{option}=out"), write, "out")


def _with_rows(write: Write) -> Write:
    """Also writes an experiment."""

    def both(folder: Path, good: Path) -> None:
        content = yaml.safe_dump({"title": "x", "rows": [ROW]})
        (folder / "rows.yaml").write_text(content.replace("{good}", str(good)))
        write(folder, good)

    return both


def option_cases() -> Iterator[Case]:
    """All wrong options and outputs."""
    yield from _wrong_options()
    yield from _output_cases()
