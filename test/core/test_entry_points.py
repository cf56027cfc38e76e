"""Python calls no compiled function that has no wrapper for it; such a call crashes the process.

Read from the sources of the package, of the tests and of the benchmarks.
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMPILED = {"compiled", "exposed", "inlined", "called", "embedded", "law", "njit"}
LINKED = {"inlined", "called"}


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
    return {f.name for f in tree.body if isinstance(f, ast.FunctionDef) and marks(f) & LINKED}


def calls_from_python(node, names):
    """Lines in which code that is not compiled calls one of ``names``, also as ``module.name``."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef) and marks(child) & COMPILED:
            continue
        if isinstance(child, ast.Call) and ast.unparse(child.func) in names:
            yield child.lineno
        yield from calls_from_python(child, names)


def wrong_calls(trees):
    """Calls from Python of what it can't call, as ``module:line``."""
    without = {module: unwrapped(tree) for module, tree in trees.items()}
    wrong = []
    for module, tree in trees.items():
        names = set(without[module])
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom):
                continue
            for one in node.names:
                known, whole = one.asname or one.name, f"{node.module}.{one.name}"
                if one.name in without.get(node.module, ()):
                    names.add(known)
                names |= {f"{known}.{name}" for name in without.get(whole, ())}
        wrong += [f"{module}:{line}" for line in calls_from_python(tree, names)]
    return wrong


def test_python_calls_only_what_it_can():
    trees = sources()
    assert sum(len(unwrapped(tree)) for tree in trees.values()) > 80  # it has found them
    assert wrong_calls(trees) == []


def test_a_call_is_found_by_name_and_by_module_and_not_in_compiled_code():
    kernel = "@inlined\ndef step(y):\n    return y\n\n@compiled\ndef run(y):\n    return step(y)"
    caller = "from a import kernel\nfrom a.kernel import step as go\ngo(1)\nkernel.step(1)"
    trees = {"a.kernel": ast.parse(kernel), "a.caller": ast.parse(f"{caller}\nkernel.run(1)")}
    assert wrong_calls(trees) == ["a.caller:3", "a.caller:4"]
