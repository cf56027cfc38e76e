"""Display of results in a notebook: text and HTML, pictures as PNG, tables for pandas."""

from __future__ import annotations

import base64
import importlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from herringbone_sim.errors import AnalysisError, ParameterError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100


@dataclass(frozen=True)
class Picture:
    """A figure that a notebook shows.

    Attributes:
        figure: Matplotlib figure; it may be changed before it is shown or saved.
    """

    figure: Figure

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", dpi=DPI)
        return buffer.getvalue()

    def save(self, path: Path | str) -> None:
        """Write the figure to a file in the format of its suffix (.png, .svg, .pdf)."""
        self.figure.savefig(path)


class NotebookResult:
    """Base of results that a notebook shows as title, table of facts, and picture.

    The picture is that of the method ``plot``, if the class has one.
    """

    def title(self) -> str:
        """Title in one line."""
        raise NotImplementedError

    def facts(self) -> Sequence[tuple[str, str]]:
        """Rows (name, value) of the table."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n".join([self.title(), *(f"  {name}: {value}" for name, value in self.facts())])

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th>"
            f"<td style='text-align:left'>{escape(value)}</td></tr>"
            for name, value in self.facts()
        )
        text = f"<p><b>{escape(self.title())}</b></p><table>{rows}</table>"
        plot = getattr(self, "plot", None)
        if plot is None:
            return text
        try:
            image = base64.b64encode(plot()._repr_png_()).decode()
        except (AnalysisError, ParameterError):
            return text
        return f"{text}<img alt='{escape(self.title())}' src='data:image/png;base64,{image}'>"


def data_frame(data: Any, names: Sequence[str] | None = None) -> Any:
    """Columns by name, or rows, as a ``pandas.DataFrame``; AnalysisError without pandas.

    ``names``: columns of rows that are tuples.
    """
    return library("pandas").DataFrame(data, columns=names)


def library(name: str) -> Any:
    """Import a library of the extra ``notebook``; AnalysisError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise AnalysisError(
            f"this needs {name}, which is not installed: pip install 'herringbone_sim[notebook]'"
        ) from None
