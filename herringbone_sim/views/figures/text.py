"""Texts in figures; Matplotlib typesets what stands between two ``$`` as a formula."""

from __future__ import annotations

import re

_OF_A_MESH = re.compile(r"([A-Za-z0-9]+)(?:_([A-Za-z0-9]+))?")
_MAX_LETTERS = 60  # of an axis label


def plain_text(text: str) -> str:
    """Text from a file as one line that Matplotlib draws literally, shortened to 60 letters."""
    line = " ".join(text.split())
    line = line if len(line) <= _MAX_LETTERS else f"{line[: _MAX_LETTERS - 3]}..."
    return line.replace("$", r"\$")


def mesh_symbol(symbol: str, mesh: str) -> str:
    """Formula of a quantity of a mesh, such as ``x`` or ``\\dot x``, with the mesh as index.

    A name of another form is drawn literally behind the letter.
    """
    parts = _OF_A_MESH.fullmatch(mesh)
    if parts is None:
        letter = "v" if "dot" in symbol else symbol
        return plain_text(f"{letter}_{mesh}")
    body, side = parts[1], parts[2] or ""
    return rf"${symbol}_{{\mathrm{{{body}}}}}^{{\mathrm{{{side}}}}}$"
