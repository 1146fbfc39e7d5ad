"""A folder that Hugging Face `datasets.load_dataset` reads: Parquet files, videos, and a card (README.md) for the Hub."""

from collections.abc import Mapping
from dataclasses import fields
from itertools import islice
from math import ceil
from typing import Any

import yaml

from nsdr.generate.export.base import Export, Exporter
from nsdr.generate.export.records import Record
from nsdr.generate.statistics import count_questions
from nsdr.io.files import atomic_path

__all__ = ["PARQUET"]

QUESTIONS_PER_FILE = 50_000
"""Questions of a Parquet file; they are in memory while it is written. CLEVRER's train split has 152,572."""
SIZES = {1_000: "n<1K", 10_000: "1K<n<10K", 100_000: "10K<n<100K", 1_000_000: "100K<n<1M", 10_000_000: "1M<n<10M"}
"""The Hub's names of sizes, by the number of questions from which the next one holds."""
FIELDS = """\
| column | content |
|---|---|
| `id` | `SCENE_INDEX-QUESTION_ID` |
| `split`, `scene_index`, `question_id` | the video's split and index, the question's id within the video |
| `video` | path of the video, {videos} |
| `question_type`, `subtype` | descriptive (with its subtype), explanatory, predictive or counterfactual |
| `question`, `options`, `letters` | texts; a descriptive question has no options |
| `prompt` | question, options and how to answer |
| `solution` | the right answer, such as `<answer>A,C</answer>`, `<answer>none</answer>` or `<answer>red</answer>`; null if unknown |
| `tags` | of each counterfactual option: `observational` (the recording without the removed object has the answer) or `inferential`; null if unknown |
| `blind` | of each option, or of the descriptive question: whether texts alone predict the answer; null if unknown |
| `program`, `option_programs` | postfix tokens, or null |
| `seed` | number of the simulated scene; null for CLEVRER's own videos |
| `reasoning`, `scene` | sentences that lead to the solution, and the path of the true scene; null if not exported |
"""  # noqa: E501  # one column a line
CARD = """\
---
{metadata}---

# Videos of colliding objects with questions

Videos and questions {origin}, exported by `nsdr export`.

{license}

```python
from datasets import load_dataset

data = load_dataset("FOLDER")
```

## Columns

{fields}
## Statistics

{statistics}
"""


def _write(export: Export) -> None:
    import datasets

    features = _features(datasets)
    for split, summary in export.splits.items():
        n_files = ceil(summary.questions / QUESTIONS_PER_FILE)
        rows = (record.row() for record in export.records(split))
        for number in range(n_files):
            path = export.folder / "data" / f"{split}-{number:05d}-of-{n_files:05d}.parquet"
            chunk = list(islice(rows, QUESTIONS_PER_FILE))
            if not path.exists():
                with atomic_path(path) as temporary:
                    datasets.Dataset.from_list(chunk, features=features).to_parquet(temporary)
    with atomic_path(export.folder / "README.md") as temporary:
        temporary.write_text(_card(export), encoding="utf-8")


def _features(datasets: Any) -> Any:
    """The types of the columns: the attributes of `nsdr.generate.export.records.Record`.

    The video is a path, which every version of `datasets` and every training program reads: the type `Video` takes bytes
    inside of Parquet files (a copy for each of a video's 15 questions), and needs torchcodec.
    """
    text, number, flag = (datasets.Value(name) for name in ("string", "int64", "bool"))
    texts = datasets.List(text)
    types = dict.fromkeys((field.name for field in fields(Record)), text)
    types |= dict.fromkeys(("scene_index", "question_id", "seed"), number)
    types |= dict.fromkeys(("options", "letters", "tags", "program"), texts)
    return datasets.Features(types | {"blind": datasets.List(flag), "option_programs": datasets.List(texts)})


def _card(export: Export) -> str:
    identifier = export.config.license
    total = sum(summary.questions for summary in export.splits.values())
    files = [{"split": split, "path": f"data/{split}-*.parquet"} for split in export.splits]
    metadata = {
        "pretty_name": "Videos of colliding objects with questions",
        "license": identifier,
        "language": ["en"],
        "task_categories": ["video-text-to-text", "visual-question-answering"],
        "tags": ["clevrer", "synthetic"] if export.is_generated else ["clevrer"],
        "size_categories": [next(name for limit, name in SIZES.items() if total < limit)],
        "configs": [{"config_name": "default", "data_files": files}],
    }
    statistics = ["| split | videos | questions | without answers |", "|---|---|---|---|"]
    statistics += [f"| {n} | {s.videos} | {s.questions} | {s.unanswered} |" for n, s in export.splits.items()]
    for split in export.splits:
        for title, values in count_questions(export.questions(split)).items():
            if any(key != "None" and value for key, value in values.items()):
                statistics += ["", *_table(f"{split}: {title}", values)]
    where = "relative to the original data set's folder" if export.config.videos == "none" else "relative to this file"
    return CARD.format(
        metadata=yaml.safe_dump(metadata, sort_keys=False),
        origin="generated by `nsdr generate dataset`"
        if export.is_generated
        else "of CLEVRER (http://clevrer.csail.mit.edu)",
        license="Licence: not stated (`nsdr export --license` states one)."
        if identifier == "unknown"
        else f"Licence: {identifier}.",
        fields=FIELDS.format(videos=where),
        statistics="\n".join(statistics),
    )


def _table(title: str, values: Mapping[str, float]) -> list[str]:
    cells = " | ".join(f"{value:.0f}" for value in values.values())
    return [f"### {title.capitalize()}", "", f"| {' | '.join(values)} |", "|---" * len(values) + "|", f"| {cells} |"]


PARQUET = Exporter(_write, needs="datasets")
"""data/SPLIT-NUMBER-of-NUMBER.parquet with one row for each question, `videos/`, and README.md with the card."""
