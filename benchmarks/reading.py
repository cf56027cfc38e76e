"""Which reading of the paper's open parameters gives most of its statements at once.

Every reading is a set of this package's parameters and a damping ratio for section 4. Its score is
the number of statements right by the rules of ``herringbone_sim.paper.checks``, from sweeps of
``--values`` values. Natural readings (each choice one that a reader of the paper could make) and
readings drawn at random around the best of them (fitted decimals) are told apart: of many fitted
ones the best is chosen after the fact.

    python benchmarks/reading.py --out readings              # natural readings, some minutes
    python benchmarks/reading.py --out readings --draws 200  # and fitted ones

Scores are kept in OUT/scores.jsonl: a second run goes on where the first was stopped.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.core.scaling import scales
from herringbone_sim.errors import HerringboneError
from herringbone_sim.paper.checks import Evidence, check
from herringbone_sim.paper.observe import BatchRunner
from herringbone_sim.paper.regimes import motions_of
from herringbone_sim.paper.scenarios import SCENARIOS, scenario
from herringbone_sim.paper.staircase import Reading, request, sweep
from herringbone_sim.paper.statements import MotionAt, statements

BETA = math.radians(16.0)
ALPHA_T = math.degrees(math.atan(math.tan(math.radians(20.0)) / math.cos(BETA)))
XI = (0.08, 0.085, 0.0875, 0.09, 0.10)
PRINTED: Mapping[str, Any] = {"b_c": 1e-4, "gamma": 1.2e-5, "alpha_w": 20.0, "thermal_rp": "own"}

CHOICES: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "cos beta": {
        "cos^2 on the meshes (Eq. 18)": {"projection": "mesh_and_torque"},
        "on the torques": {"projection": "torque"},
    },
    "Eq. 2, ring": {
        "z_r + z_p (printed)": {"thermal_rp": "own"},
        "z_r - z_p": {"thermal_rp": "sun"},
    },
    "module": {
        "4 mm normal": {"m_n": 0.004},
        "4 mm transverse": {"m_n": 0.004 * math.cos(BETA)},
    },
    "alpha'": {"20": {"alpha_w": 20.0}, "alpha_t 20.74": {"alpha_w": ALPHA_T}},
}
BEST: Mapping[str, Any] = {
    **PRINTED,
    "projection": "torque",
    "thermal_rp": "sun",
    "m_n": 0.004 * math.cos(BETA),
    "alpha_w": ALPHA_T,
}
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "helix 15 deg": {"beta": 15.0, "m_n": 0.004 * math.cos(math.radians(15.0))},
    "gamma 1.1e-5": {"gamma": 1.1e-5},
    "gamma 1.15e-5": {"gamma": 1.15e-5},
    "gamma 1.18e-5": {"gamma": 1.18e-5},
    "gamma 1.25e-5": {"gamma": 1.25e-5},
    "gamma 1.15e-5, alpha' 22": {"gamma": 1.15e-5, "alpha_w": 22.0},
    "b_c 5e-5 m, half the gamma": {"b_c": 5e-5, "gamma": 0.6e-5},
    "b_c 2e-4 m, twice the gamma": {"b_c": 2e-4, "gamma": 2.4e-5},
    "T_2 = T_1": {"T_2": 220.0},
    "m_p of both sides in I_ce": {"m_p": 8.97},
    "fixed ring without mass in Eq. 11": {"I_r": 1e6},
    "omega_n as printed": {"omega_n": "printed"},
    "M = I / r_b as printed": {"masses": "printed"},
    "error forcing with the other sign": {"e_factor": (-1.0,)},
    "right half shifted by pi": {"mesh_phase": (0.0, math.pi, 0.0, math.pi)},
    "right half shifted by pi/2": {"mesh_phase": (0.0, math.pi / 2, 0.0, math.pi / 2)},
    "stiffness phase pi/2": {"phi_a": (math.pi / 2,)},
    "start x = 0.01": {"initial_x": (0.01,)},
    "start x = 0.1": {"initial_x": (0.1,)},
    "start x = -0.05": {"initial_x": (-0.05,)},
    "start x = 0.6 (drive flank)": {"initial_x": (0.6,)},
    "start with bodies at rest": {"initial_v": (-0.35,)},
    "start asymmetric by 1e-9": {"initial_noise": 1e-9, "seed": 1},
    "start asymmetric by 0.3": {"initial_noise": 0.3, "seed": 1},
    "RK4, 100 steps": {"method": "rk4", "steps_per_cycle": 100},
    "control + K": {"control_phase": math.pi},
    "control K sin": {"control_phase": -math.pi / 2},
    "control on the sun meshes alone": {"control_on": (1.0, 1.0, 0.0, 0.0)},
}


@dataclass(frozen=True)
class Score:
    """Statements right by scenario, at the best damping ratio of section 4."""

    name: str
    kind: str
    right: Mapping[str, int]
    xi: float

    @property
    def total(self) -> int:
        return sum(self.right.values())


def natural() -> Iterator[tuple[str, Mapping[str, Any]]]:
    """All combinations of the choices, then one change each of the best."""
    for names in itertools.product(*CHOICES.values()):
        changes = [CHOICES[c][name] for c, name in zip(CHOICES, names, strict=True)]
        pairs = zip(CHOICES, names, strict=True)
        title = "; ".join(f"{choice} {name}" for choice, name in pairs)
        yield title, {**PRINTED, **{k: v for change in changes for k, v in change.items()}}
    for name, change in VARIANTS.items():
        yield f"best, but {name}", {**BEST, **change}


def drawn(count: int) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Decimals around the best natural reading, from one seed: always the same ones."""
    rng = np.random.default_rng(0)
    for number in range(count):
        values = {
            "b_c": 1e-4 * rng.uniform(0.95, 1.05),
            "gamma": 1.2e-5 * rng.uniform(0.93, 1.07),
            "I_c": 0.22 * rng.uniform(0.93, 1.07),
            "initial_x": (rng.choice([0.0, rng.normal(0.0, 0.1)]),),
        }
        shown = ", ".join(f"{k} {np.ravel(v)[0]:.7g}" for k, v in values.items())
        yield f"draw {number}: {shown}", {**BEST, **values}


