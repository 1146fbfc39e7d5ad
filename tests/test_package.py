import importlib
import inspect
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

import nsdr
from nsdr import CheckpointError, DataError
from nsdr.io.checkpoint import find_checkpoint, load_checkpoint, save_checkpoint, start_from
from nsdr.io.shipped import find_config
from nsdr.pipeline_config import pipeline_settings
from nsdr.question_parser.model import QuestionParserConfig


def test_public_names_exist_and_have_docstrings() -> None:
    assert len(nsdr.__all__) == len(set(nsdr.__all__))
    for name in nsdr.__all__:
        assert getattr(nsdr, name).__doc__, name
    assert set(dir(nsdr)) == set(nsdr.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        nsdr.nothing  # noqa: B018


def test_version_is_the_packages() -> None:
    assert version("nsdr") == nsdr.__version__
    citation = yaml.safe_load((Path(__file__).parents[1] / "CITATION.cff").read_text())
    assert str(citation["version"]) == nsdr.__version__


def test_other_machines_run_the_same_steps() -> None:
    root = Path(__file__).parents[1]
    jobs = yaml.safe_load((root / ".github" / "workflows" / "ci.yml").read_text())["jobs"]
    commands = " ".join(step.get("run", "") for job in jobs.values() for step in job["steps"])
    targets = set(re.findall(r"make ([\w-]+)", commands))
    assert targets == {"check", "docs", "robustness", "browser", "wheel-check"}
    makefile = (root / "Makefile").read_text()
    assert all(f"\n{target}:" in makefile for target in targets)
    hooks = yaml.safe_load((root / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    tools = {hook["entry"].split()[0].removeprefix(".venv/bin/") for hook in hooks}
    assert all(f"$(BIN)/{tool}" in makefile for tool in tools)


def test_import_is_light() -> None:
    code = "import nsdr, sys; sys.exit(any(m in sys.modules for m in ('torch', 'cv2', 'numpy')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_using_does_not_load_training() -> None:
    code = "import nsdr.pipeline, nsdr.cli.main, nsdr.evaluation.score, sys; sys.exit('nsdr.training' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_checkpoints_are_found_by_path_variable_and_checkout(tmp_path, monkeypatch) -> None:
    assert find_checkpoint("default").name == "default"
    assert find_checkpoint(tmp_path) == tmp_path
    (tmp_path / "mine").mkdir()
    monkeypatch.setenv("NSDR_CHECKPOINTS", str(tmp_path))
    assert find_checkpoint("mine") == tmp_path / "mine"


@pytest.mark.parametrize(
    "package", ["lib/python3.13/site-packages", "Lib/site-packages", "local/lib/python3.13/dist-packages", ""]
)
def test_checkpoints_of_a_wheel_are_found_wherever_pip_puts_it(package, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("nsdr.io.shipped.__file__", str(tmp_path / package / "nsdr" / "io" / "shipped.py"))
    shipped = tmp_path / ("local" if package.startswith("local") else "") / "share" / "nsdr" / "checkpoints" / "default"
    shipped.mkdir(parents=True)
    assert find_checkpoint("default") == shipped.resolve()


def test_the_wheel_has_every_checkpoint_and_file_of_data() -> None:
    root = Path(__file__).parents[1]
    setuptools = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    weights = {path: path.parent.relative_to(root).as_posix() for path in (root / "checkpoints").rglob("*.safetensors")}
    shipped = {f"share/nsdr/{folder}" for folder in weights.values()}
    optional = {
        f"share/nsdr/{folder}" for path, folder in weights.items() if path.stat().st_size > 10e6
    }  # docs/release.md
    settings = {"share/nsdr/configs/pipeline", "share/nsdr/configs/worlds"}
    assert shipped - optional | settings <= set(setuptools["data-files"]) <= shipped | settings
    for target, (pattern,) in setuptools["data-files"].items():
        assert f"share/nsdr/{pattern}" == f"{target}/*"
    packaged = {
        path
        for package, patterns in setuptools["package-data"].items()
        for pattern in patterns
        for path in (root / "nsdr").rglob(pattern)
        if package in ("*", ".".join(path.parent.relative_to(root).parts))
    }
    files = {path for path in (root / "nsdr").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert {path for path in files if path.suffix != ".py"} == packaged


@pytest.mark.parametrize("package", ["lib/python3.13/site-packages", "local/lib/python3.13/dist-packages"])
def test_configurations_of_a_wheel_are_found_by_name(package, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("nsdr.io.shipped.__file__", str(tmp_path / package / "nsdr" / "io" / "shipped.py"))
    shipped = tmp_path / ("local" if package.startswith("local") else "") / "share" / "nsdr" / "configs" / "pipeline"
    shipped.mkdir(parents=True)
    shutil.copy(Path(__file__).parents[1] / "configs" / "pipeline" / "paper.yaml", shipped)
    assert pipeline_settings("paper").dynamics.backend == "propnet_patches"
    with pytest.raises(DataError, match=r"no configuration .papier. ships; expected a YAML file, or one of paper$"):
        pipeline_settings("papier")
    assert find_config("mine/paper", "pipeline") == Path("mine/paper")
    assert find_config("mine.yaml", "pipeline") == Path("mine.yaml")
    named = r"^configs/pipeline/paper\.yaml: no such file; .*: --config paper$"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=named):
        pipeline_settings("configs/pipeline/paper.yaml")


def test_every_name_of_a_configuration_in_the_docs_is_found() -> None:
    root = Path(__file__).parents[1]
    groups = {"generate": "generate", "train frame-parser": "frame_parser", "train question-parser": "question_parser"}
    groups |= {"train dynamics": "dynamics", "train collisions": "dynamics", "train baseline": "baselines"}
    groups |= {"data features": "baselines", "answer": "pipeline", "evaluate": "pipeline"}
    found = []
    for page in (root / "README.md", *(root / "docs").glob("*.md")):
        for command, name in re.findall(
            r"nsdr ((?:train |data )?[\w-]+)[^`\n]*? --config ([\w/]+)(?![\w/$])", page.read_text(encoding="utf-8")
        ):
            if name not in ("NAME", "FILE"):
                found.append(find_config(name, groups[command]))
    assert len(found) > 15
    assert all(file.is_file() for file in found)


def test_a_missing_checkpoint_says_where_it_was_looked_for(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("NSDR_CHECKPOINTS", str(tmp_path))
    with pytest.raises(CheckpointError, match=r"no checkpoint 'none'.*set NSDR_CHECKPOINTS"):
        find_checkpoint("none")


def test_weights_that_no_training_makes_are_refused(tmp_path) -> None:
    import torch

    for value, reason in (
        (torch.tensor([1.0, float("nan")]), "not all finite"),
        (torch.zeros(2, 2), "all zero"),
        (torch.ones(2, dtype=torch.int8), r"expected floating-point numbers or int64, got torch\.int8"),
    ):
        save_checkpoint(tmp_path, "question_parser", {"a": value}, QuestionParserConfig(), {})
        with pytest.raises(CheckpointError, match=rf"question_parser\.safetensors: a: {reason}"):
            load_checkpoint(tmp_path, "question_parser")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda d, s: s.pop("choice.words.weight"), r"Missing key\(s\) in state_dict: \"choice\.words\.weight\""),
        (lambda d, s: s.update(more=s["choice.words.weight"]), r"Unexpected key\(s\) in state_dict: \"more\""),
        (
            lambda d, s: s.update({"choice.words.weight": s["choice.words.weight"].long() + 1}),
            r"choice\.words\.weight: expected torch\.float32, got torch\.int64",
        ),
        (lambda d, s: d["config"].update(hidden=65536), "size mismatch"),
        (lambda d, s: d["config"].update(hidden="many"), "hidden"),
        (lambda d, s: d["config"].update(zebra=1), r"found one of other settings \(zebra\)"),
        (lambda d, s: d["config"].pop("layers"), r"found one of other settings \(layers\)"),
        (lambda d, s: d.update(words=d["words"][1:]), "size mismatch"),
        (lambda d, s: d.update(words=["a"] * 5), "words: expected at least one word, each once"),
        (lambda d, s: d.update(words="a b c"), "words: expected a list of single words"),
        (lambda d, s: d.pop("words"), "words: expected a list of single words"),
        (lambda d, s: d.update(program_tokens=5), "trained with other program tokens"),
    ],
    ids=range(12),
)
def test_changed_question_parsers_are_refused(change, reason, tmp_path) -> None:
    from safetensors.torch import load_file, save_file

    from nsdr import QuestionParser
    from nsdr.question_parser.network import build_networks
    from nsdr.question_parser.tokenizer import Tokenizer, decoder_tokens
    from nsdr.world.vocabulary import CLEVRER

    words = Tokenizer(["how", "many", *(noun for noun, (shape, _) in CLEVRER.nouns.items() if shape)])
    config = QuestionParserConfig(embedding=4, hidden=4, layers=1)
    QuestionParser(words, build_networks(len(words), len(decoder_tokens(CLEVRER)), config)).save_pretrained(tmp_path)
    QuestionParser.from_checkpoint(tmp_path)
    description, weights = tmp_path / "question_parser.json", tmp_path / "question_parser.safetensors"
    details, state = json.loads(description.read_text()), load_file(weights)
    change(details, state)
    description.write_text(json.dumps(details))
    save_file({name: value.clone() for name, value in state.items()}, weights)
    with pytest.raises(CheckpointError, match=rf"question_parser\.json: .*{reason}"):
        QuestionParser.from_checkpoint(tmp_path)


@pytest.mark.parametrize("stored", ["float16", "bfloat16", "float64"])
def test_weights_of_another_number_format_come_back_as_float32(stored, tmp_path) -> None:
    import torch

    save_checkpoint(tmp_path, "question_parser", {"a": torch.ones(2, dtype=getattr(torch, stored))}, {}, {})
    assert load_checkpoint(tmp_path, "question_parser")[0]["a"].dtype == torch.float32


def test_a_training_starts_from_weights_of_the_same_network_only(tmp_path) -> None:
    import torch

    save_checkpoint(tmp_path, "dynamics", {"weight": torch.ones(2, 3), "bias": torch.ones(2)}, {}, {}, half=True)
    network = torch.nn.Linear(3, 2)
    start_from(network, tmp_path, "dynamics")
    assert torch.equal(network.weight, torch.ones(2, 3))
    with pytest.raises(CheckpointError, match=r"its dynamics is of other settings \(.*size mismatch for weight"):
        start_from(torch.nn.Linear(4, 2), tmp_path, "dynamics")
    with pytest.raises(CheckpointError, match=r"weight: expected torch\.float16, got torch\.float32"):
        start_from(torch.nn.Linear(3, 2).half(), tmp_path, "dynamics")


def test_missing_and_corrupt_files_are_named(tmp_path) -> None:
    import torch

    config = QuestionParserConfig()
    with pytest.raises(CheckpointError, match=r"question_parser\.json: no such file"):
        load_checkpoint(tmp_path, "question_parser")
    save_checkpoint(tmp_path, "question_parser", {"a": torch.ones(3)}, config, {"note": "x"}, half=True)
    state, details = load_checkpoint(tmp_path, "question_parser")
    assert torch.equal(state["a"], torch.ones(3))
    assert details["note"] == "x"
    weights = tmp_path / "question_parser.safetensors"
    weights.write_bytes(weights.read_bytes()[:-3])
    with pytest.raises(CheckpointError, match=r"question_parser\.safetensors: corrupt"):
        load_checkpoint(tmp_path, "question_parser")
    weights.unlink()
    with pytest.raises(CheckpointError, match=r"question_parser\.safetensors: no such file"):
        load_checkpoint(tmp_path, "question_parser")
    (tmp_path / "question_parser.json").write_text("[]")
    with pytest.raises(CheckpointError, match="not the description of a question_parser"):
        load_checkpoint(tmp_path, "question_parser")


def public_functions():
    """(full name, function or class) of what modules define without an underscore, with methods; no command's `*_options`."""
    for info in pkgutil.walk_packages(nsdr.__path__, "nsdr."):
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            is_own = callable(value) and getattr(value, "__module__", None) == info.name
            if not is_own or name.startswith("_") or name.endswith("_options"):
                continue
            yield f"{info.name}.{name}", value
            if inspect.isclass(value):
                for key, method in vars(value).items():
                    if not key.startswith("_") and inspect.isfunction(method):
                        yield f"{info.name}.{name}.{key}", method


def test_every_public_name_says_what_it_does_and_of_what_shape() -> None:
    missing = []
    for name, value in public_functions():
        text = inspect.getdoc(value) or ""
        if not text or (inspect.isclass(value) and not value.__doc__):
            missing.append(f"{name}: no docstring")
            continue
        hints = {k: str(v) for k, v in getattr(value, "__annotations__", {}).items()}
        arrays = [
            k
            for k, v in hints.items()
            if re.search("Array|ndarray|Tensor", v) and not re.search("Callable|Mapping|dict", v)
        ]
        if arrays and not re.search(r"\([\w.][\w .+*/-]*,[^)]*\)|\bscalar", text):
            missing.append(f"{name}: no shape of {', '.join(arrays)}")
    assert not missing, "\n".join(missing)


def test_notebooks_can_be_read_without_being_run() -> None:
    files = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
    assert len(files) == 6
    for file in files:
        text = file.read_text()
        assert len(text) < 500_000, file
        assert not re.search(r"/(tmp|root|home|work)/|\"stderr\"|\"traceback\"", text), file
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        assert sum(bool(cell["outputs"]) for cell in cells) > len(cells) / 2, file


def test_notebooks_import_what_exists() -> None:
    imports = []
    for file in sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb")):
        for cell in json.loads(file.read_text())["cells"]:
            imports += re.findall(r"^(?:from|import) nsdr\b.*$", "".join(cell["source"]), re.MULTILINE)
    assert len(imports) > 15
    for line in imports:
        exec(line, {})


def test_a_folder_that_is_called_like_shipped_weights_does_not_replace_them(tmp_path, monkeypatch) -> None:
    shipped, baseline = find_checkpoint(), find_checkpoint("truth/mac", "baselines")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "truth" / "mac").mkdir(parents=True)
    (tmp_path / "default").mkdir()
    assert find_checkpoint() == shipped
    assert find_checkpoint("truth/mac", "baselines") == baseline
    (tmp_path / "default" / "dynamics.safetensors").touch()
    with pytest.warns(UserWarning, match=r"\./default is the folder"):
        assert find_checkpoint() == shipped
    assert find_checkpoint("./default").resolve() == tmp_path / "default"
    (tmp_path / "mine").mkdir()
    assert find_checkpoint("mine").resolve() == tmp_path / "mine"
