"""What the docs tell people to do: commands have their options, and examples print what stands below them."""

import ast
import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import nsdr
from nsdr.cli.main import main

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
CODE = sorted((ROOT / "nsdr").rglob("*.py"))
EXAMPLES = (
    "README.md",
    *(
        f"docs/{name}.md"
        for name in ("quickstart", "evaluate", "interventions", "page", "rewards", "scoring", "your_own_video")
    ),
)
"""Pages whose Python runs as it stands; that of docs/export.md and docs/plugins.md has tests of its own."""
ANYWHERE = ("--field", "--from", "--help", "--keep-going", "-o")
"""What is in no list of options: a placeholder, and what `generate` and `data features` read before their configuration."""
GUIDES = ("README.md", "docs/quickstart.md", "docs/interventions.md")
"""Pages whose commands run as they stand, with the demo's clip as VIDEO."""
NEEDS_DATA = re.compile(r"…|[|\[]|\b[A-Z]{3,}\b|\.yaml")
"""What is in commands that need data or more than a test's time."""
CLIP = "nsdr/clevrer/example/video_500002.mp4"
NEEDS_MORE = "from trl import"
"""What is in an example that needs an extra which tests do not have."""


@cache
def promised() -> set[str]:
    return set((ROOT / "docs" / "public_api.txt").read_text().splitlines())


