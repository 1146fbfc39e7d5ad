"""Texts a second of the default question parser: a file's distinct texts.

`python benchmarks/parsing.py QUESTIONS.json`; CPU time on one thread, without loading.
"""

import argparse
import time
from pathlib import Path

from nsdr.clevrer.files.questions import read_questions
from nsdr.question_parser.grammar import GrammarParser


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("questions", type=Path)
    options = parser.parse_args()
    texts: dict[str, list[str]] = {"descriptive": [], "multiple_choice": [], "choice": []}
    for question in (q for scene in read_questions(options.questions) for q in scene.questions):
        texts["descriptive" if question.type == "descriptive" else "multiple_choice"].append(question.text)
        texts["choice"] += [choice.text for choice in question.choices]
    distinct = {kind: list(dict.fromkeys(listed)) for kind, listed in texts.items()}
    question_parser = GrammarParser()
    question_parser.parse_batch(distinct["choice"][:1], "choice")  # warms up
    start = time.process_time()
    for kind, listed in distinct.items():
        question_parser.parse_batch(listed, kind)
    at_once = time.process_time() - start
    n, n_distinct = (sum(len(listed) for listed in t.values()) for t in (texts, distinct))
    print(f"{n} texts, {n_distinct} distinct: {at_once:.1f} s, {n / at_once:.0f} texts/s")


if __name__ == "__main__":
    main()
