"""Names in figures: matplotlib reads what stands between two ``$`` as a formula."""

from __future__ import annotations

import re

_OF_A_MESH = re.compile(r"([A-Za-z0-9]+)(?:_([A-Za-z0-9]+))?")
# What an axis of a figure has room for.
_ROOM = 60


def plain_text(text: str) -> str:
    """Text from outside as it is drawn letter by letter, in a line, beside formulas too."""
    line = " ".join(text.split())
    line = line if len(line) <= _ROOM else f"{line[: _ROOM - 3]}..."
    return line.replace("$", r"\$")


def mesh_symbol(symbol: str, mesh: str) -> str:
    """A quantity of a mesh, ``\\dot x`` or ``x``, as a formula: ``x`` with its name as index.

    A name that no formula takes is drawn as it is, behind the letter.
    """
    parts = _OF_A_MESH.fullmatch(mesh)
    if parts is None:
        letter = "v" if "dot" in symbol else symbol
        return plain_text(f"{letter}_{mesh}")
    body, side = parts[1], parts[2] or ""
    return rf"${symbol}_{{\mathrm{{{body}}}}}^{{\mathrm{{{side}}}}}$"