def commands(page: Path) -> list[str]:
    """Each `nsdr …` in code, on one line and without comments."""
    text, fence = page.read_text(encoding="utf-8"), re.compile(r"^```\w*\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
    lines = re.sub(r"\\?\n +(?=[-[])", " ", "\n".join(fence.findall(text))).splitlines()
    inline = [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", fence.sub("", text))]
    found = [re.split(r" # |;|\| ", line)[0] for line in [*lines, *inline]]
    return [m[1] for line in found if (m := re.search(r"^(?:\.venv/bin/)?(nsdr [a-z].*)", line.strip()))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_their_options_exist(page: Path) -> None:
    known = {line for line in promised() if line.startswith("nsdr ")}
    names = {line.partition(" -")[0] for line in known}
    for command in commands(page):
        words = command.split()
        name = next((n for k in (3, 2) if (n := " ".join(words[:k])) in names), " ".join(words[:2]))
        of_name = {
            line for line in known if line == name or line.startswith(f"{name} ")
        }  # of any part, where it has some
        assert of_name, f"{page.name}: {command}"
        for option in re.findall(r"(?<![\w.-])--?[a-z][\w-]*(?![\w.]*\.)", re.sub(r"'[^']*'", "", command)):
            exists = option in ANYWHERE or any(line.endswith(f" {option}") for line in of_name)
            assert exists, f"{page.name}: {option} in {command}"


SAYS_NOTES = ("note", "with_notes", "Reason")
"""Functions whose arguments are notes, or reasons that become notes."""
NOTE_LISTS = ("notes", "warned", "refused", "unfit")
"""Lists that notes are added to."""
SHORTEST_PIECE, COMPARED = 5, 20
"""Length of the shortest fixed piece of a note that is looked for on the page, and of its beginning that is compared."""


def note_texts(node: ast.AST) -> list[str]:
    """The longest fixed piece of each text in a piece of code that makes a note, and does not only pass it on."""
    parts: list[ast.AST] = []
    if isinstance(node, ast.FunctionDef):  # such as `size_notes`
        gives_notes = node.name.endswith("_notes") and node.returns is not None
        parts = [*node.body[1:]] if gives_notes and "str" in ast.unparse(node.returns) else []
    elif isinstance(node, ast.AugAssign):
        parts = [node.value] if ast.unparse(node.target) in NOTE_LISTS else []
    elif isinstance(node, ast.Call):
        name = ast.unparse(node.func)
        is_note = name.split(".")[-1] in SAYS_NOTES or name in [f"{known}.append" for known in NOTE_LISTS]
        parts = [*node.args] if is_note else []
    texts = [t for part in parts for t in ast.walk(part) if isinstance(t, ast.JoinedStr)]
    pieces = [[v.value for v in t.values if isinstance(v, ast.Constant)] for t in texts]
    inside = {id(c) for part in parts for t in ast.walk(part) if isinstance(t, ast.JoinedStr) for c in ast.walk(t)}
    constants = [t for part in parts for t in ast.walk(part) if isinstance(t, ast.Constant) and id(t) not in inside]
    pieces += [[t.value] for t in constants if isinstance(t.value, str)]
    return [max(p, key=len) for p in pieces if p and len(max(p, key=len)) >= SHORTEST_PIECE]


def test_every_note_is_in_the_list() -> None:
    """What a module notes stands on the page; what the page quotes from a module stands in its code."""
    page = (ROOT / "docs" / "notes.md").read_text().partition("## All notes")[2]
    rows = re.findall(r"^\| (`.*`) \|.*\| `(nsdr[\w.]+)` \|$", page, flags=re.MULTILINE)
    sources = {path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."): path.read_text() for path in CODE}
    found = {m: [t for n in ast.walk(ast.parse(code)) for t in note_texts(n)] for m, code in sources.items()}
    assert {module for module, texts in found.items() if texts} == {module for _, module in rows}
    for module, texts in found.items():
        quoted = "\n".join(notes for notes, of in rows if of == module)
        for text in texts:
            assert text.strip()[:COMPARED] in quoted, f"{module}: {text!r} is not in docs/notes.md"
    for notes, module in rows:
        for note in re.findall(r"`([^`]+)`", notes):
            fixed = max(re.split(r"\b[A-Z]+\b|WxH|\d+(?:x\d+)?|…|['(;:]", note), key=len).strip()
            assert fixed in re.sub(r'"\s*f?"', "", sources[module]), f"{note}: not in {module}"


RUNNABLE = [
    (page, command)
    for page in GUIDES
    for written in commands(ROOT / page)
    if not NEEDS_DATA.search(command := written.replace("VIDEO", CLIP)) and (CLIP in command or "--data" in command)
]


def test_each_guide_has_commands_that_run() -> None:
    assert {page for page, _ in RUNNABLE} == set(GUIDES)


@pytest.fixture(scope="module")
def kept_pipelines() -> Iterator[None]:
    """Pipelines are made once for the same arguments, so that the clip is looked at once."""
    make, kept = nsdr.Pipeline.from_pretrained, dict[str, nsdr.Pipeline]()

    def made(*given: Any, **options: Any) -> nsdr.Pipeline:
        key = repr((given, options))
        if key not in kept:
            kept[key] = make(*given, **options)
        return kept[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nsdr.Pipeline, "from_pretrained", made)
        yield


@pytest.mark.docs
@pytest.mark.parametrize(("page", "command"), RUNNABLE, ids=[c for _, c in RUNNABLE])
def test_commands_run_and_print_what_the_page_says(
    page: str, command: str, kept_pipelines, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    example = "nsdr/clevrer/example"
    assert main(shlex.split(command.replace(example, (ROOT / example).as_posix()))[1:]) == 0
    said = re.search(
        r"The command prints:\n\n```\n(.*?)^```", (ROOT / page).read_text(), flags=re.MULTILINE | re.DOTALL
    )
    if said and "what_if.json" in command:
        assert capsys.readouterr().out == said[1]


def examples(page: str) -> list[tuple[str, str | None]]:
    """The Python of a page, each with the output that follows it, if any."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"^```py(?:thon)?\n(.*?)^```\n(?:\n```\n(.*?)^```)?", text, flags=re.MULTILINE | re.DOTALL)
    return [(code, output or None) for code, output in found if NEEDS_MORE not in code]


@pytest.mark.docs
@pytest.mark.parametrize("page", EXAMPLES)
def test_examples_print_what_the_page_says(page: str, kept_pipelines, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)  # where examples save what they make
    names: dict[str, Any] = {"__name__": "example"}
    for code, output in examples(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(code, names)
        if output is not None:
            assert printed.getvalue() == output
