"""MkDocs hook: fills the pages of docs/api, so that they follow the package by themselves.

A line `::: nsdr.room` of a package becomes one directive for each of its modules; `<!-- names -->` becomes the list of names of
`nsdr`.
"""

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
WITHOUT_MEMBERS = "    options:\n      members: false\n      show_root_heading: {heading}\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its directives expanded; called by MkDocs for every page."""
    markdown = re.sub(
        r"^::: (nsdr[\w.]*)$", lambda match: _directives(match[1], top=True), markdown, flags=re.MULTILINE
    )
    return markdown.replace("<!-- names -->", _names()) if "<!-- names -->" in markdown else markdown


def _directives(module: str, top: bool = False) -> str:
    folder = ROOT / module.replace(".", "/")
    names = sorted(p.stem for p in folder.glob("*") if p.suffix == ".py" or (p / "__init__.py").is_file())
    inner = [name for name in names if not name.startswith("_")]
    if not inner:
        return f"::: {module}\n"
    if not (folder / "__init__.py").read_text().strip():
        package = "" if top else f"## `{module}`\n"
    else:
        package = f"::: {module}\n{WITHOUT_MEMBERS.format(heading=str(not top).lower())}"
    return "\n".join([package, *(_directives(f"{module}.{name}") for name in inner)])


def _names() -> str:
    import nsdr

    lines = []
    for name in nsdr.__all__:
        value = getattr(nsdr, name)
        if hasattr(value, "__module__"):
            summary = (value.__doc__ or "").strip().splitlines()[0].replace("|", "\\|")
            lines.append(f"| [`{name}`][{value.__module__}.{name}] | {summary} |")
    return "\n".join(["| name | |", "|---|---|", *lines])
