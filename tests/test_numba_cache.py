"""The cache of compiled functions follows changes in other files; each step is a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nsdr.dynamics.numba_cache import cached_njit

FUNCTIONS = {
    "constants.py": "FACTOR = 2.0\n",
    "inner.py": "from nsdr.dynamics.numba_cache import cached_njit\n\n"
    "@cached_njit\ndef inner(x):\n    return x + 1.0\n",
    "outer.py": "from constants import FACTOR\nfrom inner import inner\n"
    "from nsdr.dynamics.numba_cache import cached_njit\n\n"
    "@cached_njit\ndef outer(x):\n    return FACTOR * inner(x)\n",
}
CALL = "from outer import outer; print(outer(1.0), sum(outer.stats.cache_hits.values()), outer.stats.cache_path)"
NAMES = """
from nsdr.dynamics.physics import bullet_rules
bullet_rules.{name} = {value}
from numba.core.dispatcher import Dispatcher
from nsdr.dynamics import sliding
from nsdr.dynamics.physics import contact_geometry, forces, simulator
for module in (contact_geometry, forces, simulator, sliding):
    for name, value in vars(module).items():
        if isinstance(value, Dispatcher):
            print(name, value._cache._impl.filename_base)
"""


def python(code: str, folder: Path, **environment: str) -> str:
    environment = {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **environment}
    result = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    return result.stdout


@pytest.fixture
def functions(tmp_path: Path) -> Path:
    for name, text in FUNCTIONS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.robustness
def test_changes_in_other_files_are_seen(functions: Path) -> None:
    assert python(CALL, functions).split()[:2] == ["4.0", "0"]
    (functions / "constants.py").write_text("FACTOR = 3.0\n")
    assert python(CALL, functions).split()[:2] == ["6.0", "0"]
    (functions / "inner.py").write_text(FUNCTIONS["inner.py"].replace("1.0", "2.0"))
    assert python(CALL, functions).split()[:2] == ["9.0", "0"]


@pytest.mark.robustness
def test_a_read_only_installation_compiles_into_the_users_cache(functions: Path) -> None:
    (functions / "__pycache__").write_text("in place of a folder that cannot be written")
    value, _, path = python(CALL, functions, XDG_CACHE_HOME=str(functions / "home")).split()
    assert value == "4.0"
    assert Path(path).is_relative_to(functions / "home")
    assert python(CALL, functions, XDG_CACHE_HOME=str(functions / "home")).split()[:2] == ["4.0", "1"]


@pytest.mark.robustness
def test_without_any_folder_to_write_it_compiles_and_says_so_once(functions: Path) -> None:
    for name in ("__pycache__", "home"):
        (functions / name).write_text("in place of a folder that cannot be written")
    done = subprocess.run(
        [sys.executable, "-c", CALL],
        env=os.environ | {"PYTHONPATH": str(functions), "XDG_CACHE_HOME": str(functions / "home")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["4.0", "0", "None"]
    (note,) = done.stderr.splitlines()
    assert "NUMBA_CACHE_DIR" in note


@pytest.mark.robustness
def test_a_full_disk_costs_the_cache_only(functions: Path) -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10)); "
    assert python(limit + CALL, functions, NUMBA_CACHE_DIR=str(functions / "cache")).split()[:2] == ["4.0", "0"]


@pytest.mark.robustness
def test_the_simulators_caches_depend_on_the_constants(tmp_path: Path) -> None:
    def files(name: str, value: str) -> dict[str, str]:
        text = python(NAMES.format(name=name, value=value), tmp_path, NUMBA_CACHE_DIR=str(tmp_path))
        return dict(line.split() for line in text.splitlines())

    before, after = files("MIN_REBOUND_SPEED", "0.3"), files("HULL_MARGIN_WORLD", "0.002")
    assert {"_run", "_collide", "slow_down", "slide_one", "outline_gap"} < set(before)
    unchanged = {name for name in before if after[name] == before[name]}
    sliding = {"slide_one", "slide_on_ground", "_slide_all", "_line", "fit_sliding"}
    assert unchanged == sliding | {
        *("_box_gap", "_brake", "_changed", "_follow_prescribed", "_steps_apart"),
        *("drift", "pair_restitution", "push", "slow_down"),
    }


def _reads_what_comes_later(x):  # type: ignore[no-untyped-def]
    return x * DEFINED_LATER  # noqa: F821


def test_names_must_be_defined_before() -> None:
    with pytest.raises(NameError, match="_reads_what_comes_later: DEFINED_LATER must be defined before it"):
        cached_njit(_reads_what_comes_later)
