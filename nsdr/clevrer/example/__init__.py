"""The example that ships with the package: a rendered CLEVRER-like video, its true scene, and questions of all types."""

from importlib.resources import files
from pathlib import Path

__all__ = ["QUESTIONS", "TRUTH", "VIDEO"]

_FOLDER = Path(str(files(__name__)))
VIDEO = _FOLDER / "video_500002.mp4"
"""The video."""
TRUTH = _FOLDER / "scene_500002.json"
"""The true scene, for `nsdr.load(TRUTH)`."""
QUESTIONS = _FOLDER / "questions_500002.json"
"""The question file, for `nsdr.clevrer.read_questions`."""