def parameters(changes: Mapping[str, Any]) -> Parameters:
    """The set of a reading; what Eqs. 11 and 17 print is put into inertias and omega_n."""
    values = {k: v for k, v in changes.items() if v != "printed"}
    s = scales(Parameters().changed(values))
    if "omega_n" in changes:
        values["omega_n"] = math.sqrt(1.5e9 / (1.0 / s.M_s + 1.0 / s.M_p))
    if "masses" in changes:
        inertias = {"I_s": s.r_bs, "I_p": s.r_bp, "I_r": s.r_br, "I_c": s.r_bc, "m_p": s.r_bc}
        values |= {name: getattr(Parameters, name) * r for name, r in inertias.items()}
    return Parameters().changed(values)


def score(name: str, kind: str, changes: Mapping[str, Any], n: int) -> Score:
    """Statements right; those of section 4 at the damping ratio that gives most of them."""
    base = parameters(changes)
    runner = BatchRunner()
    right = {key: _right(runner, Reading(base, 0.0), key, n) for key in "AB"}
    rows = {xi: {key: _right(runner, Reading(base, xi), key, n) for key in "CDE"} for xi in XI}
    xi = max(rows, key=lambda one: sum(rows[one].values()))
    return Score(name, kind, {**right, **rows[xi]}, xi)


def _right(runner: BatchRunner, reading: Reading, key: str, n: int) -> int:
    one = scenario(key)
    wanted = statements(key)
    found = sweep(runner, one, reading, n, exponents=one.has_exponents)
    single = [w.value for w in wanted if isinstance(w, MotionAt)]
    motions = motions_of(runner.batch(request(one, reading, single))) if single else []
    at = {value: (int(m), math.nan) for value, m in zip(single, motions, strict=True)}
    evidence = Evidence(found, {}, at)
    return sum(check(statement, evidence).ok for statement in wanted)


def scores(
    wanted: Sequence[tuple[str, str, Mapping[str, Any]]], n: int, path: Path
) -> list[Score]:
    """Scores of readings (name, kind, changes); known ones are read from the file."""
    known = _known(path)
    found = []
    for name, kind, changes in tqdm(wanted, unit="reading", disable=None):
        key = json.dumps([n, name, sorted(changes.items())])
        if key not in known:
            try:
                known[key] = score(name, kind, changes, n)
            except HerringboneError as error:
                known[key] = Score(f"{name} ({error})", kind, dict.fromkeys("ABCDE", 0), math.nan)
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, **asdict(known[key])}) + "\n")
        found.append(known[key])
    return found


def _known(path: Path) -> dict[str, Score]:
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {row.pop("key"): Score(**row) for row in rows}


def table(found: Sequence[Score], most: int) -> str:
    """The best readings, a line each."""
    counts = {s.key: len(statements(s.key)) for s in SCENARIOS}
    head = " ".join(f"{key}/{count}" for key, count in counts.items())
    lines = [f"total/{sum(counts.values())} {head}  xi of 4  reading"]
    for one in sorted(found, key=lambda s: -s.total)[:most]:
        cells = " ".join(f"{one.right[key]:4d}" for key in counts)
        lines.append(f"{one.total:8d} {cells}  {one.xi:7.4g}  {one.name}")
    return "\n".join(lines)


def main() -> None:
    """Print the natural readings and, apart from them, the fitted ones."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder that keeps the scores")
    parser.add_argument("--values", type=int, default=80, help="values a sweep (default: 80)")
    parser.add_argument("--draws", type=int, default=0, help="fitted readings to try")
    args = parser.parse_args()
    warnings.simplefilter("ignore", ParameterWarning)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "scores.jsonl"
    plain = [(name, "natural", changes) for name, changes in natural()]
    print("Natural readings\n" + table(scores(plain, args.values, path), len(plain)))
    if args.draws:
        fitted = [(name, "fitted", changes) for name, changes in drawn(args.draws)]
        print("\nFitted decimals, the best ten of", len(fitted))
        print(table(scores(fitted, args.values, path), 10))


if __name__ == "__main__":
    main()
