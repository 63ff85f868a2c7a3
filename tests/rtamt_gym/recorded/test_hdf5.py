"""HDF5 in the layout of robomimic: a trace per demonstration, with the control rate as period."""

import json
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import traces_in
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_ruled

Output = pytest.CaptureFixture[str]
Demo = Mapping[str, NDArray[Any]]


def write_demos(
    path: Path,
    demos: Mapping[str, Demo],
    rate: object = 20,
    masks: Mapping[str, list[str]] | None = None,
) -> Path:
    """Write demonstrations; a rate of None leaves out the environment."""
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        if rate is not None:
            data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": rate}})
        for name, arrays in demos.items():
            group = data.create_group(name)
            for place, array in arrays.items():
                group[place] = array
        for name, members in (masks or {}).items():
            file[f"mask/{name}"] = np.array(members, "S")
    return path


def demo(seed: int, count: int = 40) -> Demo:
    generator = np.random.default_rng(seed)
    return {
        "actions": generator.normal(size=(count, 7)),
        "rewards": generator.normal(size=count),
        "obs/eef_pos": generator.normal(size=(count, 3)).astype(np.float32),
        "obs/image": np.zeros((count, 4, 4, 3), np.uint8),
    }


def read(
    path: Path | str, text: str = "always(rewards < 9)", columns: Columns | None = None
) -> Trace:
    spec = rtamt.parse(text)
    trace, period = read_ruled(str(path), {"": spec}, EvaluationOptions(), columns or Columns())
    assert isinstance(trace, Trace)
    assert period == trace.period()
    return trace


def test_verdicts_match_numpy(tmp_path: Path, capsys: Output) -> None:
    demos = {f"demo_{k}": demo(k, 30 + k) for k in range(12)}
    path = write_demos(tmp_path / "low_dim.hdf5", demos)
    main(["monitor", "r = always[0:1](obs.eef_pos[1] < 1.5)", "--json", "--", str(path)])
    trials = json.loads(capsys.readouterr().out)["trials"]
    assert [(t["name"], t["outcomes"]["r"]["robustness"]) for t in trials] == [
        (f"{path}[demo={name}]", 1.5 - float(arrays["obs/eef_pos"][:21, 1].max()))
        for name, arrays in demos.items()
    ]


@pytest.mark.parametrize("rate", [20, 30, 12.5])
def test_period_is_the_control_rate(rate: float, tmp_path: Path) -> None:
    path = write_demos(tmp_path / "d.h5", {"demo_0": demo(0)}, rate)
    assert read(f"{path}[demo=demo_0]").period() == 1 / Fraction(str(rate))


def test_rate_of_robosuite(tmp_path: Path) -> None:
    path = write_demos(tmp_path / "d.hdf5", {"demo_1": demo(0)}, None)
    with h5py.File(path, "a") as file:
        file["data"].attrs["env_info"] = json.dumps({"env_name": "Lift", "control_freq": 20})
    assert read(f"{path}[demo=demo_1]").period() == Fraction(1, 20)


def test_no_rate_counts_samples(tmp_path: Path) -> None:
    path = write_demos(tmp_path / "d.h5", {"demo_0": demo(0)}, None)
    assert read(f"{path}[demo=demo_0]").period() is None


def test_two_time_axes_error(tmp_path: Path) -> None:
    timed = {**demo(0), "time": np.arange(40) / 10}
    name = f"{write_demos(tmp_path / 'd.h5', {'demo_0': timed})}[demo=demo_0]"
    with pytest.raises(
        rtamt.InputError, match=r"'time' with rows 0\.1 apart and control_freq .*0\.05"
    ):
        read(name)
    assert read(name, columns=Columns(time="time")).period() == Fraction(1, 10)
    same = write_demos(tmp_path / "s.h5", {"demo_0": {**demo(0), "time": np.arange(40) / 20}})
    assert read(f"{same}[demo=demo_0]").period() == Fraction(1, 20)


def test_filters_select_demonstrations(tmp_path: Path) -> None:
    demos, masks = {f"demo_{k}": demo(k) for k in range(3)}, {"train": ["demo_0", "demo_2"]}
    path = str(write_demos(tmp_path / "d.hdf5", demos, masks=masks))
    names = traces_in(path, {"mask": "train"})
    assert names == [f"{path}[demo=demo_0]", f"{path}[demo=demo_2]"]
    assert read(names[0], columns=Columns(where={"mask": "train"})).samples == 40
    assert traces_in(path, {"demo": "demo_1"}) == [f"{path}[demo=demo_1]"]
    with pytest.raises(rtamt.InputError, match=r"no trace with mask=test.* are train"):
        traces_in(path, {"mask": "test"})


def test_arrays_of_other_lengths_error(tmp_path: Path) -> None:
    arrays = {**demo(0), "rewards": np.zeros(39)}
    path = write_demos(tmp_path / "d.hdf5", {"demo_0": arrays})
    with pytest.raises(rtamt.InputError, match="columns of one length, got"):
        read(f"{path}[demo=demo_0]", "always(rewards < actions[0])")


@pytest.mark.parametrize("rate", [0, -5, "20", True])
def test_bad_rate_error(rate: object, tmp_path: Path) -> None:
    path = write_demos(tmp_path / "d.hdf5", {"demo_0": demo(0)}, rate)
    with pytest.raises(rtamt.InputError, match=r"expected a rate above 0 Hz as control_freq"):
        read(f"{path}[demo=demo_0]")


def test_other_layout_error(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["traj_0/actions"] = np.zeros(3)
    assert main(["monitor", "always(rewards < 1)", str(path)]) == 2
    assert "expected the layout of robomimic" in capsys.readouterr().err


def test_damaged_file_error(tmp_path: Path, capsys: Output) -> None:
    path = write_demos(tmp_path / "d.hdf5", {"demo_0": demo(0), "demo_1": demo(1)})
    whole = path.read_bytes()
    for part in range(20):
        path.write_bytes(whole[: len(whole) * part // 20])
        assert main(["monitor", "always(rewards < 1)", "--", str(path)]) == 2
        assert f"{path}: expected a whole HDF5 file" in capsys.readouterr().err


def test_other_files_are_not_read(tmp_path: Path, capsys: Output) -> None:
    other = write_demos(tmp_path / "other.hdf5", {"demo_0": demo(0)})
    path = write_demos(tmp_path / "d.hdf5", {"demo_1": {"actions": np.zeros((3, 2))}})
    (tmp_path / "raw").write_bytes(b"\0" * 24)
    with h5py.File(path, "a") as file:
        file["data/demo_0"] = h5py.ExternalLink(other, "data/demo_0")
        group, external = file["data/demo_1"], [(str(tmp_path / "raw"), 0, 24)]
        group.create_dataset("rewards", (3,), "f8", external=external)
    assert traces_in(str(path), {}) == [f"{path}[demo=demo_1]"]
    assert main(["monitor", "always(rewards < 1)", str(path)]) == 2
    assert "no column 'rewards'" in capsys.readouterr().err
