"""One digest of what each stage gives on CLEVRER's world: a change that only moves constants leaves all of them equal.

`python -m benchmarks.digests --proposals FILE.npz --videos DIR [-o FILE.json] [--compare EARLIER.json]`

With `--compare` it says which stages differ, and ends with status 1 if any does. Digests hold for one machine: other processors
and other versions of packages round otherwise. It takes two minutes of a core, and one more where functions are compiled anew.
"""

import hashlib
import random
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import torch

import nsdr
from benchmarks.shared import parser_of
from nsdr.clevrer import predictions_document, read_compact_proposals
from nsdr.generate import DatasetConfig, QuestionConfig, RenderConfig, render_preview, simulate_scene
from nsdr.generate.export.formats import FORMATS
from nsdr.generate.export.writing import PAIRS, ExportConfig, export_dataset
from nsdr.generate.render.view import view_of
from nsdr.generate.scene_files import solids_at
from nsdr.generate.violations import ViolationsConfig, generate_violations
from nsdr.io.decoding import find_videos
from nsdr.io.files import json_text, write_json
from nsdr.io.fingerprint import DIGITS, code_revision
from nsdr.io.reading import read_json
from nsdr.language.texts import TEXT_KINDS, draw_wording, in_words, read_paraphrases, sample
from nsdr.language.words import replacements
from nsdr.question_parser.language_model import examples
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

Stages = Iterator[tuple[str, Iterable[bytes]]]
"""Names of stages, each with what it gives."""
SCENES, JUDGED, FEW = 30, 10, 5
"""Scenes of official proposals: all, those that are judged, and those that networks explain."""
SEED, VIDEOS, FRAMES, FRAME = 500_000, 4, 8, 40
"""The first generated scene, generated videos, the frames of each, and the frame that is rendered and that changes begin at."""
TEXTS, NETWORK_TEXTS = 200, 50
"""Random texts, and texts that the networks parse."""
CHANGES = (
    [nsdr.Remove(2), nsdr.SetMass(1, factor=2.0)],
    [nsdr.SetVelocity(0, speed=2.0, direction=30.0), nsdr.Freeze(1)],
    [nsdr.Move(0, dx=0.1, dy=-0.2), nsdr.Add("purple", "rubber", "cube", 1.0, 2.0, vy=-1.0, yaw=0.5)],
)
QUESTIONS: dict[str, tuple[str, ...]] = {
    "How many metal objects are moving when the video ends?": (),
    "Is there a stationary rubber object when the {0} and the {1} collide?": (),
    "What color is the first object to collide with the {0}?": (),
    "How fast is the {0} moving when the video ends?": (),
    "Which direction is the {1} moving when the video ends?": (),
    "What causes the collision of the {0} and the {1}?": ("The presence of the {2}", "The {2} hits the {1}"),
    "What will happen next?": ("The {0} collides with the {1}", "The {2} and the {0} collide"),
    "Without the {0}, what will happen?": ("The {1} and the {2} collide", "The {2} exits the scene"),
}
"""Questions and options about the objects of a scene, first those of its first collision. An error counts like an answer."""


