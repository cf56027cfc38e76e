"""Compiled code goes when a source it was made from changes, and stays otherwise."""

from __future__ import annotations

import os

import pytest

from herringbone_sim.core.cache import forget_stale


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
