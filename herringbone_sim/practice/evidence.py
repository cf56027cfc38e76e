"""Evidence as plain data, and back: thresholds can then be set without diagnosing again.

Dataclasses of this package become objects with their name, arrays lists, effects their ids. The
long changes of the forces (``Fit.gain``) are turned into their own space: lengths and angles among
them stay, a few numbers each. Recordings are left out: ``cases`` comes back empty.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Effect
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError, shown
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.verdict.evidence import Evidence

PACKAGE = "herringbone_sim.gap."
OTHERS = ("herringbone_sim.effects.effect",)
SHORTLIST = 40  # candidates of the linear shortlist that are kept


def evidence_record(evidence: Evidence) -> dict[str, Any]:
    """Evidence as plain data that JSON can hold (NaN as such), some ten kilobytes."""
    fits = (*evidence.fits, *evidence.pairs)
    turned = iter(_turned([one.gain for one in fits]))
    small = replace(
        evidence,
        cases=(),
        candidates=evidence.candidates[:SHORTLIST],
        nominal=_without_gain(evidence.nominal),
        fits=tuple(replace(one, gain=next(turned)) for one in evidence.fits),
        pairs=tuple(replace(one, gain=next(turned)) for one in evidence.pairs),
    )
    record: dict[str, Any] = _plain(small)
    return record


def evidence_of(record: dict[str, Any]) -> Evidence:
    """The evidence of a record, but for its recordings.

    Raises:
        AnalysisError: a record of something else, or of another version of the diagnosis.
    """
    try:
        found = _back(record)
    except (KeyError, TypeError, AttributeError, ImportError) as error:
        raise AnalysisError(
            f"evidence must be a record of this version of the diagnosis, got one that breaks at "
            f"{shown(error)}: diagnose again"
        ) from None
    if not isinstance(found, Evidence):
        raise AnalysisError(f"a record of evidence is needed, got one of {type(found).__name__}")
    return found


def _without_gain(one: Fit | None) -> Fit | None:
    return None if one is None else replace(one, gain=np.zeros(0))


def _turned(gains: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Vectors (k,) with the inner products of k long ones."""
    if not gains:
        return []
    R = np.asarray(np.linalg.qr(np.stack(gains, axis=1), mode="r"))
    return list(R.T)


def _plain(value: Any) -> Any:
    if isinstance(value, Effect):
        return {"effect": value.id}
    if is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        held = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {"is": f"{kind.__module__}:{kind.__name__}", "has": held}
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "dtype": str(value.dtype)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, dict):
        return {"items": [[_plain(key), _plain(one)] for key, one in value.items()]}
    if isinstance(value, (tuple, list)):
        return [_plain(one) for one in value]
    return value


def _back(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_back(one) for one in value)
    if not isinstance(value, dict):
        return value
    if "effect" in value:
        return known_effects()[value["effect"]]
    if "array" in value:
        return np.array(value["array"], dtype=value["dtype"])
    if "items" in value:
        return {_back(key): _back(one) for key, one in value["items"]}
    module, name = value["is"].split(":")
    if not module.startswith(PACKAGE) and module not in OTHERS:
        raise KeyError(module)
    kind = getattr(importlib.import_module(module), name)
    return kind(**{key: _back(one) for key, one in value["has"].items()})
