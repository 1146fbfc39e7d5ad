"""The README's chart: the default system beside published ones, by type of question.

`python -m benchmarks.chart -o docs/images/results.png` draws the first row of `results/real_dev.json`, with its intervals, and
published accuracies.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from benchmarks.shared import parser_of
from nsdr.io.reading import read_json

TYPES = ("descriptive", "explanatory", "predictive", "counterfactual")
PUBLISHED = {
    "NS-DR": (88.1, 79.6, 68.7, 42.2),
    "DCL": (90.7, 82.8, 82.0, 46.5),
    "ALOE": (94.0, 96.0, 87.5, 75.6),
    "VRDP": (93.4, 91.9, 91.4, 84.3),
    "ODDN-Aloe": (95.8, 97.0, 91.8, 80.1),
    "CRCG over VRDP": (96.5, 98.8, 92.3, 90.7),
}
"""Accuracy (%) on CLEVRER's test split as published; of multiple choice, questions whose options are all judged rightly."""


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--table", type=Path, default=Path("results/real_dev.json"))
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    table = read_json(options.table)["rows"][0]["table"]
    keys = [("accuracy", "interval"), *[("per_question", "per_question_interval")] * 3]
    ours = 100 * np.array([table[kind][key] for kind, (key, _) in zip(TYPES, keys, strict=True)])
    ends = 100 * np.array([table[kind][interval] for kind, (_, interval) in zip(TYPES, keys, strict=True)])
    figure = Figure(figsize=(9, 3.4))
    axis = figure.subplots()
    step, x = 0.11, np.arange(len(TYPES))
    for k, (name, values) in enumerate(PUBLISHED.items()):
        axis.plot(
            x + (k - 3) * step,
            values,
            "o",
            label=f"{name} (test)",
            color=matplotlib.colormaps["Blues"](0.35 + 0.12 * k),
        )
    error = np.abs(ends.T - ours)
    axis.errorbar(
        x + 3 * step, ours, error, fmt="D", capsize=3, label="nsdr (held-out scenes of train)", color="darkorange"
    )
    for at, value in zip(x + 3 * step, ours, strict=True):
        axis.text(at + 0.05, value, f"{value:.1f}", va="center", fontsize=9)
    axis.set_xticks(x, TYPES)
    axis.set_ylim(40, 101)
    axis.set_ylabel("right, per question (%)")
    axis.grid(axis="y", alpha=0.3)
    axis.spines[["top", "right"]].set_visible(False)
    legend = {"ncols": 4, "fontsize": 7.5, "loc": "upper center", "bbox_to_anchor": (0.5, -0.1), "frameon": False}
    axis.legend(title="system (split of CLEVRER on which it was scored)", title_fontsize=7.5, **legend)
    figure.tight_layout()
    figure.savefig(options.output, dpi=130)


if __name__ == "__main__":
    main()
