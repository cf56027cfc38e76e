"""Parameter files, campaigns and metadata.yaml spoilt by chance and by design, read by verbs."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from benchmarks.faults.trial import Trial
from benchmarks.faults.verbs import Attempt, Verbs
from herringbone_sim.recording.writer import RunWriter

CONFIG = Path(__file__).parents[2] / "config"
# A page; a value that is printed whole is larger by orders of magnitude.
MOST_PRINTED = 20_000
LEVELS = "abcdefghijklmnop"
POINT = {"role": "fit", "delta_T": 50.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}


def _bomb(node: str) -> str:
    """Sixteen levels, each ten times the one before; ``node`` is a list of aliases or a merge."""
    levels = (
        f"{name}: &{name} " + node.format(aliases=", ".join([f"*{before}"] * 10))
        for before, name in pairwise(LEVELS)
    )
    return "\n".join(["a: &a {x: 1}", *levels])


BOMBS = (
    _bomb("[{aliases}]"),
    _bomb("{{<<: [{aliases}]}}"),
    "[" * 3000,
    "{a: " * 3000,
    "\n".join(" " * level + "a:" for level in range(2000)),
    "a: &a [*a]",
    f"a: {'1' * 5000}",
    f"a: 0x{'f' * 100_000}",
    f"a: '{'x' * 5_000_000}'",
    f"a: [{'1, ' * 500_000}]",
    "? [a, b]\n: 1",
    "a: !!python/object/apply:os.system ['true']",
    "a: !!timestamp 2001-99-99",
    "",
    "- 1",
    "\0",
)
# Values that stand in place of one that was there.
VALUES = (
    *("1" * 5000, "2001-01-01", "2001-99-99", "12:30:45", "[" * 3000, "'", '"', "*a", "&a 1"),
    *("!!int ''", "!!bool x", "!!timestamp x", "!!binary x", "{}", "[]", "~", ".nan", "-.inf"),
    *("1e999", "0x" + "f" * 5000, "x" * 70_000, "[1, [2, [3]]]", "{a: {b: 1}}", "true", "\t", "%"),
    *("a\n  b: 1", "\u2028", "\ud7ff", "'\\0'", '"\\x1b[2J"', "9" * 400, "-0", "1_000", "| \n"),
)


@lru_cache(maxsize=1)
def _verbs() -> Verbs:
    verbs = Verbs()
    atexit.register(verbs.__exit__)
    return verbs


def yaml_files(seed: int, folder: Path) -> Trial:
    """Spoil a file of one kind and give it to the verb that reads it."""
    rng = np.random.default_rng(seed)
    make = (_parameters, _metadata, _campaign)[seed % 3]
    path, argv = make(folder)
    kind, content = _spoilt(rng, path.read_bytes())
    path.write_bytes(content)
    tried = _verbs()(argv)
    return Trial(
        f"{path.name}, {kind}, seed {seed}",
        seconds=tried.seconds,
        peak_bytes=tried.peak_bytes,
        traceback=tried.traceback,
        broken=tuple(_broken(tried)),
    )


def _parameters(folder: Path) -> tuple[Path, list[str | Path]]:
    path = folder / "gear.yaml"
    path.write_bytes((CONFIG / "paper.yaml").read_bytes())
    return path, ["parameters", "--check", path]


def _metadata(folder: Path) -> tuple[Path, list[str | Path]]:
    writer = RunWriter.create(folder, "run", "/sim", {}, ("t", "x_sp_L"), 0)
    writer.write_samples(np.array([[0.0, 1.0], [1.0, 2.0], [2.0, 1.0]]))
    writer.close()
    return folder / "run" / "metadata.yaml", ["info", folder / "run"]


def _campaign(folder: Path) -> tuple[Path, list[str | Path]]:
    """A campaign whose runs are not there: it is read, and the diagnosis ends at once."""
    path = folder / "campaign.yaml"
    runs = [{"path": f"run_{number}", **POINT} for number in range(3)]
    path.write_text(yaml.safe_dump({"rig": "a rig", "noise": {"rms_share": 0.01}, "runs": runs}))
    nominal = CONFIG / "rig.yaml"
    return path, ["gap", folder, "--nominal", nominal, "--out", folder / "out"]


def _spoilt(rng: np.random.Generator, content: bytes) -> tuple[str, bytes]:
    """What was done, and what came of it."""
    spoils: tuple[Callable[[np.random.Generator, bytes], bytes], ...] = (
        *(_bits, _cut, _twice, _value, _value, _value, _bombed, _appended),
    )
    spoil = spoils[rng.integers(len(spoils))]
    return spoil.__name__.strip("_"), spoil(rng, content)


def _bits(rng: np.random.Generator, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.integers(1, 20)):
        changed[rng.integers(len(changed))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(rng: np.random.Generator, content: bytes) -> bytes:
    first, last = sorted(rng.integers(len(content), size=2))
    return content[:first] + content[last:]


def _twice(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    at = rng.integers(len(lines))
    return b"".join([*lines[: at + 1], *lines[at:]])


def _value(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines()
    at = rng.choice([i for i, line in enumerate(lines) if b":" in line])
    value = VALUES[rng.integers(len(VALUES))].encode()
    lines[at] = lines[at].partition(b":")[0] + b": " + value
    return b"\n".join(lines)


def _bombed(rng: np.random.Generator, content: bytes) -> bytes:
    del content
    return BOMBS[rng.integers(len(BOMBS))].encode()


def _appended(rng: np.random.Generator, content: bytes) -> bytes:
    return content + b"\n" + BOMBS[rng.integers(len(BOMBS))].encode()


def _broken(tried: Attempt) -> list[str]:
    broken = [f"printed {tried.printed} bytes"] if tried.printed > MOST_PRINTED else []
    if tried.code not in (0, 2):
        broken.append(f"ended with {tried.code}")
    if tried.text.count("error:") > 1:
        broken.append("told more than one error")
    return broken
