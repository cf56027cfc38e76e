"""Python calls no compiled function that has no wrapper for it; such a call crashes the process.

Read from the sources of the package, of the tests and of the benchmarks.
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMPILED = {"compiled", "exposed", "inlined", "called", "embedded", "law", "njit"}
UNWRAPPED = {"inlined", "called"}


def marks(function):
    """Names of the decorators of a function."""
    names = set()
    for decorator in function.decorator_list:
        bare = decorator.func if isinstance(decorator, ast.Call) else decorator
        names.add(bare.attr if isinstance(bare, ast.Attribute) else getattr(bare, "id", ""))
    return names


def sources():
    """Syntax trees by module name."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): ast.parse(path.read_text())
        for folder in ("herringbone_sim", "test", "benchmarks")
        for path in (ROOT / folder).rglob("*.py")
    }


def unwrapped(tree):
    """Names of the functions of a module that Python can't call."""
    return {f.name for f in tree.body if isinstance(f, ast.FunctionDef) and marks(f) & UNWRAPPED}


def calls_from_python(node, names):
    """Lines in which code that is not compiled calls one of ``names``."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef) and marks(child) & COMPILED:
            continue
        if isinstance(child, ast.Call) and getattr(child.func, "id", None) in names:
            yield child.lineno
        yield from calls_from_python(child, names)


def test_python_calls_only_what_it_can():
    trees = sources()
    without = {module: unwrapped(tree) for module, tree in trees.items()}
    assert sum(map(len, without.values())) > 80  # it has found them
    wrong = []
    for module, tree in trees.items():
        names = set(without[module])
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in without:
                names |= {a.asname or a.name for a in node.names if a.name in without[node.module]}
        wrong += [f"{module}:{line}" for line in calls_from_python(tree, names)]
    assert wrong == []
