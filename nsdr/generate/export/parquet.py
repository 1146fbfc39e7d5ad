"""A folder that Hugging Face `datasets.load_dataset` reads: Parquet files, videos, and a card."""

from itertools import islice
from math import ceil
from typing import Any

from nsdr.generate.export.base import Export, Exporter
from nsdr.generate.export.card import write_card
from nsdr.io.files import atomic_path

__all__ = ["PARQUET"]

QUESTIONS_PER_FILE = 50_000
"""Questions of a Parquet file; they are in memory while it is written. CLEVRER's train split has 152,572."""


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
    write_card(export)


def _features(datasets: Any) -> Any:
    """The types of the columns: the attributes of `nsdr.generate.export.records.Record`.

    The video is a path, which every version of `datasets` and every training program reads: the type `Video` takes bytes
    inside of Parquet files (a copy for each of a video's 15 questions), and needs torchcodec.
    """
    text, number = datasets.Value("string"), datasets.Value("int64")
    tokens = datasets.List(text)
    return datasets.Features(
        {
            "id": text,
            "split": text,
            "scene_index": number,
            "question_id": number,
            "video": text,
            "question_type": text,
            "subtype": text,
            "question": text,
            "options": datasets.List(text),
            "letters": datasets.List(text),
            "prompt": text,
            "solution": text,
            "tags": datasets.List(text),
            "blind": datasets.List(datasets.Value("bool")),
            "program": tokens,
            "option_programs": datasets.List(tokens),
            "seed": number,
            "reasoning": text,
            "scene": text,
        }
    )


PARQUET = Exporter(_write, needs="datasets")
"""data/SPLIT-NUMBER-of-NUMBER.parquet with one row for each question, `videos/`, and README.md with the card."""
