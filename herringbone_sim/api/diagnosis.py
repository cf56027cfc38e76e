"""Campaigns of a rig, their diagnosis, and the catalogue of effects in Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.api.gear import any_gear
from herringbone_sim.api.shown import NotebookResult, data_frame
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.diagnose import diagnose as diagnose_campaign
from herringbone_sim.gap.report import Cause, Report
from herringbone_sim.gap.report_file import write_report
from herringbone_sim.gap.verdict.augmented import Augmented, save_augmented
from herringbone_sim.recording import campaign as recorded
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap import GapArrays
from herringbone_sim.views.figures.gap_arrays import gap_arrays
from herringbone_sim.views.pages.gap.page import write_gap_page
from herringbone_sim.views.tables.forces import write_forces


@dataclass(frozen=True, repr=False)
class Campaign(NotebookResult):
    """Recorded runs of a rig, with their operating points and roles.

    Attributes:
        folder: contains ``campaign.yaml``.
    """

    folder: Path | str

    @property
    def recorded(self) -> recorded.Campaign:
        """Content of ``campaign.yaml``, read at each access; RecordingError if there is none."""
        return recorded.read_campaign(Path(self.folder))

    def title(self) -> str:
        return f"campaign {self.recorded.rig}"

    def facts(self) -> list[tuple[str, str]]:
        return [
            (run.path.name, ", ".join([run.role, *(f"{k} {v:g}" for k, v in run.point.items())]))
            for run in self.recorded.runs
        ]

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per run: name, role, operating point."""
        runs = self.recorded.runs
        return data_frame([{"run": run.path.name, "role": run.role, **run.point} for run in runs])


@dataclass(frozen=True, repr=False)
class Diagnosis(NotebookResult):
    """Result of a diagnosis: effects that the nominal model lacks, with place, size, probability.

    Attributes:
        result: the report: verdict, causes, gap and all else.
        augmented: the model with the effects, recalibrated.
        nominal: parameter file of the rig.
        arrays: residuals or mesh forces for the figures of the page; None if none are formed.
    """

    result: Report
    augmented: Augmented
    nominal: Path
    arrays: GapArrays | None

    @property
    def report(self) -> Mapping[str, Any]:
        """The content of ``report.json``."""
        return self.result.to_dict()

    @property
    def verdict(self) -> str:
        """Verdict: ``none``, ``unknown``, ``ambiguous`` or the id of an effect."""
        return self.result.verdict.verdict

    @property
    def causes(self) -> Sequence[Cause]:
        """Effects with place, parameters and probability, the likeliest first."""
        return self.result.causes

    def title(self) -> str:
        return f"{self.result.campaign}: {self.verdict}"

    def facts(self) -> list[tuple[str, str]]:
        return [
            (f"{c.probability:.1%}", f"{c.effect} at {c.place}" if c.parameters else c.effect)
            for c in self.causes[:5]
        ]

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per cause and parameter, with its 90 % interval."""
        rows = [
            {
                "effect": cause.effect,
                "place": cause.place,
                "probability": cause.probability,
                "parameter": name,
                "value": value.value,
                "ci90": value.ci90,
                "unit": value.unit,
            }
            for cause in self.causes
            for name, value in cause.parameters.items()
        ]
        return data_frame(rows)

    @any_gear()
    def save(self, folder: Path | str) -> Path:
        """Write report.json, augmented.yaml, the page, and forces.csv if forces are in the report.

        Args:
            folder: created if missing.

        Returns:
            Path of the page.

        Raises:
            AnalysisError: the folder can't be written.
        """
        out = make_folder(Path(folder))
        nominal = load_parameters(self.nominal).changed({"model": "full"})
        write_report(out / "report.json", self.result)
        save_augmented(out / "augmented.yaml", nominal, self.augmented, self.result.campaign)
        write_forces(out / "forces.csv", None if self.arrays is None else self.arrays.forces)
        return write_gap_page(self.result, out, self.arrays, self.nominal)


@any_gear()
def diagnose(campaign: Campaign | Path | str, nominal: Path | str) -> Diagnosis:
    """Diagnose in which effects a rig differs from the nominal model, as the command ``gap`` does.

    Args:
        campaign: a campaign or its folder.
        nominal: parameter file of the rig; its gear is used as the full model.

    Raises:
        RecordingError: no campaign there.
        ParameterError: no such parameter file, or a value out of range.
        AnalysisError: no run of role ``fit``.
    """
    folder = campaign.folder if isinstance(campaign, Campaign) else campaign
    parameters = load_parameters(nominal).changed({"model": "full"})
    prepared = prepare(Path(folder), parameters)
    result = diagnose_campaign(prepared)
    arrays = gap_arrays(result.calibrated, result.report.forces)
    return Diagnosis(result.report, result.augmented, Path(nominal), arrays)


@dataclass(frozen=True, repr=False)
class Catalogue(NotebookResult):
    """Table of the effects that the nominal model leaves out."""

    def title(self) -> str:
        return f"{len(effects())} effects"

    def facts(self) -> list[tuple[str, str]]:
        return [(effect.id, effect.text) for effect in effects().values()]

    def to_pandas(self) -> Any:
        """``pandas.DataFrame`` with a row per parameter of each effect: unit, bounds, meaning."""
        rows = [
            (effect.id, effect.level, p.name, p.unit, p.low, p.high, p.text)
            for effect in effects().values()
            for p in effect.parameters
        ]
        names = ("effect", "level", "parameter", "unit", "low", "high", "meaning")
        return data_frame(rows, names)


def catalogue() -> Catalogue:
    """Return the effects that a gear may have and a diagnosis may name, those of users too."""
    return Catalogue()
