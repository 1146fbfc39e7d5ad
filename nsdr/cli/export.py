"""`nsdr export`: a data set as files for training and testing other models."""

from typing import Any

from jsonargparse.typing import NonNegativeInt, PositiveInt

__all__ = ["add_options", "export"]


def add_options(commands: Any) -> None:
    """Add the command; `commands.add(name, summary, …)` adds one."""
    summary = (
        "write a data set as prompts and solutions, chats, a Hugging Face data set or WebDataset shards; resumable"
    )
    add = commands.add("export", summary, checkpoint=False).add_argument
    add("root", help="the data set's folder: generated, or in the official layout")
    add("--format", required=True, help="grpo, chat, parquet, webdataset, or an installed one")
    add("-o", "--output", required=True, help="folder to write")
    add("--split", nargs="+", default=[], help="which splits (default: train and validation, as far as they are there)")
    add("--questions", default="", help="question file of the one --split, in place of the data set's")
    add("--videos", default="copy", help="copy, link, or none (paths only)")
    add("--limit", type=NonNegativeInt, default=0, help="first n videos of each split; 0 for all")
    add("--shard-mb", type=PositiveInt, default=1000, help="webdataset: largest size of a shard (MB)")
    add(
        "--reasoning",
        default="",
        choices=["", "short", "long"],
        help="sentences that lead to each answer, from true scenes",
    )
    add("--scenes", action="store_true", help="the true scenes, too, for the reward trace_verified")
    add("--license", default="unknown", help="parquet: licence identifier for the card, such as cc-by-4.0")


def export(options: Any) -> int:
    """`nsdr export`."""
    from nsdr.generate.export import ExportConfig, export_dataset

    o = options
    config = ExportConfig(
        o.root,
        o.output,
        o.format,
        tuple(o.split),
        o.questions,
        o.videos,
        o.limit,
        o.shard_mb,
        o.license,
        o.reasoning,
        o.scenes,
    )
    for name, summary in export_dataset(config).items():
        print(f"{o.output}: {name}: {summary.questions} questions about {summary.videos} videos")
    return 0
