"""What ``ros2 param dump`` writes starts the node, and can be loaded into a running one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import parameter_dict_from_yaml_file
from support import Bench

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.parameter_file import ros_text

CHANGED = {
    "delta_T": 61.5,
    "K": 0.125,
    "xi": 0.08,
    "T_1": 320.0,
    "Omega": 1.05,
    "control_phase": 0.5,
    "real_time_factor": 0.01,
    "publish_rate": 25.0,
    "samples_per_cycle": 24,
    "step_cycles": 3,
    "record_dir": "some where/runs_1",
    "record_name": "one",
    "effects": "sensor_gain@rp:gain=1.1; tooth_crack@sp/1/L:depth=0.3,member=sun",
}
STRUCTURE = {"model": "full", "z_s": 26, "e_amp": [4e-6, 1e-6], "mirror": "off", "seed": 4}


@contextmanager
def started_from(domain: int, file: Path, **values: Any) -> Iterator[Bench]:
    """A bench whose simulator takes a parameter file from its command line."""
    bench = Bench(domain)
    try:
        arguments = ["--ros-args", "--params-file", str(file)]
        bench.simulator(cli_args=arguments, start_paused=True, **values)
        yield bench
    finally:
        bench.close()


@pytest.mark.parametrize("structure", [{}, STRUCTURE], ids=["defaults", "changed"])
def test_dump_load_and_file_are_a_round_trip(
    bench: Bench, tmp_path: Path, structure: dict[str, Any]
) -> None:
    bench.simulator(start_paused=True, **structure)
    if structure:
        for name, value in CHANGED.items():
            (answer,) = bench.set(**{name: value})
            assert answer.successful, answer.reason
    dumped = bench.dump()
    file = tmp_path / "dump.yaml"
    file.write_text(yaml.dump(dumped, default_flow_style=False), encoding="utf-8")
    names = dumped["/herringbone_sim"]["ros__parameters"]
    assert names.keys() >= {*Parameters.__dataclass_fields__, *CHANGED, "use_sim_time"}
    loaded = parameter_dict_from_yaml_file(str(file)).values()  # as ros2 param load reads it
    results = bench.set_messages(*loaded)
    refused = {m.name: r.reason for m, r in zip(loaded, results, strict=True) if not r.successful}
    assert refused == {}
    assert bench.dump() == dumped
    with started_from(bench.domain + 1, file) as other:
        assert other.dump() == dumped


def test_an_empty_value_is_the_default_and_said_where_that_is_not_empty(
    domain: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "empty.yaml"
    lines = ("planet_angle: []", "e_amp: []", "K: []")
    file.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines))
    with started_from(domain, file) as bench:
        node = bench.simulators[0]
        assert list(node.get_parameter("planet_angle").value) == []
        assert tuple(node.get_parameter("e_amp").value) == Parameters().e_amp
        assert node.get_parameter("K").value == 0.0
        assert bench.describe("planet_angle")[0].type == ParameterType.PARAMETER_DOUBLE_ARRAY
    warned = capfd.readouterr().err
    assert "e_amp is empty and has its default" in warned
    assert "K is empty" in warned
    assert "planet_angle" not in warned


def test_a_text_that_looks_like_a_number_is_one_to_the_node(bench: Bench, tmp_path: Path) -> None:
    mine, file = tmp_path / "mine.yaml", tmp_path / "ros.yaml"
    mine.write_text("/**:\n  ros__parameters: {record_name: '1e5', record_dir: 'on', K: 1e-1}\n")
    file.write_text(ros_text(mine), encoding="utf-8")
    with started_from(bench.domain, file) as again:
        held = again.dump()["/herringbone_sim"]["ros__parameters"]
    assert [held[name] for name in ("record_name", "record_dir", "K")] == ["1e5", "on", 0.1]
