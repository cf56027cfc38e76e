"""Compiled code goes when a source it was made from changes, and stays otherwise."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from herringbone_sim.core.cache import compiled_from, forget_stale
from herringbone_sim.core.numba_private import TESTED
from herringbone_sim.core.packed import PACKAGE


@pytest.fixture
def package(tmp_path):
    for folder in ("", "inner"):
        cache = tmp_path / folder / "__pycache__"
        cache.mkdir(parents=True)
        (tmp_path / folder / "source.py").write_text("one = 1\n")
        (cache / "source.f-1.py311.nbi").write_text("index")
        (cache / "source.cpython-311.pyc").write_text("bytecode")
    return tmp_path


def compiled(package):
    return len(list(package.rglob("*.nbi")))


def test_code_of_unknown_origin_is_forgotten_once(package):
    forget_stale(package, package)
    assert compiled(package) == 0
    (package / "__pycache__" / "source.f-1.py311.nbi").write_text("index")
    forget_stale(package, package)
    assert compiled(package) == 1


def test_a_change_in_one_file_forgets_the_code_of_all(package):
    forget_stale(package, package)
    for folder in ("", "inner"):
        (package / folder / "__pycache__" / "source.f-1.py311.nbi").write_text("index")
    source = package / "inner" / "source.py"
    source.write_text("one = 2\n")
    os.utime(source, ns=(1, 1))
    forget_stale(package, package)
    assert compiled(package) == 0
    assert len(list(package.rglob("*.pyc"))) == 2


def test_only_the_named_sources_count(package):
    forget_stale(package, package / "inner")
    index = package / "__pycache__" / "source.f-1.py311.nbi"
    index.write_text("index")
    (package / "source.py").write_text("one = 1000\n")
    forget_stale(package, package / "inner")
    assert compiled(package) == 1


def test_a_folder_that_cannot_be_written_is_left_alone(package):
    (package / "__pycache__" / "sources.sha256").mkdir()
    forget_stale(package, package)
    assert compiled(package) == 0


def test_what_gives_constants_to_compiled_code_counts(tmp_path):
    for room in ("core", "analysis", "sweeps", "views", "cli"):
        (tmp_path / room).mkdir()
    assert [room.name for room in compiled_from(tmp_path)] == ["core", "analysis", "sweeps"]


def test_every_function_compiled_into_others_lies_in_a_folder_that_counts():
    rooms = compiled_from(PACKAGE)
    making = re.compile(r"^@(law|compiled|inlined)\b", re.MULTILINE)
    makers = [path for path in PACKAGE.rglob("*.py") if making.search(path.read_text("utf-8"))]
    assert len(makers) > 20
    assert not [p for p in makers if not any(room in p.parents for room in rooms)]


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_constant_of_another_module_reaches_the_code_compiled_before(tmp_path, elsewhere):
    """Numba by itself would load what it compiled with the old one."""
    package = tmp_path / "gear"
    (package / "core").mkdir(parents=True)
    (package / "core" / "__init__.py").write_text("")
    (package / "core" / "constant.py").write_text("ONE = 1\n")
    (package / "__init__.py").write_text(
        "from pathlib import Path\n"
        "from herringbone_sim.core.cache import compiled_from, forget_stale\n"
        "forget_stale(Path(__file__).parent, *compiled_from(Path(__file__).parent))\n"
    )
    (package / "core" / "function.py").write_text(
        "from numba import njit\nfrom gear.core.constant import ONE\n"
        "@njit(cache=True)\ndef one():\n    return ONE\nprint(one(), len(one.stats.cache_hits))\n"
    )
    paths = [str(tmp_path), str(Path(__file__).resolve().parents[2])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    environment.pop("NUMBA_CACHE_DIR", None)
    if elsewhere:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")

    def told():
        command = [sys.executable, "-c", "import gear.core.function"]
        return subprocess.check_output(command, env=environment, text=True).split()

    assert told() == ["1", "0"]
    assert told() == ["1", "1"]
    (package / "core" / "constant.py").write_text("ONE = 12\n")
    assert told() == ["12", "0"]


def test_what_is_compiled_is_told_and_what_is_loaded_is_not(tmp_path):
    source = (
        "from numba import njit\n"
        "from herringbone_sim.core.cache import on_compiling\n"
        "@njit(cache=True)\n"
        "def twice(x):\n"
        "    return 2 * x\n"
        "with on_compiling(lambda: print('compiling')):\n"
        "    print(twice(2))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(source)

    def said():
        command = [sys.executable, str(script)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()

    assert said() == ["compiling", "4"]
    assert said() == ["4"]


def test_private_parts_of_numba_are_taken_in_one_file_for_the_version_that_is_tested() -> None:
    """What is no public interface may change with a minor version: one place, one version."""
    private = re.compile(r"numba\.(core|np|experimental)\b|llvmlite|\b_nrt\b|\.entry_point\b")
    sources = sorted(PACKAGE.rglob("*.py"))
    found = [source.name for source in sources if private.search(source.read_text())]
    assert found == ["numba_private.py"]
    assert numba.__version__.startswith(f"{TESTED}.")
    wanted = (PACKAGE.parent / "requirements.txt").read_text().splitlines()
    assert f"numba=={TESTED}.*" in wanted
