"""Modules that are loaded when first used."""

import subprocess
import sys

import pytest

from nsdr.io.lazy import deferred_function


@pytest.fixture
def heavy(tmp_path, monkeypatch) -> str:
    (tmp_path / "heavy_module.py").write_text("def double(x):\n    return 2 * x\n\n\nNUMBER = 7\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "heavy_module", raising=False)
    return "heavy_module"


def test_a_deferred_function_loads_its_module_when_called(heavy: str) -> None:
    with deferred_function(heavy, "double"):
        from heavy_module import double

        assert not hasattr(sys.modules[heavy], "__file__")  # what stands in its place
    assert heavy not in sys.modules
    assert double(4) == 8
    assert sys.modules[heavy].NUMBER == 7


def test_other_names_load_the_module_at_once(heavy: str) -> None:
    with deferred_function(heavy, "double"):
        from heavy_module import NUMBER

        assert NUMBER == 7
        assert sys.modules[heavy].__file__
    assert sys.modules[heavy].NUMBER == 7


def test_a_loaded_module_stays_in_place(heavy: str) -> None:
    import heavy_module

    with deferred_function(heavy, "double"):
        assert sys.modules[heavy] is heavy_module
    assert sys.modules[heavy] is heavy_module


def test_a_pipeline_runs_without_torchs_compiler() -> None:
    code = (
        "import sys, numpy as np, nsdr; pipeline = nsdr.Pipeline.from_pretrained(device='cpu'); "
        "pipeline.frame_parser.parse(np.full((1, 320, 480, 3), 128, np.uint8)); "
        "sys.exit(any(m in sys.modules for m in ('torch._dynamo', 'torch._inductor', 'sympy')))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
