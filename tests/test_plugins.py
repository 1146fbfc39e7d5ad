"""The worked example of docs/plugins.md runs as it stands there."""

import re
from pathlib import Path

import nsdr
from nsdr.clevrer.example import VIDEO

PAGE = Path(__file__).parent.parent / "docs" / "plugins.md"


def test_a_dynamics_model_of_ones_own_answers_questions() -> None:
    code = re.search(r"<!-- example -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert code is not None
    assert len([line for line in code[1].splitlines() if line.strip()]) <= 22
    names: dict[str, object] = {}
    exec(code[1], names)
    pipeline = nsdr.Pipeline.from_pretrained()
    pipeline.dynamics = names["StraightOn"]()  # type: ignore[operator]
    assert pipeline.answer(VIDEO, "How many collisions happen?").answer == "0"
    answer = pipeline.answer(VIDEO, "What will happen next?", ["The brown cube collides with the purple cube"])
    assert len(answer.choices) == 1
