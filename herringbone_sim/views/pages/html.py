"""HTML pages: templates in ``templates/``, filled with plain values.

Templates escape all texts but those of type ``Markup``, which are HTML already.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from herringbone_sim.sweeps.output import make_folder

TEMPLATES = Environment(
    loader=PackageLoader(__package__),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)


@dataclass(frozen=True)
class Table:
    """Content of an HTML table.

    Attributes:
        head, rows: cells; ``Markup`` for HTML.
        numeric: indices of columns that are set flush right.
        classes: (row, column) -> additional CSS class of the cell.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Container[int] = ()
    classes: Mapping[tuple[int, int], str] = field(default_factory=dict)

    def attributes(self, row: int, column: int) -> Markup:
        """Return the HTML attributes of a cell, for the template; ``row`` is -1 in the head."""
        names = ["n"] if column in self.numeric else []
        names += [self.classes[row, column]] if (row, column) in self.classes else []
        return Markup(' class="{}"').format(" ".join(names)) if names else Markup()


def render(template: str, **content: object) -> str:
    """Return a page: a template in ``templates/`` filled with values by name."""
    return TEMPLATES.get_template(template).render(content)


def write_page(path: Path, html: str) -> Path:
    """Write a page into its folder, created if missing, and return its path.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(path.parent)
    path.write_text(html, encoding="utf-8")
    return path


def number(value: float, digits: int = 6) -> str:
    """Return a number with ``digits`` significant digits as text; a dash if it is not finite."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"
