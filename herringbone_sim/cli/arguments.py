"""Parse the arguments of a verb and write its ``--help``, both from the signature of its ``run``.

An option is a parameter of ``run``, or a field of a dataclass that is a parameter. Texts in its
annotation name its value and explain it: ``Annotated[int, "N", "mesh cycles of a run"]``.
"""

from __future__ import annotations

import difflib
import importlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import fill, indent
from typing import Any, Literal, TypeVar, get_args, get_origin

from cyclopts import App, Argument, CycloptsError, Parameter
from cyclopts.exceptions import MissingArgumentError, UnknownOptionError

from herringbone_sim.cli.verbs import PROGRAM
from herringbone_sim.errors import HerringboneError

T = TypeVar("T")
KINDS = {bool: "true or false", float: "a number", float | None: "a number"}
WIDTH, COLUMN = 79, 24  # characters of a line of the help, and column of its explanations


@dataclass(frozen=True)
class Alone:
    """Annotation of an option that may be given without a value, with the value it then has."""

    value: str


class ArgumentError(HerringboneError):
    """Arguments that a verb does not take."""


def parse(verb: str, words: Sequence[str], of_ros: Sequence[str] = ()) -> Callable[[], int]:
    """Parse the arguments of a verb and return a call of its ``run`` with them.

    Args:
        verb: one of ``VERBS``.
        words: arguments after the verb.
        of_ros: arguments of ROS, for a verb whose ``run`` has the parameter ``of_ros``.

    Raises:
        ArgumentError: an unknown, missing or wrong argument, or ``of_ros`` for another verb.
    """
    app = _app(_module(verb))
    known = app.assemble_argument_collection()
    try:
        run, bound, unknown, unparsed = app.parse_known_args(_completed(words, known))
    except CycloptsError as error:
        raise ArgumentError(_wrong(error, known, words)) from None
    takes_ros = "of_ros" in unparsed
    if unknown := [*unknown, *(() if takes_ros else of_ros)]:
        hint = "what is for ROS follows --ros-args" if takes_ros else "see --help"
        raise ArgumentError(_unknown(unknown, known, hint))
    if takes_ros:
        bound.arguments["of_ros"] = of_ros
    return partial(run, *bound.args, **bound.kwargs)


def _module(verb: str) -> Any:
    return importlib.import_module(f"herringbone_sim.cli.{verb.replace(' ', '_')}")


def _app(module: Any) -> App:
    defaults = Parameter(negative=(), allow_repeating=True, json_list=False, json_dict=False)
    app = App(help_flags=(), version_flags=(), default_parameter=defaults)
    app.default(module.run)
    return app


def _completed(words: Sequence[str], known: Sequence[Argument]) -> list[str]:
    """Arguments with the value of ``Alone`` added to options that are given without a value."""
    alone = {name: value for a in known for value in _notes(a, Alone) for name in a.names}
    last = words.index("--") if "--" in words else len(words)
    completed = list(words)
    for i, word in enumerate(words[:last]):
        if word in alone and (i + 1 == last or re.match(r"-(?![\d.])", words[i + 1])):
            completed[i] = f"{word}={alone[word].value}"
    return completed


def _wrong(error: CycloptsError, known: Sequence[Argument], words: Sequence[str]) -> str:
    if isinstance(error, UnknownOptionError):
        return _unknown([error.token.keyword or error.token.value], known, "see --help")
    if isinstance(error, MissingArgumentError) and error.keyword:
        return f"{error.keyword} needs a value: see --help"
    if isinstance(error, MissingArgumentError):
        given = [word.partition("=")[0] for word in words]
        names = {name for argument in known for name in argument.names}
        if stray := [name for name in given if name.startswith("--") and name not in names]:
            return _unknown(stray[:1], known, "see --help")
        needed = [a for a in known if a.show and a.required and not {*given} & {*a.names}]
        asked = error.argument.name if error.argument else ""
        first = next((i for i, a in enumerate(needed) if a.name == asked), 0)
        return f"{', '.join(map(_label, needed[first:]))} must be given: see --help"
    argument, rule = error.argument, getattr(error, "exception_message", "") or error.msg
    if argument is None:
        return f"{rule or error}: see --help"
    if choices := argument.get_choices():
        rule = f"must be one of {', '.join(choices)}"
    rule = str(rule or f"must be {KINDS.get(argument.hint, 'of another kind')}")
    wrong = getattr(error, "token", None)
    got = wrong.value if wrong else " ".join(token.value for token in argument.tokens)
    return f"{argument.name} {rule[0].lower()}{rule[1:].rstrip('.')}, got {got!r}: see --help"


def _unknown(words: Sequence[str], known: Sequence[Argument], hint: str) -> str:
    names = [name for argument in known if argument.show for name in argument.names]
    meant = difflib.get_close_matches(words[0].partition("=")[0], names, n=1)
    question = f"did you mean {meant[0]}? " if meant else ""
    return f"unknown arguments {' '.join(words)}: {question}{hint}"


def help_of(verb: str) -> str:
    """Text of ``VERB --help``: usage, docstring of its module, options with defaults, example."""
    module = _module(verb)
    known = [a for a in _app(module).assemble_argument_collection() if a.show]
    usage = [f"usage: {PROGRAM} {verb} [options]", *(_label(a) for a in known if a.required)]
    groups: dict[str, list[str]] = {}
    for argument in known:
        group: Any = argument.parameter.group
        groups.setdefault(group[0].name.lower(), []).append(_entry(argument))
    own = groups.pop("parameters", [])
    groups["options"] = [*own, _columns("-h, --help", "show this help")]
    paragraphs = (module.__doc__ or "").strip().split("\n\n")
    example = f"example{' (Ctrl-C ends run)' if f'{PROGRAM} run ' in module.EXAMPLES else ''}:"
    parts = [
        fill(" ".join(usage), WIDTH, subsequent_indent="  "),
        *(text if "\n  " in f"\n{text}" else fill(text, WIDTH) for text in paragraphs),
        *("\n".join([f"{title}:", *lines]) for title, lines in groups.items()),
        f"{example}\n{indent(module.EXAMPLES, '  ')}",
    ]
    return "\n\n".join(parts).rstrip()


def _entry(argument: Argument) -> str:
    """Lines of the help on an argument: names, value, explanation and default."""
    default, (*_, text) = argument.field_info.default, _notes(argument, str)
    values = default if isinstance(default, tuple) else (default,)
    shown = ",".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)
    hidden = argument.required or default is None or isinstance(default, bool) or not shown
    return _columns(_label(argument), text if hidden else f"{text} [{shown}]")


def _columns(label: str, text: str) -> str:
    return fill(f"  {label:{COLUMN - 4}}  {text}", WIDTH, subsequent_indent=" " * COLUMN)


def _label(argument: Argument) -> str:
    """Names of an argument and the word for its value, such as ``--out DIR``."""
    names = () if argument.index is not None else (", ".join(argument.names),)
    if choices := argument.get_choices():
        return " ".join([*names, f"{{{','.join(choices)}}}"])
    *_, value, _ = ("", *_notes(argument, str))
    return " ".join([*names, *([] if argument.hint is bool else [value])])


def _notes(argument: Argument, kind: type[T]) -> list[T]:
    """All objects of a type in the annotation of an argument, the innermost first."""

    def notes_in(hint: Any) -> Iterator[T]:
        for part in () if get_origin(hint) is Literal else get_args(hint):
            yield from [part] if isinstance(part, kind) else notes_in(part)

    return list(notes_in(argument.field_info.annotation))
