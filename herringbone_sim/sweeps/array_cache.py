"""Cache of computed arrays in a folder, keyed by a digest of all inputs.

Each file is named by the digest of its inputs, of the version, of the sources that determine
results (``_sources``) and of the user's own effects, so an interrupted computation continues where
it was, and results of other inputs or other sources are never read. A file ends in the checksum of
its content; if that fails, the file is ignored.
"""

from __future__ import annotations

import functools
import hashlib
import io
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.core import cache
from herringbone_sim.effects.registry import own_digests
from herringbone_sim.sweeps.output import make_folder, whole_file
from herringbone_sim.version import VERSION

Arrays = dict[str, Any]

# Folders whose code determines results, or which of them are stored.
RESULT_ROOMS = ("core", "analysis", "effects", "sweeps", "dynamics", "control", "paper")
CHECKSUM_BYTES = hashlib.sha256().digest_size


@dataclass(frozen=True)
class ArrayCache:
    """Arrays by the digest of their inputs; threads and processes may share a folder.

    Attributes:
        folder: created if missing; None disables the cache.

    Raises:
        AnalysisError: the folder can't be written.
    """

    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.folder:
            make_folder(self.folder)

    def get(self, parts: Sequence[Any], work: Callable[[], Mapping[str, Any]]) -> Arrays:
        """Arrays by name: read from the cache if stored and undamaged, else computed and stored.

        A file whose checksum fails is reported on stderr, computed again and replaced. Without
        ``folder`` nothing is stored.

        Args:
            parts: all inputs that the arrays depend on, see ``digest``.
            work: computes the arrays, or values that ``np.asarray`` takes, by name.

        Raises:
            OSError: the computed arrays can't be written.
        """
        path = self.folder / f"{digest(parts)}.npz" if self.folder else None
        stored = _read(path) if path else None
        if stored is not None:
            return stored
        made: Arrays = {name: np.asarray(values) for name, values in work().items()}
        if path:
            packed = io.BytesIO()
            np.savez(packed, **made)
            with whole_file(path) as file:
                file.write(packed.getvalue() + hashlib.sha256(packed.getvalue()).digest())
        return made


def digest(parts: Sequence[Any]) -> str:
    """Digest of inputs, version, sources and files of own effects: 32 hexadecimal digits.

    Args:
        parts: plain values, arrays, and dataclasses or sequences of them.
    """
    sources = [VERSION, _sources(), own_digests()]
    text = json.dumps([*sources, *parts], default=_plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _read(path: Path) -> Arrays | None:
    """Arrays of a file by name; None if it is missing, or damaged, which stderr reports."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    packed, checksum = content[:-CHECKSUM_BYTES], content[-CHECKSUM_BYTES:]
    if hashlib.sha256(packed).digest() != checksum:
        print_above_bar(f"{path} is damaged (its checksum fails): what it held is computed again")
        return None
    with np.load(io.BytesIO(packed)) as file:
        return {name: file[name] for name in file.files}


def print_above_bar(text: str) -> None:
    """Print a line on stderr, above a progress bar if one is shown."""
    tqdm.write(text, file=sys.stderr)


@functools.cache
def _sources() -> tuple[str, ...]:
    """Digests of the folders of this package whose code determines the results."""
    package = Path(__file__).parents[1]
    return tuple(cache.digest(package / room) for room in RESULT_ROOMS)


def _plain(part: Any) -> Any:
    """JSON-serialisable form of an array or a dataclass."""
    if isinstance(part, np.ndarray):
        return [str(part.dtype), part.shape, hashlib.sha256(part.tobytes()).hexdigest()]
    return vars(part)
