"""Run a bench of withheld effects: seal all labels, then diagnose the campaigns.

A folder contains ``bench.json`` (settings), ``seals.json``, ``left_out.json``, ``labels/``, and
``reports/NAME/`` with ``report.json``, ``baselines.json``, ``evidence.json`` and ``case.json``.
Existing files are not computed again, so an interrupted bench continues.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from herringbone_sim.errors import AnalysisError, shown
from herringbone_sim.practice.label import read_label
from herringbone_sim.practice.pool import LOCAL, Resources, pool
from herringbone_sim.practice.seeds import SeedOverlap
from herringbone_sim.practice.trial import Setting, diagnose_case, label_of_seed, sources
from herringbone_sim.recording import safe_json
from herringbone_sim.recording.safe_json import JsonError
from herringbone_sim.sweeps.cluster import completed
from herringbone_sim.sweeps.output import make_folder, whole_file
from herringbone_sim.version import VERSION

Say = Callable[[str], None]


def name_of(seed: int) -> str:
    """Return the name of the campaign of a seed, such as ``practice_000104``."""
    return f"practice_{seed:06d}"


def run_bench(
    folder: Path,
    seeds: Sequence[int],
    setting: Setting,
    seed_overlap: SeedOverlap,
    resources: Resources = LOCAL,
    again: bool = False,
    say: Say = print,
) -> None:
    """Seal the labels of all seeds, then diagnose the campaigns that have no report.

    Args:
        folder: of the bench; created, or continued if it has the same setting.
        seed_overlap: recorded in ``bench.json``.
        resources: processes on this machine, or a Dask cluster.
        again: repeat diagnoses whose report was made by other source code of the diagnosis.
        say: called with each message to the user.

    Raises:
        AnalysisError: a folder with another setting, or no scheduler.
        RecordingError: a label changed after it was sealed, or a campaign is not reproducible.
    """
    make_folder(folder)
    _note(folder, seeds, setting, seed_overlap)
    with pool(resources.workers, resources.scheduler) as (executor, cores):
        seal_labels(folder, seeds, setting, executor, cores, say)
        seals = read_seals(folder)
        cases = [(s, seals[name_of(s)]) for s in seeds if name_of(s) in seals]
        todo = [case for case in cases if not _done(folder, name_of(case[0]), again)]
        tasks = [
            (s, setting, read_label(label_path(folder, name_of(s)), sealed), sealed)
            for s, sealed in todo
        ]
        look = {"total": len(cases), "initial": len(cases) - len(todo), "desc": "diagnose"}
        for task, files in _with_bar(executor, diagnose_case, tasks, cores, look):
            place = make_folder(folder / "reports" / name_of(task[0]))
            for name, text in files.items():  # the report comes last, as it marks a case as done
                _write(place / name, text)


def seal_labels(
    folder: Path,
    seeds: Sequence[int],
    setting: Setting,
    executor: Executor,
    cores: int,
    say: Say = print,
) -> None:
    """Write every missing label, and all seals to ``seals.json``, before anything is diagnosed.

    Seeds whose rig diverges are listed with the reason in ``left_out.json``.
    """
    make_folder(folder / "labels")
    left = read_json(folder / "left_out.json")
    todo = [
        (s, setting)
        for s in seeds
        if not label_path(folder, name_of(s)).is_file() and name_of(s) not in left
    ]
    look = {"total": len(seeds), "initial": len(seeds) - len(todo), "desc": "seal labels"}
    for task, (text, reason) in _with_bar(executor, label_of_seed, todo, cores, look):
        if text is None:
            left[name_of(task[0])] = reason
            _write(folder / "left_out.json", _json(left))
        else:
            _write(label_path(folder, name_of(task[0])), text)
    seals = read_seals(folder)
    for name in sorted(name_of(s) for s in seeds):
        if name not in seals and name not in left:
            seals[name] = hashlib.sha256(label_path(folder, name).read_bytes()).hexdigest()
    text = _json(dict(sorted(seals.items())))
    _write(folder / "seals.json", text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    say(f"sealed {len(seals)} labels: {folder / 'seals.json'}, sha256 {digest}")
    if left:
        say(f"left out {len(left)} seeds whose rig leaves the range of any gear")


def label_path(folder: Path, name: str) -> Path:
    """Return the path of the label of a campaign."""
    return folder / "labels" / f"{name}.json"


def read_seals(folder: Path) -> dict[str, str]:
    """Return the seal (SHA-256) of each label by campaign name; empty before any was sealed."""
    return {str(name): str(value) for name, value in read_json(folder / "seals.json").items()}


def read_json(file: Path) -> dict[str, Any]:
    """Return the content of a JSON file, empty if there is none; AnalysisError if unreadable."""
    try:
        return safe_json.read_json(file)
    except FileNotFoundError:
        return {}
    except (OSError, JsonError) as error:
        raise AnalysisError(f"can't read {file}: {error}: start in another folder") from None


def _note(folder: Path, seeds: Sequence[int], setting: Setting, seed_overlap: SeedOverlap) -> None:
    """Write ``bench.json`` with seeds added to earlier ones; AnalysisError for another setting."""
    before = read_json(folder / "bench.json")
    asked = json.loads(json.dumps(asdict(setting)))
    # Options that a stored setting lacks did not exist then; their default is what was drawn.
    stored = before.get("setting")
    if isinstance(stored, dict):
        stored = {**json.loads(json.dumps(asdict(Setting()))), **stored}
    if before and stored != asked:
        raise AnalysisError(
            f"{folder} holds a bench with {shown(before.get('setting'))}, got {asked}: choose "
            "another --out"
        )
    known_seeds = before.get("seeds", [])
    if not isinstance(known_seeds, list) or not all(type(seed) is int for seed in known_seeds):
        raise AnalysisError(
            f"{folder / 'bench.json'} must have seeds, a list of whole numbers, got "
            f"{shown(known_seeds)}: choose another --out"
        )
    known = seed_overlap.frozen
    content = {
        "schema": "herringbone_sim/bench/1",
        "setting": asked,
        "seeds": sorted({*known_seeds, *seeds}),
        "version": VERSION,
        "sources": sources(),
        "calibration": known and {"file": known.path.name, "sha256": known.sha256},
        "calibration_family": bool(seed_overlap.seeds or before.get("calibration_family")),
    }
    _write(folder / "bench.json", _json(content))


def _done(folder: Path, name: str, again: bool) -> bool:
    """Return whether a campaign has a report; if ``again``, one by the present source code."""
    place = folder / "reports" / name
    if not (place / "report.json").is_file():
        return False
    return not again or read_json(place / "case.json").get("sources") == sources()


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=1) + "\n"


def _write(file: Path, text: str) -> None:
    with whole_file(file) as handle:
        handle.write(text.encode())


def _with_bar(
    executor: Executor,
    work: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    cores: int,
    look: Mapping[str, Any],
) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Run ``work`` on tasks; yield each with its result as it completes, with a progress bar."""
    with tqdm(unit="campaign", disable=None, smoothing=0.05, **look) as bar:
        for done in completed(lambda task: executor.submit(work, *task), deque(tasks), cores):
            yield done
            bar.update()
