"""`nsdr figures`: distributions, program-count curve and samples; their looks are checked by eye."""

from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest

from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import Choice, Question, read_questions
from nsdr.cli.main import main
from nsdr.generate.statistics import RELEASED_QUESTIONS, count_questions
from nsdr.types import Answer, ChoiceAnswer
from nsdr.visualize import program_curve, question_figure, sample_image
from nsdr.visualize.samples import RIGHT_COLOR, WRONG_COLOR, _lines

ROOT = Path(__file__).parent.parent
ABLATION = ROOT / "results" / "question_parser_ablation.csv"


def bars(axes) -> list[list[float]]:
    return [[round(float(bar.get_height()), 1) for bar in group] for group in axes.containers]


def test_the_distribution_shows_types_sub_types_choices_and_answers_of_each_set() -> None:
    counts = count_questions(read_questions(QUESTIONS))
    figure = question_figure({"example": counts, "release": RELEASED_QUESTIONS})
    types, subtypes, choices, answers = figure.axes
    assert bars(types) == [[50.0, 20.0, 10.0, 20.0], [72.1, 11.0, 4.7, 12.2]]
    assert bars(subtypes)[1] == [36.4, 18.2, 16.8, 15.4, 13.3]
    assert len(bars(choices)[0]) == 4
    (shown,) = bars(answers)  # the release's were not counted
    kinds = sum(name.startswith("answers") for name in counts)
    assert sum(shown) == pytest.approx(100 * kinds, abs=1)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["example", "release"]
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


def test_the_curve_has_a_line_for_each_question_type() -> None:
    rows = [
        {"programs": size, "question_type": kind, "program_accuracy": a, "answer_accuracy": b}
        for size, kind, a, b in [("10", "descriptive", "0.1", "0.2"), ("all", "descriptive", "0.9", "1.0"),
                                 ("all", "predictive", "0.5", "0.6")]
    ]  # fmt: skip
    programs, answers = program_curve(rows).axes
    assert [line.get_label() for line in programs.lines] == ["descriptive", "predictive"]
    assert programs.lines[0].get_ydata().tolist() == pytest.approx([10, 90])
    assert answers.lines[1].get_xdata().tolist() == [1]  # of 10 and all
    assert [t.get_text() for t in programs.get_xticklabels()] == ["10", "all"]


def test_a_sample_marks_answers_by_the_ground_truth() -> None:
    choices = (Choice(0, "the presence of the cube", None, "correct"), Choice(1, "the cube's exit", None, "wrong"))
    question = Question(0, "Which?", "explanatory", None, None, None, choices)
    given = [ChoiceAnswer(c.text, "correct", (), (), probability=None) for c in choices]
    answer = Answer("Which?", ("events", "belong_to"), None, (), tuple(given), None)
    lines = _lines(question, answer)
    assert [line.text for line in lines] == [
        "Explanatory: Which?",
        "events belong_to",
        "the presence of the cube: correct ✓",
        "the cube's exit: correct ✗ (ground truth: wrong)",
    ]
    assert [line.style["color"] for line in lines[2:]] == [RIGHT_COLOR, WRONG_COLOR]
    picture = np.full((320, 480, 3), 128, np.uint8)
    image = sample_image(picture, [(question, answer)])
    assert image.shape[1] == 1050
    assert image.shape[0] > 700  # the picture's height
    assert abs(image[350, 500].astype(int) - 128).max() <= 1
    assert image[700:].std() > 10  # text on white
    unknown = Question(0, "What?", "descriptive", "count", None, None, ())
    assert _lines(unknown, Answer("What?", (), "2", (), (), None))[-1].text == "Answer: 2"


def test_the_command_writes_each_figure_whose_input_is_given(tmp_path, capsys) -> None:
    output = tmp_path / "new"
    samples = ["--samples", str(QUESTIONS), "--videos", str(VIDEO.parent), "--show", "500002:13", "500002:14"]
    both = ["--questions", str(QUESTIONS), "--ablation", str(ABLATION)]
    assert main(["figures", *both, *samples, "-o", str(output)]) == 0
    names = ["question_distribution.png", "program_curve.png", "sample_500002.jpg"]
    assert capsys.readouterr().out.splitlines() == [str(output / name) for name in names]
    for name in names:
        assert cv2.imread(str(output / name)).std() > 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected some of --questions, --ablation and --samples"),
        (["--ablation", "QUESTIONS"], "not the CSV file of an ablation"),
        (["--questions", "QUESTIONS", "--show", "1:2"], "--show would do nothing without --samples; leave it out"),
        (["--samples", "QUESTIONS"], "--samples needs --videos FOLDER and --show SCENE:QUESTION"),
        (
            ["--samples", "QUESTIONS", "--videos", ".", "--show", "5"],
            "--show 5: expected SCENE:QUESTION, such as 500002:13",
        ),
        (["--samples", "QUESTIONS", "--videos", ".", "--show", "5:1"], "has no such scene"),
        (["--samples", "QUESTIONS", "--videos", ".", "--show", "500002:99"], "has no such question"),
    ],
)
def test_what_cannot_be_drawn_is_refused(arguments, message, tmp_path, capsys) -> None:
    arguments = [a.replace("QUESTIONS", str(QUESTIONS)) for a in arguments]
    assert main(["figures", *arguments, "-o", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


def test_the_gallery_has_its_pictures() -> None:
    page = (ROOT / "docs" / "gallery.md").read_text()
    folder = ROOT / "docs" / "images" / "gallery"
    names = sorted(path.name for path in folder.iterdir())
    assert len(names) >= 4
    assert all(f"(images/gallery/{name})" in page for name in names)
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1.5e6
