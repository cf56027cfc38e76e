"""Effects by id, from the catalogue, installed packages and files that a user names."""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import os
import pkgutil
import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from herringbone_sim.effects import catalogue
from herringbone_sim.effects.effect import Effect
from herringbone_sim.errors import ParameterError, shown

GROUP = "herringbone_sim.effects"
VARIABLE = "HERRINGBONE_EFFECTS"
DIGEST = "DIGEST"  # attribute of the module of an own effect: digest of its file


def effects() -> dict[str, Effect]:
    """Return all effects by id, sorted by id.

    Sources: ``EFFECT`` of the modules in ``effects.catalogue``, of the entry points of the group
    ``herringbone_sim.effects``, and of the files listed in the environment variable
    ``HERRINGBONE_EFFECTS``, separated as in PATH.

    Raises:
        ParameterError: a missing file, a module without ``EFFECT``, or two effects with one id.
    """
    return dict(_all_effects(os.environ.get(VARIABLE, "")))


def effect(name: str) -> Effect:
    """Return the effect with an id; ParameterError lists the known ids."""
    known = effects()
    if name not in known:
        raise ParameterError(
            f"no effect {shown(name)}; there are {', '.join(known)}; own ones are files listed in "
            f"{VARIABLE}"
        )
    return known[name]


def own_digests() -> list[str]:
    """Digests of the files of own effects as they were loaded; errors as of ``effects``."""
    effects()
    paths = [Path(path) for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path]
    return [str(vars(sys.modules[_module_name(path)])[DIGEST]) for path in paths]


@functools.cache
def _all_effects(paths: str) -> tuple[tuple[str, Effect], ...]:
    """Return pairs of id and effect, sorted; ``paths``: value of the environment variable."""
    modules = [
        importlib.import_module(f"{catalogue.__name__}.{module.name}")
        for module in pkgutil.iter_modules(catalogue.__path__)
    ]
    modules += [point.load() for point in entry_points(group=GROUP)]
    modules += [load_file(Path(path)) for path in paths.split(os.pathsep) if path]
    by_id: dict[str, Effect] = {}
    for module in modules:
        loaded = _of(module)
        if loaded.id in by_id:
            raise ParameterError(f"two effects are named {loaded.id}: rename that in {module}")
        by_id[loaded.id] = loaded
    return tuple(sorted(by_id.items()))


def load_file(path: Path) -> ModuleType:
    """Import a Python file as a module; ParameterError if it does not exist."""
    path, name = path.resolve(), _module_name(path)
    spec = importlib.util.spec_from_file_location(name, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise ParameterError(f"{VARIABLE} must list Python files, got {path}")
    module = importlib.util.module_from_spec(spec)
    setattr(module, DIGEST, hashlib.sha256(path.read_bytes()).hexdigest())
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _module_name(path: Path) -> str:
    path = path.resolve()
    return f"herringbone_effect_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"


def _of(module: ModuleType) -> Effect:
    """Return ``EFFECT`` of a module; ParameterError if it is missing or no ``Effect``."""
    loaded = getattr(module, "EFFECT", None)
    if not isinstance(loaded, Effect):
        raise ParameterError(
            f"{module} must hold EFFECT, an effects.effect.Effect, got {loaded!r}"
        )
    return loaded
