"""Which code a run or a measurement was made with."""

import subprocess
from pathlib import Path

import nsdr

__all__ = ["code_revision"]


def code_revision() -> str:
    """The git commit of this checkout (with `+changes` when the package has uncommitted ones), else the package's version."""
    folder = Path(__file__).resolve().parents[1]
    try:
        head = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], cwd=folder, capture_output=True, text=True, check=True
        )
        dirty = subprocess.run(
            ["git", "status", "--porcelain", "."], cwd=folder, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return nsdr.__version__
    return head.stdout.strip() + ("+changes" if dirty.stdout.strip() else "")
