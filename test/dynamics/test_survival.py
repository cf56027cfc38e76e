"""Fate of starts and stability of the motion from rest, and the verb over a parameter."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from gears import PAPER, paper

from herringbone_sim.__main__ import main
from herringbone_sim.core.model import initial_state
from herringbone_sim.dynamics.basins import gear_sections, random_starts
from herringbone_sim.dynamics.survival import FATES, survival


def fate(model, n=12, transient=1500):
    starts = random_starts(model, n, np.random.default_rng(0))
    return survival(model, gear_sections(model, transient, 100), starts)


def test_the_only_motion_of_a_hot_gear_is_reached_by_all():
    """delta_T = 85: P1, stable both ways, with an interval that stays below 1 only at one end."""
    found = fate(paper(delta_T=85.0))
    assert (found.motion, list(found.counts)) == ("P1", [12, 0, 0, 0])
    assert found.within[0] < found.transverse[0] < -0.015
    assert found.shares[0] == pytest.approx([1.0, 0.7575, 1.0], abs=1e-3)


def test_symmetric_chaos_is_reached_by_no_uneven_start():
    """delta_T = 20: chaos from rest keeps left = right for ever, and no other start finds it."""
    found = fate(paper(delta_T=20.0), transient=600)
    assert found.motion == "chaotic"
    assert list(found.counts) == [0, 0, 0, 12]
    assert found.transverse[0] > 0.03


def test_the_published_period_2_is_missed_by_most():
    """delta_T = 70: P2 from rest, transversally stable, and yet reached by few."""
    found = fate(paper(delta_T=70.0), transient=3000)
    assert found.motion == "P2"
    assert found.counts[0] <= 3
    assert found.counts[2:].sum() >= 6
    assert -0.012 < found.transverse[0] < 0.0


def test_fates_by_what_the_starts_lead_to(gear):
    """By planted sections: rest at P1, one start there, one at another, one uneven, one failed."""
    model = gear(delta_T=85.0, e_m=0.0)
    one, other, uneven = np.ones(8), np.full(8, 3.0), np.arange(8.0)
    ends = {0.0: one, 1.0: one, 2.0: other, 3.0: uneven, 4.0: np.full(8, np.nan)}

    def sections_of(starts):
        return np.array([np.tile(ends[float(y[0])], (60, 1)) for y in starts])

    starts = np.zeros((4, 8))
    starts[:, 0] = 1.0, 2.0, 3.0, 4.0
    assert initial_state(model)[0] == 0.0
    found = survival(model, sections_of, starts)
    assert (list(found.counts[:2]), found.counts[2:].sum(), found.starts) == ([1, 1], 1, 4)
    assert len(FATES) == len(found.shares) == 4


def test_verb_over_delta_T(tmp_path, capsys):
    argv = ["survival", "--parameters", str(PAPER), "--over", "delta_T", "--out", str(tmp_path)]
    few = ["--values", "2", "--starts", "4", "--transient", "1000"]
    assert main([*argv, "--from", "85", "--to", "90", *few]) == 0
    with (tmp_path / "survival.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["value"], row["motion"], row["from_rest"]) for row in rows] == [
        ("85", "P1", "1"),
        ("90", "P1", "1"),
    ]
    assert all(float(row["transverse"]) < 0.0 for row in rows)
    assert (tmp_path / "survival.png").stat().st_size > 10000
    assert not (tmp_path / "unfinished").exists()
    assert "reached by" in capsys.readouterr().out
    assert main([*argv, "--from", "85", "--to", "80"]) == 2
    assert main([*argv[:3], "--over", "warmth", "--from", "1", "--to", "2", *argv[5:]]) == 2
    assert "no parameter 'warmth'" in capsys.readouterr().err
