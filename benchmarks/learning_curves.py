"""Learning curves of trainings: how many answers about other videos are right, over the texts that were read.

`python benchmarks/learning_curves.py RUN... -o curves.png` draws `metrics.jsonl` of run folders of `nsdr train baseline`, one
line for each folder, one panel for each family of questions, and prints the last numbers as a table.
"""

import argparse
import json
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt

from nsdr.io.reading import read_json

PANELS = {
    "descriptive": "descriptive",
    "descriptive_query_color": "what color",
    "descriptive_query_material": "what material",
    "descriptive_query_shape": "what shape",
    "descriptive_exist": "is there any",
    "descriptive_count": "how many",
    "explanatory_per_option": "explanatory, per option",
    "predictive_per_option": "predictive, per option",
    "counterfactual_per_option": "counterfactual, per option",
}
"""Metrics of `nsdr train baseline`, and the titles of their panels."""


def evaluations(run: Path) -> list[dict[str, float]]:
    """The lines of a run's `metrics.jsonl` that hold an evaluation, with the texts read before it."""
    batch = read_json(run / "config.json")["config"]["loop"]["batch_size"]
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return [row | {"texts": row["step"] * batch} for row in rows if "descriptive" in row]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    matplotlib.use("Agg")
    figure, axes = plt.subplots(2, 5, figsize=(18, 7), sharex=True)
    print("|  | texts | CPU min | " + " | ".join(PANELS.values()) + " |\n|---|" + "---|" * (2 + len(PANELS)))
    for i, run in enumerate(options.runs):
        rows = evaluations(run)
        for axis, (metric, title) in zip(axes.flat, PANELS.items(), strict=False):
            drawn = [row for row in rows if metric in row]
            style = "-" if i < 10 else "--"
            axis.plot([r["texts"] / 1e6 for r in drawn], [100 * r[metric] for r in drawn], style, label=run.name)
            axis.set_title(title)
        last = rows[-1]
        numbers = [f"{100 * last[metric]:.1f}" if metric in last else "-" for metric in PANELS]
        print(f"| {run.name} | {last['texts']:,} | {last['cpu_seconds'] / 60:.0f} | " + " | ".join(numbers) + " |")
    for axis in axes.flat[: len(PANELS)]:
        axis.set_ylabel("right (%)")
        axis.set_xlabel("texts read (millions)")
        axis.grid(alpha=0.3)
    axes.flat[-1].axis("off")
    axes.flat[-1].legend(*axes.flat[0].get_legend_handles_labels(), loc="center")
    figure.tight_layout()
    figure.savefig(options.output, dpi=110)


if __name__ == "__main__":
    main()