def stored(value: Any) -> bytes:
    """A value of `nsdr.types` as `nsdr.save` writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "value.json"
        nsdr.save(path, value)
        return path.read_bytes()


def attempted(function: Callable[..., bytes], *arguments: Any) -> bytes:
    """What a function returns, or the error that it raises."""
    try:
        return function(*arguments)
    except nsdr.NsdrError as e:
        return f"{type(e).__name__}: {e}".encode()


def contents(folder: Path, pattern: str) -> Iterator[bytes]:
    """Names and contents of files."""
    for path in sorted(folder.glob(pattern)):
        yield from (path.relative_to(folder).as_posix().encode(), path.read_bytes())


def language(_: Namespace) -> Stages:
    """Programs of the texts that ship, and random texts with their programs, also in words again."""
    texts = [row["text"] for row in read_paraphrases()]
    for name in ("spellings", "hedges", "phrases", "spellings_beyond", "contents"):
        texts += [line.text for line in replacements(name)]
    texts += [text for shown in examples(CLEVRER).values() for text in shown]
    for name, parser in {"programs": nsdr.GrammarParser(), "programs beyond": nsdr.GrammarParser(True)}.items():
        said = (found for kind in TEXT_KINDS for found in parser.parse_batch(texts, kind))
        yield name, (f"{found} {getattr(found, 'notes', ())}".encode() for found in said)
    rng = random.Random(0)
    drawn = [draw(TEXT_KINDS[n % 3], rng, CLEVRER) for n in range(TEXTS // 2) for draw in (sample, draw_wording)]
    yield "drawn texts", (json_text(row, "texts").encode() for row in drawn)
    written = partial(in_words, vocabulary=CLEVRER)
    yield "written texts", (attempted(lambda program: written(program).encode(), tokens) for _, tokens in drawn)


def of_proposals(options: Namespace) -> Stages:
    """From official proposals to answers and judgements, and what networks predict."""
    pipeline = nsdr.Pipeline.from_pretrained(device="cpu", config=nsdr.PipelineConfig(extensions=True))
    proposals = [found for _, found in islice(read_compact_proposals(options.proposals), SCENES)]
    seen = [pipeline.perceive(proposals=found) for found in proposals]
    yield "tracks", (stored(one.tracks) for one in seen)
    yield "scenes", (stored(one.scene) for one in seen)
    yield "predictions", (json_text(predictions_document(s.explanation.prediction), "sim").encode() for s in seen)
    yield "answers", (attempted(answered, pipeline, one.scene, *asked) for one in seen for asked in QUESTIONS.items())
    changed = ((one, changes) for one in seen[:FEW] for changes in CHANGES)
    yield "simulations", (attempted(lambda *given: stored(pipeline.simulate(*given, FRAME)), *row) for row in changed)
    yield "judgements", (stored(pipeline.judge(proposals=found)) for found in proposals[:JUDGED])
    for name in ("propnet", "propnet_patches"):
        pipeline.dynamics = nsdr.load_backend(name)
        yield name, (stored(pipeline.perceive(proposals=p).explanation.prediction) for p in proposals[:FEW])


def answered(pipeline: nsdr.Pipeline, scene: nsdr.Scene, question: str, options: Sequence[str]) -> bytes:
    """An answer with trace and probabilities, and the sentences that lead to it."""
    first = next(e.objects for e in scene.events if e.kind == "collision")
    names = [o.name for o in sorted(scene.objects, key=lambda o: o.id not in first)]
    text, *choices = (words.format(*names) for words in (question, *options))
    answer = pipeline.answer(scene, text, choices or None)
    return stored(answer) + nsdr.narrate(answer, scene, "long").encode()


def generated(_: Namespace) -> Stages:
    """A data set and its exports, pairs of videos of which one breaks a law, and a rendered frame."""
    common: dict[str, Any] = {"first_scene": SEED, "splits": {"train": 1.0}, "workers": 1}
    with tempfile.TemporaryDirectory() as temporary:
        root, broken = Path(temporary) / "set", Path(temporary) / "violations"
        asked, render = QuestionConfig(extensions=True, changed_per_video=1), RenderConfig(frames=FRAMES)
        config = DatasetConfig(str(root), VIDEOS, questions=asked, counterfactual_videos=1, render=render, **common)
        nsdr.generate_dataset(config)
        for kind in ("annotations", "derender_proposals", "truth", "questions", "counterfactual"):
            yield kind, contents(root, f"{kind}/**/*.json")
        texts = [
            name for name, form in FORMATS.items() if form.suffix == ".jsonl" and not form.n_frames
        ]  # there are no videos
        for form in (*texts, PAIRS):
            folder = Path(temporary) / form
            more: dict[str, Any] = {} if form == PAIRS else {"videos": "none", "reasoning": "long", "scenes": True}
            export_dataset(ExportConfig(str(root), str(folder), form, **more))
            yield f"export {form}", contents(folder, "questions/*.json" if form == PAIRS else "*.jsonl")
        common |= {"laws": ("identity", "friction"), "renderer": "none", "masks": False}
        generate_violations(ViolationsConfig(str(broken), 4, **common))
        yield "violations", contents(broken, "annotations/**/*.json")
    scene = simulate_scene(SEED, removals=False)
    frame = render_preview(scene.objects, solids_at(scene, FRAME), view_of(RenderConfig(), scene.seed, CLEVRER_WORLD))
    yield "rendered frame", [frame.tobytes()]


def networks(options: Namespace) -> Stages:
    """What the frame parser finds in the first video, and the programs of the networks that parse questions."""
    frame_parser = nsdr.FrameParser.from_pretrained("default", device="cpu", stride=4, precision="float32")
    yield "detections", [stored(frame_parser.parse(find_videos(options.videos)[0]))]
    parser, rows = nsdr.QuestionParser.from_pretrained("default", device="cpu"), read_paraphrases()
    texts = [row["text"] for row in rows[:: len(rows) // NETWORK_TEXTS]]
    yield "programs", (str(found).encode() for kind in TEXT_KINDS for found in parser.parse_batch(texts, kind))


PARTS = {"language": language, "proposals": of_proposals, "generated": generated, "networks": networks}


def digest(values: Iterable[bytes]) -> str:
    """The digest of values in their order."""
    parts = [hashlib.sha256(value).digest() for value in values]
    assert parts, "the stage gives nothing"
    return hashlib.sha256(b"".join(parts)).hexdigest()[:DIGITS]


def differing(before: Mapping[str, str], after: Mapping[str, str], parts: Sequence[str]) -> list[str]:
    """The stages of some parts whose digests are not the same in two results."""
    names = [name for name in {**before, **after} if name.partition(": ")[0] in parts]
    return [name for name in names if before.get(name) != after.get(name)]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--proposals", type=Path, required=True, help="compact official proposals, .npz")
    parser.add_argument("--videos", type=Path, required=True, help="folder; the frame parser sees its first video")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="all by default")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--compare", type=Path, help="digests of an earlier run")
    options = parser.parse_args()
    before = read_json(options.compare, dict[str, Any])["stages"] if options.compare else {}
    torch.set_num_threads(1)
    found, start = dict[str, str](), time.monotonic()
    for part in options.parts:
        for stage, values in PARTS[part](options):
            found[name := f"{part}: {stage}"] = digest(values)
            print(f"{found[name]}  {name} ({time.monotonic() - start:.0f} s)", flush=True)
    if options.output:
        write_json(options.output, {"revision": code_revision(), "stages": found}, indent=1)
    if options.compare:
        names = differing(before, found, options.parts)
        print("\n".join(f"differs: {name}" for name in names) or "no stage differs")
        sys.exit(bool(names))


if __name__ == "__main__":
    main()
