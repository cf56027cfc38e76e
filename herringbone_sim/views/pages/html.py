"""HTML pages: templates in ``templates/``, filled with plain values.

Templates escape texts; what is HTML already is ``Markup``.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

TEMPLATES = Environment(
    loader=PackageLoader(__package__),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)


@dataclass(frozen=True)
class Table:
    """A table that scrolls sideways.

    Attributes:
        head, rows: cells; ``Markup`` for HTML.
        numeric: columns that are set flush right.
        classes: further CSS classes of cells, by row and column.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Container[int] = ()
    classes: Mapping[tuple[int, int], str] = field(default_factory=dict)

    def attributes(self, row: int, column: int) -> Markup:
        """Attributes of a cell, for the template; ``row`` is -1 in the head."""
        names = ["n"] if column in self.numeric else []
        names += [self.classes[row, column]] if (row, column) in self.classes else []
        return Markup(' class="{}"').format(" ".join(names)) if names else Markup()


def render(template: str, **content: object) -> str:
    """A page from a template in ``templates/`` and its values."""
    return TEMPLATES.get_template(template).render(content)


def number(value: float, digits: int = 6) -> str:
    """A number with some significant digits; a dash for one that is not finite."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"
