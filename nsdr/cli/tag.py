"""`nsdr tag`: marks the questions that the recording alone, or the text alone, answers."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, SceneQuestions, read_questions, write_questions
from nsdr.errors import DataError
from nsdr.io.files import check_output

__all__ = ["tag"]


def tag(options: Any) -> int:
    """`nsdr tag`: add `tag` and `blind` to a question file, and print how many have each."""
    if options.no_blind and options.train:
        raise DataError(
            "--train is what texts are learned from and would do nothing with --no-blind; leave one of them out"
        )
    if options.no_blind and not options.truth:
        raise DataError("--no-blind without --truth leaves nothing to tag; give --truth, or leave out --no-blind")
    inputs = [options.questions, *options.truth, *([options.train] if options.train else [])]
    check_output(options.output, [".json"], inputs)
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
            scenes = tag_blind(scenes, training, options.seed)
        except DataError as e:
            learned = f" with --train {options.train}" if options.train else ""
            raise DataError(f"{options.questions}{learned}: {e}") from e
    write_questions(options.output, scenes)
    print("\n".join(_shares(scenes)))
    return 0


def _with_tags(scenes: Sequence[SceneQuestions], truth: Iterable[str], file: str) -> list[SceneQuestions]:
    from nsdr.baselines.recording import tag_options
    from nsdr.clevrer.files.scene_files import iterate_scenes

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
