"""How many narrated sentences are read back and hold, and how long that takes.

    python benchmarks/claims.py QUESTIONS.json --source truth --data FOLDER --videos 60

Questions that fail in the scene (where the source does not know what they need) are left out and counted.
"""

import argparse
import time
from collections import Counter
from itertools import islice
from pathlib import Path

from nsdr import Executor, NsdrError, Scene, narrate, verify
from nsdr.clevrer import read_questions
from nsdr.evaluation.sources import SOURCES


def main() -> None:
    """Print one line for each type of question, and the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("questions", type=Path)
    parser.add_argument("--source", default="truth")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--videos", type=int)
    args = parser.parse_args()
    scenes = list(islice(read_questions(args.questions), args.videos))
    source = SOURCES[args.source](args.data, {s.scene_index for s in scenes})
    counts: dict[str, Counter[str]] = {}
    seconds: Counter[str] = Counter()
    for row in scenes:
        scene = source(row)
        assert isinstance(scene, Scene)
        executor = Executor(scene)
        for q in row.questions:
            count = counts.setdefault(q.subtype or q.type, Counter())
            try:
                answer = (
                    executor.answer_choices(q.program, [(c.text, c.program) for c in q.choices])
                    if q.choices
                    else executor.answer(q.program)
                )
            except NsdrError:
                count["left out"] += 1
                continue
            count["questions"] += 1
            for length in ("short", "long"):
                start = time.process_time()
                text = narrate(answer, scene, length)
                told = time.process_time()
                found = verify(text, scene)
                seconds["narrate"] += told - start
                seconds["verify"] += time.process_time() - told
                count["sentences"] += len(text.splitlines()) - 1
                count["hold"] += sum(c.holds is True for c in found.claims)
    for kind, count in sorted(counts.items()):
        print(f"{kind:<16}", ", ".join(f"{name} {n}" for name, n in count.items()))
    total: Counter[str] = sum(counts.values(), Counter())
    print(f"{'all':<16}", ", ".join(f"{name} {n}" for name, n in total.items()))
    texts = max(2 * total["questions"], 1)
    narrated, verified = (1000 * seconds[name] / texts for name in ("narrate", "verify"))
    print(f"CPU time a text: narrate {narrated:.2f} ms, verify {verified:.2f} ms")


if __name__ == "__main__":
    main()
