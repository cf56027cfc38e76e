"""Repetition of recorded runs: to the bit, or it says where it differs."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from herringbone_sim.__main__ import main
from herringbone_sim.core.integrate import Stepper, change
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.replay import verify


def write(folder: Path, start: int = 0, spoil: int | None = None, **content: Any) -> Path:
    """A run of chaos with a change of K, Omega and the sample grid; one bit spoilt if wanted."""
    p = Parameters(delta_T=20.0)
    model = build(p)
    stepper = Stepper(model)
    state = stepper.advance(stepper.start(), start).end if start else stepper.start()
    stored = {"y": state.y.tolist(), "cycle": state.cycle, "index": state.index, "t": state.t}
    channels = {"parameters": to_mapping(p), "state": stored, **content}
    writer = RunWriter.create(folder, "run", "/sim", channels, model.layout.channels, 0)
    for values, n in (
        ({}, 5 * 16 - start % 16),
        ({"K": 0.3, "Omega": 0.9}, 32),
        ({"samples_per_cycle": 10}, 40),
    ):
        new = build(model.parameters.changed(values))
        state = change(model, new, state)
        model = new
        if values:
            writer.write_parameter_event(state.t, "/sim", values)
        block = Stepper(model).advance(state, n)
        rows = block.rows.copy()
        if spoil is not None and "K" in values:
            rows[spoil, 7] = np.nextafter(rows[spoil, 7], 1.0)
        writer.write_samples(rows)
        state = block.end
    writer.close()
    return writer.path


@pytest.mark.parametrize("start", [0, 7, 16 * 30])
def test_a_run_with_changes_is_repeated_to_the_bit(tmp_path: Path, start: int) -> None:
    verdict = verify(read_recording(write(tmp_path, start)))
    assert verdict.identical
    assert verdict.changes == 2
    assert verdict.samples == 5 * 16 - start % 16 + 32 + 40


def test_one_spoilt_bit_is_found_and_placed(tmp_path: Path) -> None:
    verdict = verify(read_recording(write(tmp_path, spoil=11)))
    assert verdict.first_difference == 5 * 16 + 11
    assert 0.0 < verdict.largest_difference < 1e-15


@pytest.mark.parametrize("beyond", [0, 3])
def test_samples_after_a_repetition_that_diverges_are_not_identical(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], beyond: int
) -> None:
    p = Parameters(delta_T=20.0)
    stepper = Stepper(build(p))
    state = replace(stepper.start(), y=stepper.start().y + 1e7)
    rows = stepper.advance(state, 32).rows
    later = np.repeat(rows[-1:], beyond, axis=0)
    later[:, 0] += 1e-5 * np.arange(1, beyond + 1)
    stored = {"y": state.y.tolist(), "cycle": state.cycle, "index": state.index, "t": state.t}
    channels = {"parameters": to_mapping(p), "state": stored}
    writer = RunWriter.create(tmp_path, "run", "/sim", channels, stepper.model.layout.channels, 0)
    writer.write_samples(np.concatenate([rows, later]))
    writer.close()
    verdict = verify(read_recording(writer.path))
    assert (verdict.identical, verdict.samples) == (not beyond, len(rows))
    said = (verdict.first_difference, verdict.largest_difference)
    assert said == ((len(rows), np.inf) if beyond else (-1, 0.0))
    assert main(["replay", str(writer.path), "--verify"]) == bool(beyond)
    assert ("as the repetition diverges" in capsys.readouterr().out) == bool(beyond)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_values_that_are_missing_differ_by_no_number(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path))
    nothing = np.full_like(recording.samples.data, np.nan)
    samples = TimeSeries(recording.samples.times, nothing, recording.samples.names)
    verdict = verify(replace(recording, samples=samples))
    assert (verdict.first_difference, verdict.largest_difference) == (0, 0.0)


def _stored(**odd: Any) -> dict[str, Any]:
    return {"y": [0.0] * 12, "cycle": 0, "index": 0, "t": 0.0} | odd


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (_stored(y=[0.0] * 11), "holds a state of 11 numbers"),
        (_stored(y=[[0.0] * 12]), "initial state"),
        (_stored(y=["a"] * 12), "initial state"),
        (_stored(y=7), "initial state"),
        (_stored(index=16), "starts at step 16 of a cycle of 16"),
        (_stored(index=-1), "initial state"),
        (_stored(index=2**63), "initial state"),
        (_stored(cycle=1.5), "initial state"),
        (_stored(cycle=2**64), "initial state"),
        (_stored(t="0"), "initial state"),
        ([], "initial state"),
    ],
)
def test_a_state_that_no_gear_has_is_refused(tmp_path: Path, state: Any, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        verify(read_recording(write(tmp_path, state=state)))


@pytest.mark.parametrize("content", [{"parameters": []}, {"clock": {"t_s": []}}, {"clock": 3}])
def test_parameters_and_clocks_of_a_wrong_kind_are_told(
    tmp_path: Path, content: dict[str, Any]
) -> None:
    recording = read_recording(write(tmp_path, **content))
    assert any(f"{next(iter(content))} in the channels message" in n for n in recording.notes)
    with suppress(RecordingError):
        verify(recording)


def test_a_recording_without_its_state_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="initial state"):
        verify(read_recording(write(tmp_path, state=None)))
