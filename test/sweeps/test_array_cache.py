"""What was made once is read again: by its parts, whole or not at all."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest

from herringbone_sim.control.runs import RunSettings
from herringbone_sim.core import cache
from herringbone_sim.effects import registry
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps import array_cache
from herringbone_sim.sweeps.array_cache import ArrayCache, digest
from herringbone_sim.sweeps.output import make_folder, whole_file


class Work:
    """Arrays, and how often they were made."""

    def __init__(self):
        self.times = 0

    def __call__(self):
        self.times += 1
        return {"x": np.arange(3.0), "reasons": ("", "diverged")}


OWN = """
from herringbone_sim.effects.effect import Effect, Parameter
size = Parameter("size", "-", "of nothing", 0.0, 9.0, SIZE, neutral=0.0)
EFFECT = Effect(id="own", text="nothing", level="mesh", parameters=(size,))
"""


def test_what_was_made_is_read(tmp_path):
    work = Work()
    made = ArrayCache(tmp_path / "new" / "data").get(["a", 1], work)
    read = ArrayCache(tmp_path / "new" / "data").get(["a", 1], work)
    assert work.times == 1
    for name in ("x", "reasons"):
        np.testing.assert_array_equal(made[name], read[name])
    ArrayCache(tmp_path / "new" / "data").get(["a", 2], work)
    assert work.times == 2


def test_without_a_folder_all_is_made():
    work = Work()
    for _ in range(2):
        assert ArrayCache().get(["a"], work)["reasons"].tolist() == ["", "diverged"]
    assert work.times == 2


@pytest.mark.parametrize("length", [0, 50, -20])
def test_a_broken_file_is_made_again(tmp_path, length):
    work = Work()
    ArrayCache(tmp_path).get(["a"], work)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:length])
    assert ArrayCache(tmp_path).get(["a"], work)["x"].tolist() == [0.0, 1.0, 2.0]
    assert work.times == 2


def test_an_altered_file_is_named_and_made_again(tmp_path, capsys):
    work = Work()
    ArrayCache(tmp_path).get(["a"], work)
    (path,) = tmp_path.iterdir()
    good = path.read_bytes()
    for at in range(0, len(good), 7):
        path.write_bytes(good[:at] + bytes([good[at] ^ 1]) + good[at + 1 :])
        assert ArrayCache(tmp_path).get(["a"], work)["x"].tolist() == [0.0, 1.0, 2.0]
        told = capsys.readouterr().err
        assert str(path) in told
        assert "computed again" in told
    assert work.times == 1 + len(range(0, len(good), 7))


def test_other_arrays_in_the_place_of_the_kept_ones_are_not_believed(tmp_path):
    work = Work()
    ArrayCache(tmp_path).get(["a"], work)
    (path,) = tmp_path.iterdir()
    np.savez(path, x=np.array([5.0, 6.0, 7.0]), reasons=("", ""))
    assert ArrayCache(tmp_path).get(["a"], work)["x"].tolist() == [0.0, 1.0, 2.0]


def test_digest_tells_all_parts_apart(gear):
    paper = gear().parameters
    y = np.arange(4.0)
    parts = [
        ["a", y],
        ["a", y + 1e-15],
        ["a", y[::-1]],
        ["a", y.reshape(2, 2)],
        ["a", y.astype(np.float32)],
        ["a", None],
        [paper],
        [paper.changed({"delta_T": 50.001})],
        [[paper], RunSettings()],
        [[paper], RunSettings(exponents=True)],
    ]
    assert len({digest(one) for one in parts}) == len(parts)
    assert digest(["a", y[::-1]]) == digest(["a", y[::-1].copy()])


def test_another_kernel_has_other_names(monkeypatch):
    before = digest(["a"])
    monkeypatch.setattr(array_cache, "_sources", lambda: ("another",))
    assert digest(["a"]) != before


def test_what_decides_what_is_stored_is_among_the_sources():
    """``effect_cycles`` how long a run is, ``control.runs`` what is kept of it."""
    package = Path(array_cache.__file__).parents[1]
    array_cache._sources.cache_clear()
    for room in ("core", "analysis", "effects", "sweeps", "dynamics", "control", "paper"):
        assert cache.digest(package / room) in array_cache._sources()


def test_sources_count_by_name_and_content_alone(tmp_path):
    for folder in ("one", "two", "three"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "kernel.py").write_text("x = 1\n")
    (tmp_path / "two" / "kernel.py").write_text("x = 2\n")
    one, two, three = (cache.digest(tmp_path / name) for name in ("one", "two", "three"))
    assert one == three != two


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "part"
    with whole_file(path) as file:
        file.write(b"old")
    with pytest.raises(TypeError), whole_file(path) as file:
        file.writelines([b"new", None])
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_two_threads_may_make_the_same(tmp_path):
    together = Barrier(2)

    def make(_):
        def work():
            together.wait(10.0)
            return {"x": np.ones(1000)}

        return ArrayCache(tmp_path).get(["a"], work)["x"].sum()

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(make, range(2))) == [1000.0, 1000.0]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(AnalysisError, match="must be one that can be written"):
        make_folder(tmp_path / "file" / "data")


def test_a_folder_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(AnalysisError, match="Permission denied"):
        make_folder(tmp_path)


def test_files_of_own_effects_are_part_of_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As they were loaded: an edit counts in the process that loads it."""
    own, digests = tmp_path / "own.py", []
    monkeypatch.setenv(registry.VARIABLE, str(own))
    for size in ("1.0", "2.0"):
        own.write_text(OWN.replace("SIZE", size))
        digests.append(digest([]))
    registry._all_effects.cache_clear()
    assert digests[0] == digests[1] != digest([])
    registry._all_effects.cache_clear()
