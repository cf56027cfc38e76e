"""Texts in figures; Matplotlib typesets text between two ``$`` as a formula."""

from __future__ import annotations

import re

_OF_A_MESH = re.compile(r"([A-Za-z0-9]+)(?:_([A-Za-z0-9]+))?")
_MAX_LETTERS = 60  # of an axis label


def plain_text(text: str) -> str:
    """Return a text as one line that Matplotlib draws literally, at most 60 characters."""
    line = " ".join(text.split())
    line = line if len(line) <= _MAX_LETTERS else f"{line[: _MAX_LETTERS - 3]}..."
    return line.replace("$", r"\$")


def mesh_symbol(symbol: str, mesh: str) -> str:
    """Return the formula of a quantity, ``x`` or ``\\dot x``, with the mesh and side as indices.

    A mesh name of another form than ``sp1_L`` is returned literally, as ``x_name`` or ``v_name``.
    """
    parts = _OF_A_MESH.fullmatch(mesh)
    if parts is None:
        letter = "v" if "dot" in symbol else symbol
        return plain_text(f"{letter}_{mesh}")
    body, side = parts[1], parts[2] or ""
    return rf"${symbol}_{{\mathrm{{{body}}}}}^{{\mathrm{{{side}}}}}$"
