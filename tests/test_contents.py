"""Texts that have no reading are read by what they mention; contents that no program has are refused."""

import pytest

from nsdr.language.texts import in_words
from nsdr.question_parser.contents import content_readings
from nsdr.world.vocabulary import CLEVRER


@pytest.mark.parametrize(
    ("text", "question"),
    [
        (
            "When the red block comes in, there is a green object in motion: what shape is it?",
            "What is the shape of the moving green object when the red cube enters the scene?",
        ),
        (
            "The cylinder leaves. At that moment, what is the green thing in motion made of?",
            "What is the material of the moving green object when the cylinder exits the scene?",
        ),
        (
            "The video begins and a cylinder is at rest. Its colour?",
            "What is the color of the stationary cylinder when the video begins?",
        ),
        (
            "Among the objects that collide with the brown ball, what shape is the first one?",
            "What is the shape of the first object to collide with the brown sphere?",
        ),
        (
            "Something bumps into the metal cube - what shape does it have?",
            "What is the shape of the object to collide with the metal cube?",
        ),
        (
            "Of the objects that come in, which material is the last one made of?",
            "What is the material of the last object that enters the scene?",
        ),
        (
            "Once the sphere has entered, do any rubber cylinders leave after that?",
            "Are there any rubber cylinders that exit the scene after the sphere enters the scene?",
        ),
        (
            "The yellow cylinder enters. How many collisions are there after that?",
            "How many collisions happen after the yellow cylinder enters the scene?",
        ),
    ],
)
def test_questions_in_any_order(text: str, question: str) -> None:
    assert [in_words(program, CLEVRER) for program in content_readings(text, "descriptive", CLEVRER)] == [question]


@pytest.mark.parametrize(
    ("text", "question"),
    [
        (
            "The red thing hits the green thing - which of these is the cause?",
            "Which of the following is responsible for the collision between the red object and the green object?",
        ),
        (
            "The sphere leaves. Which of these is not a cause of that?",
            "Which of the following is not responsible for the sphere's exit?",
        ),
        ("Someone removes the ball. Which event is going to happen?", "What will happen without the sphere?"),
        ("If one takes out the cube, which event would not take place?", "What will not happen without the cube?"),
    ],
)
def test_multiple_choice_in_any_order(text: str, question: str) -> None:
    assert [in_words(program, CLEVRER) for program in content_readings(text, "multiple_choice", CLEVRER)] == [question]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("What color is the object on the left that is moving?", "descriptive"),
        ("Which shape has the object that hits the moving cube?", "descriptive"),
        ("What color is the object that moves before the cube enters?", "descriptive"),
        ("How many objects enter and then exit?", "descriptive"),
        ("The red cube hits the blue cube. What color does it have?", "descriptive"),
        ("An object hits the red cube. What is the color of the cube?", "descriptive"),
        ("What is the color or the shape of the moving object?", "descriptive"),
        ("What color is the first moving object?", "descriptive"),
        ("Are the cubes moving?", "descriptive"),
        ("cubes how many are moving", "descriptive"),
        ("Then what color is the moving object at that time?", "descriptive"),
        ("How many collisions happen because of the cube?", "descriptive"),
        ("What did the cube's exit cause?", "multiple_choice"),
        ("What is caused by the cube's exit?", "multiple_choice"),
        ("Which event does the collision between the red cube and the blue sphere not cause?", "multiple_choice"),
        ("Which events will the entrance of the red cube not cause?", "multiple_choice"),
        ("What does the red cube entering not cause?", "multiple_choice"),
        ("The sphere did not exit. Which of these is responsible?", "multiple_choice"),
        ("What would happen if the sphere was not removed?", "multiple_choice"),
        ("What will happen and will not happen without the cube?", "multiple_choice"),
        ("What happens if the cube and the sphere are removed?", "multiple_choice"),
        ("the cube the sphere collide", "choice"),
    ],
)
def test_other_contents_have_no_program(text: str, kind: str) -> None:
    assert content_readings(text, kind, CLEVRER) == []
