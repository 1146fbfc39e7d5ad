"""Runs notebooks and keeps their outputs, so that they can be read without being run (`make notebooks`).

Streams of warnings, times, and the names of temporary folders are left out.
"""

import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

TEMPORARY = re.compile(rf"{re.escape(tempfile.gettempdir())}/tmp\w+/?")


def main(files: list[str]) -> None:
    for path in map(Path, files):
        notebook = nbformat.read(path, as_version=4)
        NotebookClient(
            notebook, timeout=None, record_timing=False, resources={"metadata": {"path": path.parent}}
        ).execute()
        for cell in notebook.cells:
            outputs = [o for o in cell.get("outputs", ()) if o.get("name") != "stderr"]
            for output in outputs:
                if output.output_type == "stream":
                    output.text = TEMPORARY.sub("", output.text)
                output.pop("execution_count", None)
                if output.output_type == "execute_result":
                    output.execution_count = None
            if cell.cell_type == "code":
                cell.outputs, cell.execution_count = outputs, None
        notebook.metadata.language_info = {"name": "python"}
        path.write_text(nbformat.writes(notebook).rstrip("\n") + "\n", encoding="utf-8")
        print(path, path.stat().st_size // 1000, "kB")


if __name__ == "__main__":
    main(sys.argv[1:])
