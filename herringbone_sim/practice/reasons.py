"""Most frequent confusions behind each figure of a bench, and table rows by cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from herringbone_sim.practice.outcome import Outcome

MOST = 6


def reasons(figure: str, cases: Sequence[Outcome]) -> list[str]:
    """Return sentences on what most often goes wrong in the cases behind a figure of a bench.

    Args:
        figure: name of the figure, such as ``locus``; see ``score.METRICS``.
        cases: scored cases; whether they miss the target is not considered.

    Returns:
        Empty for a figure without such an analysis, or if nothing goes wrong.
    """
    explain = _REASONS.get(figure)
    return explain(cases) if explain else []


def _counted(texts: Sequence[str], head: str) -> list[str]:
    """Return a sentence with the most frequent texts and their counts; empty without texts."""
    if not texts:
        return []
    common = Counter(texts).most_common(MOST)
    more = len(set(texts)) - len(common)
    rest = f"; {more} more" if more > 0 else ""
    return [f"{head}: " + "; ".join(f"{text} ({n})" for text, n in common) + rest]


def _name(case: Outcome) -> str:
    """Return the names of the causes of a case, joined by ``+``."""
    return " + ".join(case.internal) or "none"


def _confused(wrong: Callable[[Outcome], bool]) -> Callable[[Sequence[Outcome]], list[str]]:
    """Return a function that counts truth and first effect of the cases that are ``wrong``."""

    def tell(cases: Sequence[Outcome]) -> list[str]:
        known = [c for c in cases if c.kind in ("single", "pair") and wrong(c)]
        return _counted([f"{_name(c)} -> {c.first}" for c in known], "truth -> first")

    return tell


def _named_on_none(cases: Sequence[Outcome]) -> list[str]:
    """Return the effects that reports name on rigs without effects, counted."""
    wrong = [c for c in cases if c.kind == "none" and c.named]
    return _counted([" + ".join(c.said) for c in wrong], "said of empty rigs")


def _pairs(cases: Sequence[Outcome]) -> list[str]:
    """Return how many effects of missed pairs were named, and which, counted."""
    wrong = [c for c in cases if c.kind == "pair" and not c.both]
    shape = [f"{len(set(c.said) & set(c.truth))} of 2 right, {len(c.said)} named" for c in wrong]
    texts = [f"{_name(c)} -> {' + '.join(c.said)}" for c in wrong]
    return _counted(shape, "pairs") + _counted(texts, "truth -> named")


def _doubted(cases: Sequence[Outcome]) -> list[str]:
    """Return the mean probability of the truth by kind, and the cases where it is under 0.5."""
    means = {
        kind: [c.p_truth for c in cases if c.kind == kind]
        for kind in ("none", "single", "pair", "unknown")
    }
    summary = "; ".join(
        f"{kind} {np.mean(p):.2f} (n = {len(p)})" for kind, p in means.items() if p
    )
    doubted = [f"{_name(c)} -> {c.first}" for c in cases if c.p_truth < 0.5]
    return [f"mean on the truth: {summary}", *_counted(doubted, "under 0.5, truth -> first")]


def _calibration(cases: Sequence[Outcome]) -> list[str]:
    """Return stated probability against fraction of true statements, in bins."""
    edges = (0.0, 0.5, 0.7, 0.9, 0.97, 1.0 + 1e-9)
    bins = []
    for low, high in pairwise(edges):
        inside = [c for c in cases if low <= c.sure < high]
        if inside:
            sure, share_true = np.mean([c.sure for c in inside]), np.mean([c.held for c in inside])
            bins.append(f"said {sure:.2f}, true {share_true:.2f} (n = {len(inside)})")
    return ["probability of what is said and how often it is true: " + "; ".join(bins)]


def _unknowns(cases: Sequence[Outcome]) -> list[str]:
    taken = [f"{_name(c)} -> {c.first}" for c in cases if c.kind == "unknown" and not c.right]
    given = [f"{_name(c)}" for c in cases if c.kind in ("single", "pair") and c.first == "unknown"]
    return _counted(taken, "unknown -> first") + _counted(given, "known but called unknown")


def _wrong_names(cases: Sequence[Outcome]) -> list[str]:
    wrong = [f"{_name(c)} -> {c.first}" for c in cases if c.kind == "unknown" and c.wrong_name]
    return _counted(wrong, "unknown -> name")


def _places(cases: Sequence[Outcome]) -> list[str]:
    return _counted([c.first for c in cases if c.locus is False], "wrong place of")


def _errors(cases: Sequence[Outcome]) -> list[str]:
    errors = _by_effect(cases, lambda c: () if c.error is None else (c.error,))
    return _ranked(
        {name: float(np.median(v)) for name, v in errors.items()}, errors, "median error"
    )


def _coverage(cases: Sequence[Outcome]) -> list[str]:
    """Return the effects whose intervals miss the true value most often."""
    covered = _by_effect(cases, lambda c: c.covered)
    shares = {name: 1.0 - float(np.mean(v)) for name, v in covered.items()}
    return _ranked(shares, covered, "share of intervals without the truth")


def _closures(cases: Sequence[Outcome]) -> list[str]:
    """Return the cases of known effects with a closure under 0.7, counted."""
    known = [c for c in cases if c.kind in ("single", "pair")]
    low = [c for c in known if (c.closure or 0.0) < 0.7]
    tied = [f"{_name(c)} -> {' + '.join(c.said)}" for c in low]
    right = sum(c.right for c in low)
    count = f"under 0.7: {len(low)} of {len(known)}, {right} of them with the right effect first"
    return [count, *_counted(tied, "under 0.7, truth -> named")]


def _by_effect(
    cases: Sequence[Outcome], values: Callable[[Outcome], Sequence[float]]
) -> dict[str, list[float]]:
    """Return the values of the cases by most probable effect; one without values is omitted."""
    by_effect: dict[str, list[float]] = {}
    for c in cases:
        for value in values(c):
            by_effect.setdefault(c.first, []).append(value)
    return by_effect


def _ranked(values: dict[str, float], by_effect: dict[str, list[float]], head: str) -> list[str]:
    """Return a sentence with the largest values by effect."""
    worst = sorted(values, key=lambda name: -values[name])[:MOST]
    text = "; ".join(f"{name} {values[name]:.3f} (n = {len(by_effect[name])})" for name in worst)
    return [f"{head}, worst first: {text}"] if text else []


_REASONS: dict[str, Callable[[Sequence[Outcome]], list[str]]] = {
    "healthy called none": _named_on_none,
    "false attribution on none": _named_on_none,
    "right effect first": _confused(lambda c: not c.right),
    "right or in the named class": _confused(lambda c: not c.in_class),
    "among the first three": _confused(lambda c: not c.in_three),
    "both effects of a pair": _pairs,
    "mean probability on the truth": _doubted,
    "Brier score": _doubted,
    "calibration error": _calibration,
    "AUROC unknown against known": _unknowns,
    "confident wrong names on unknown": _wrong_names,
    "locus": _places,
    "parameter error, median": _errors,
    "coverage of 90 % intervals": _coverage,
    "closure, median": _closures,
    "closure, tenth percentile": _closures,
}


def by_cause(cases: Sequence[Outcome]) -> list[list[str]]:
    """Return a table row of texts for each cause, in the order of their names.

    A cause is a single effect, one outside the catalogue (``unknown: NAME``), none, or ``a pair``:
    all pairs together. Cells: cause; number of cases; of them right first, and in class; loci
    right of those judged; median error; median closure; most frequent wrong names. A text is empty
    where there is no value.
    """
    groups: dict[str, list[Outcome]] = {}
    for c in cases:
        if c.kind == "pair":
            key = "a pair"
        else:
            key = f"unknown: {_name(c)}" if c.kind == "unknown" else _name(c)
        groups.setdefault(key, []).append(c)
    return [_line(name, groups[name]) for name in sorted(groups)]


def _line(name: str, cases: Sequence[Outcome]) -> list[str]:
    """Return the table row of one cause."""
    loci = [c.locus for c in cases if c.locus is not None]
    errors = [c.error for c in cases if c.error is not None]
    closures = [c.closure for c in cases if c.closure is not None]
    wrong = Counter(c.first for c in cases if not c.right).most_common(3)
    return [
        name,
        str(len(cases)),
        str(sum(c.right for c in cases)),
        str(sum(c.in_class for c in cases)),
        f"{sum(loci)}/{len(loci)}" if loci else "",
        f"{np.median(errors):.3f}" if errors else "",
        f"{np.median(closures):.2f}" if closures else "",
        ", ".join(f"{other} ({n})" for other, n in wrong),
    ]
