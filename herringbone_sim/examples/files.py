"""Example recordings in common file formats, one run each, and the spec that imports them.

``python -m herringbone_sim.examples.files --out DIR`` simulates a rig and writes its runs as CSV,
Parquet, MAT (v5 and v7.3), TDMS, HDF5 and rosbag2, in um, mm/s and kN, and ``spec.yaml``.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.importing.units import package
from herringbone_sim.recording.parameter_file import save_parameters
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.rig import RigPlan, make_campaign

Columns = dict[str, Array]

# Unit of each quantity in the files, and the number of them in one SI unit.
UNITS = {"x": ("um", 1e6), "v": ("mm/s", 1e3), "F": ("kN", 1e-3), "u": ("um", 1e6)}
ALL = Layout(n_classes=Parameters.n_planets, numbered=True).channels  # channels of the full model
DEGREES = 180.0 / np.pi
# Torque meter: sampling rate [Hz], time by which it starts earlier [s], RMS noise [N m].
TORQUE_HZ, TRIGGER_S, NOISE_NM = 4e3, 5e-4, 0.5
HEADER_BYTES = 512  # MATLAB header before the HDF5 data of a v7.3 file


def by_quantity(series: TimeSeries) -> dict[str, Columns]:
    """Channels (n,) in units of the files, by quantity and place, as ``["F"]["sp1_L"]``."""
    quantities: dict[str, Columns] = {}
    for name in series.names:
        quantity, _, place = name.partition("_")
        if quantity in UNITS:
            quantities.setdefault(quantity, {})[place] = UNITS[quantity][1] * series[name]
    return quantities


def flat(series: TimeSeries, form: str) -> Columns:
    """Phase [deg] and channels as columns named by a template such as ``{q} {place}``."""
    columns = {"phase": DEGREES * series["phase"]}
    for q, places in by_quantity(series).items():
        columns |= {form.format(q=q, place=place): values for place, values in places.items()}
    return columns


def channels(series: TimeSeries, form: str, phase: str = "phase") -> dict[str, Any]:
    """Section ``channels`` of an import spec for columns named by the template ``form``.

    A ``*`` stands for all meshes or bodies of a quantity; ``phase`` is the column of the phase.
    """
    section: dict[str, Any] = {"phase": {"column": phase, "unit": "deg"}}
    for q, (unit, _) in UNITS.items():
        names = {name for name in series.names if name.startswith(f"{q}_")}
        is_complete = names == {name for name in ALL if name.startswith(f"{q}_")}
        for place in ["*"] if is_complete else sorted(name.partition("_")[2] for name in names):
            section[f"{q}_{place}"] = {"column": form.format(q=q, place=place), "unit": unit}
    return section


def write_csv(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write CSV with semicolons, decimal commas, a line of units, and torque in a second file.

    Returns the entries of both files for the import spec, as every writer below does.
    """
    columns = {"time": 1e3 * series.times, **flat(series, "{q} {place}")}
    _table(path, columns, ["ms", "deg", *(UNITS[n.split()[0]][0] for n in list(columns)[2:])])
    meter = path.with_name(f"{path.stem}_torque.csv")
    times = np.arange(-TRIGGER_S, series.times[-1] + 1.0 / TORQUE_HZ, 1.0 / TORQUE_HZ)
    noise = np.random.default_rng(0).normal(size=len(times))
    torque = np.interp(times, series.times, series["T_1"]) + NOISE_NM * noise
    _table(meter, {"torque": -torque}, ["N m"])
    options = {"delimiter": ";", "decimal": ",", "skip_after_names": 1}
    return [
        {
            "path": path.name,
            "options": options,
            "time": {"column": "time", "unit": "ms"},
            "channels": channels(series, "{q} {place}"),
        },
        {
            "path": meter.name,
            "options": options.copy(),
            "time": {"rate": "4 kHz", "trigger_offset": "-0.5 ms"},
            "resample": True,
            "channels": {"T_in": {"column": "torque", "unit": "N m", "sign": -1}},
        },
    ]


