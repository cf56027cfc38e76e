"""What the ``channels`` message of a hostile recording may say."""

from __future__ import annotations

import json
from typing import Any

from benchmarks.faults.runs import motion

_DIGITS = "9" * 5000


def _with(**values: Any) -> str:
    return json.dumps(motion()[2][0] | values)


def _state(**values: Any) -> str:
    return _with(state=motion()[2][0]["state"] | values)


def hostile_channels() -> list[str]:
    """JSON that is too deep, too large, or says something of the wrong type."""
    y = motion()[2][0]["state"]["y"]
    wrong: list[Any] = [3, "text", [], [[]], {}, True, [None], {"y": 1}, -1, 2**70, 1e308]
    return [
        *("[" * 100_000, '{"a":' * 100_000, "{", "", "[1]", "null", '{"a":NaN}', '{"a":1e999}'),
        *(f'{{"a":{_DIGITS}}}', f'{{"state":{{"y":[{_DIGITS}]}}}}'),
        *('{"source":"\\ud800"}', '{"source":"\\u001b[2J"}', json.dumps({"model": "m" * 100_000})),
        "[" * 40 + "]" * 40,
        '{"a":' + "[" * 40 + "]" * 40 + "}",
        *(_state(y=one) for one in (y[:-1], [*y, 0.0], [y], ["a"] * len(y), [1e308] * len(y))),
        *(_state(y=one) for one in wrong),
        *(_state(index=one) for one in (-1, 10**9, 1.5, "0", None, 2**63)),
        *(_state(cycle=one) for one in (-1, 2**53 + 1, 2**64, "0", None)),
        *(_state(t=one) for one in ("0", None, 1e308, -1e308, [])),
        *(_with(**{name: one}) for name in ("state", "parameters", "channels") for one in wrong),
        *(_with(**{name: one}) for name in ("source", "clock", "version") for one in wrong),
        _with(channels=[{"name": "t", "unit": 3}, {"name": ["t"]}, 7]),
        _with(channels=[{"name": f"c{number}", "unit": "m"} for number in range(20_000)]),
        *(_with(parameters={name: one}) for name in ("K", "k_amp", "effects") for one in wrong),
        _with(parameters={"no such": {"a": [1]}}),
        _with(clock={"t_s": "a", "shown_s": 1.0}),
        _with(clock={"other": 1.0}),
    ]
