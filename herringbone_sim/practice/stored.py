"""Read a bench folder: outcomes of the diagnosis and of the baselines, with seals checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.diagnosis.evidence import Evidence
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.bench import label_path, read_json, read_seals
from herringbone_sim.practice.label import read_label
from herringbone_sim.practice.outcome import RELATIVE_ERROR, Outcome, outcome


@dataclass(frozen=True)
class Bench:
    """Outcomes of a bench.

    Attributes:
        note: content of ``bench.json``.
        cases: of the diagnosis; ``rivals``: of each baseline, by name.
        sealed: number of labels.
        sources: number of reports by digest of the diagnosis's sources.
        durations_s: time of each diagnosis that did not fail [s].
        left_out: number of seeds without a campaign.
    """

    note: Mapping[str, Any]
    cases: tuple[Outcome, ...]
    rivals: Mapping[str, tuple[Outcome, ...]]
    sealed: int
    sources: Mapping[str, int]
    durations_s: tuple[float, ...]
    left_out: int


def read_bench(folder: Path) -> Bench:
    """Read all finished cases of a bench folder and check each label against its seal.

    Raises:
        AnalysisError: no finished case, or a report that violates the schema.
        RecordingError: a label was changed.
    """
    cases, notes = [], []
    others: dict[str, list[Outcome]] = {}
    for name, label, place in _trials(folder):
        try:
            cases.append(outcome(label, read_json(place / "report.json"), name))
            for rival, report in read_json(place / "baselines.json").items():
                others.setdefault(rival, []).append(outcome(label, report, name))
        except AnalysisError as error:
            raise AnalysisError(f"{place}: {error}: diagnose it again") from None
        notes.append(read_json(place / "case.json"))
    if not cases:
        raise AnalysisError(f"{folder} must hold finished campaigns of a bench, got none")
    return Bench(
        note=read_json(folder / "bench.json"),
        cases=tuple(cases),
        rivals={name: tuple(them) for name, them in others.items()},
        sealed=len(read_seals(folder)),
        sources=Counter(str(note.get("sources")) for note in notes),
        durations_s=tuple(
            duration_s
            for note in notes
            if isinstance(duration_s := note.get("seconds"), (int, float))
        ),
        left_out=len(read_json(folder / "left_out.json")),
    )


def _trials(folder: Path) -> Iterator[tuple[str, dict[str, Any], Path]]:
    """Yield name, label and folder of results of each campaign that has a report.

    A failed diagnosis has a report too. RecordingError for a label that was changed.
    """
    for name, sealed in read_seals(folder).items():
        place = folder / "reports" / name
        if (place / "report.json").is_file():
            yield name, read_label(label_path(folder, name), sealed), place


def stored_evidence(
    folder: Path,
) -> Iterator[tuple[dict[str, Any], dict[str, Any], Evidence, float]]:
    """Yield label, report, evidence and relative error of each finished campaign with evidence.

    The relative error is the standard deviation of the model error, relative to a fitted size; the
    intervals of the report include it (``case.json``).

    Raises:
        RecordingError: a label can't be read, or was changed after it was sealed.
        AnalysisError: another file can't be read, or is of another version.
    """
    for _, label, place in _trials(folder):
        record = read_json(place / "evidence.json")
        if record:
            relative_error = read_json(place / "case.json").get(RELATIVE_ERROR)
            if not isinstance(relative_error, float):
                raise AnalysisError(
                    f"{place / 'case.json'} must have the {RELATIVE_ERROR}, a number, got "
                    f"{relative_error}: diagnose it again"
                )
            try:
                evidence = Evidence.read(record)
            except (KeyError, TypeError, ValueError) as error:
                raise AnalysisError(
                    f"{place / 'evidence.json'} must be the evidence of a campaign, got {error}: "
                    "diagnose it again"
                ) from None
            yield label, read_json(place / "report.json"), evidence, relative_error