def _table(path: Path, columns: Columns, units: Sequence[str]) -> None:
    """Write a table with lines of names and units, semicolons and decimal commas."""
    lines = [";".join(columns), ";".join(units)]
    lines += [";".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()]
    path.write_text("\n".join(lines).replace(".", ",") + "\n", encoding="utf-8")


def write_parquet(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write Parquet with dates as time stamps; return its entry for the import spec."""
    arrow = package("pyarrow", "pyarrow", "Parquet files")
    parquet = package("pyarrow.parquet", "pyarrow", "Parquet files")
    first = np.datetime64("2026-03-02T09:30:00", "ns")
    stamps = first + np.round(1e9 * series.times).astype("timedelta64[ns]")
    parquet.write_table(arrow.table({"stamp": stamps, **flat(series, "{q}.{place}")}), path)
    clock = {"column": "stamp"}
    return [{"path": path.name, "time": clock, "channels": channels(series, "{q}.{place}")}]


def write_mat(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write a MATLAB file (v5), a structure per quantity; return its entry for the import spec."""
    content = {"phase": DEGREES * series["phase"], **by_quantity(series)}
    package("scipy.io", "scipy", "MAT files").savemat(path, content, oned_as="column")
    clock = {"rate": f"{(len(series) - 1) / float(np.ptp(series.times))!r} Hz"}
    return [{"path": path.name, "time": clock, "channels": channels(series, "{q}.{place}")}]


def write_mat_7(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write a MATLAB v7.3 file, HDF5 with transposed arrays; return its entry for the spec."""
    h5py = package("h5py", "h5py", "HDF5 and MAT v7.3 files")
    with h5py.File(path, "w", userblock_size=HEADER_BYTES) as file:
        file["t"], file["phase"] = series.times[None], DEGREES * series["phase"][None]
        for q, places in by_quantity(series).items():
            for place, values in places.items():
                file[f"{q}/{place}"] = values[None]
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, HDF5 schema 1.00 .".ljust(HEADER_BYTES))
    clock = {"column": "t", "unit": "s"}
    return [{"path": path.name, "time": clock, "channels": channels(series, "{q}.{place}")}]


def write_tdms(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write TDMS waveforms with start and time step; return their entry for the import spec."""
    tdms = package("nptdms", "npTDMS", "TDMS files")
    clock = {"wf_start_offset": 0.0, "wf_increment": float(series.times[-1]) / (len(series) - 1)}
    waves = [
        tdms.ChannelObject(*("rig", name), values, properties=clock)
        for name, values in flat(series, "{q} {place}").items()
    ]
    with tdms.TdmsWriter(path) as writer:
        writer.write_segment(waves)
    return [{"path": path.name, "channels": channels(series, "rig/{q} {place}", "rig/phase")}]


def write_hdf5(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write HDF5 with a group per quantity; return its entry for the import spec."""
    with package("h5py", "h5py", "HDF5 files").File(path, "w") as file:
        file["t"] = 1e6 * series.times
        for name, values in flat(series, "{q}/{place}").items():
            file[name] = values
    clock = {"column": "t", "unit": "us"}
    return [{"path": path.name, "time": clock, "channels": channels(series, "{q}/{place}")}]


def write_bag(path: Path, series: TimeSeries) -> list[dict[str, Any]]:
    """Write a rosbag2, an array message per sample; return its entry for the import spec."""
    bags = package("rosbags.rosbag2", "rosbags", "rosbag2 files")
    types = package("rosbags.typesys", "rosbags", "rosbag2 files")
    store = types.get_typestore(types.Stores.ROS2_JAZZY)
    block, layout, of_axis = (
        store.types[f"std_msgs/msg/{name}"]
        for name in ("Float64MultiArray", "MultiArrayLayout", "MultiArrayDimension")
    )
    columns = {"t": series.times, **flat(series, "{q}_{place}")}
    rows = np.column_stack([*columns.values()])
    axes = [of_axis("sample", 1, rows.shape[1]), of_axis(",".join(columns), rows.shape[1], 1)]
    with bags.Writer(path, version=9) as writer:
        topic = writer.add_connection("/daq/values", block.__msgtype__, typestore=store)
        for t_s, row in zip(series.times, rows, strict=True):
            message = store.serialize_cdr(block(layout(axes, 0), row), block.__msgtype__)
            writer.write(topic, round(1e9 * t_s), message)
    clock = {"column": "/daq/values.t", "unit": "s"}
    form = "/daq/values.{q}_{place}"
    section = channels(series, form, "/daq/values.phase")
    return [{"path": path.name, "time": clock, "channels": section}]


# Writer of each file; returns the entries in the list ``files`` of its run in the import spec.
WRITERS: Mapping[str, Callable[[Path, TimeSeries], list[dict[str, Any]]]] = {
    "bench.csv": write_csv,
    "bench.parquet": write_parquet,
    "bench_v5.mat": write_mat,
    "bench_v73.mat": write_mat_7,
    "bench.tdms": write_tdms,
    "bench.h5": write_hdf5,
    "bench_bag": write_bag,
}


def write_example(
    out: Path,
    cycles: int = 60,
    seed: int = 3,
    actives: tuple[Active, ...] = (),
    recorded: tuple[str, ...] = (),
) -> Path:
    """Simulate a rig and write one run per file format, the data sheet and the import spec.

    The simulated campaign itself is written to ``out/simulated``.

    Args:
        out: new folder.
        cycles: mesh cycles per run.
        seed: seed of the random numbers of the rig.
        actives: effects of the rig.
        recorded: names of the channels to record, such as ``u_s_L``; empty: all.

    Returns:
        Path of the spec.

    Raises:
        RecordingError: ``out`` is there already, or a channel that a rig does not have.
    """
    if out.exists():
        raise RecordingError(f"--out must be a new folder, got {out}: name another")
    nominal = Parameters(model="full", samples_per_cycle=24)
    plan = RigPlan(nominal, runs=len(WRITERS), held_out=2, cycles=cycles, bits=0, seed=seed)
    plan = replace(plan, actives=actives, channels=recorded)
    make_campaign(out / "simulated", plan, "bench")
    save_parameters(out / "rig.yaml", nominal, "The gear as its data sheet has it.")
    runs = []
    for run, (name, write) in zip(
        read_campaign(out / "simulated").runs, WRITERS.items(), strict=True
    ):
        files = write(out / name, read_recording(run.path).samples)
        runs.append({"name": run.path.name, "role": run.role, **run.point, "files": files})
    content = {
        "rig": "bench",
        "nominal": "rig.yaml",
        "noise": {"kind": "white", "rms_share": plan.noise_share},
        "runs": runs,
    }
    spec = out / "spec.yaml"
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=99)
    spec.write_text(text, encoding="utf-8")
    return spec


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m herringbone_sim.examples.files",
        description="Simulate a rig and write files of each kind that an import takes.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to make")
    parser.add_argument("--seed", type=int, default=3, help="of the rig (default: 3)")
    parser.add_argument(
        "--cycles", type=int, default=60, metavar="N", help="of a run (default: 60)"
    )
    parser.add_argument("--effects", default="", metavar="TEXT", help="that the rig has")
    parser.add_argument("--channels", default="", metavar="LIST", help="recorded (default: all)")
    given = parser.parse_args(arguments)
    warnings.simplefilter("ignore", ParameterWarning)
    recorded = tuple(name for name in given.channels.split(",") if name)
    actives = read_effects(given.effects)
    spec = write_example(given.out, given.cycles, given.seed, actives, recorded)
    print(f"written: {spec}")


if __name__ == "__main__":
    main()
