"""The contents of an installation, built without a compiler."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT

import rtamt
from rtamt_gym.checks.extras import ALONE, EXTRAS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the distribution installed without a working compiler."""
    target = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    built = subprocess.run(
        [*pip, "--no-build-isolation", "--target", str(target), str(ROOT)],
        env={**os.environ, "CC": "false", "CXX": "false"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    return target


@pytest.fixture(scope="module")
def distribution(site: Path) -> importlib.metadata.Distribution:
    return next(iter(importlib.metadata.distributions(name="rtamt-stl", path=[str(site)])))


def run_without_editable_install(site: Path, code: str) -> str:
    # -S ignores the .pth files, through which an editable install would come first.
    path = [str(site), *(entry for entry in sys.path if entry.endswith("site-packages"))]
    ran = subprocess.run(
        [sys.executable, "-S", "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)},
        cwd=site,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_without_a_compiler_every_public_name_is_there_and_the_backend_is_python(
    site: Path,
) -> None:
    code = """
import json, rtamt
for name in rtamt.__all__:
    getattr(rtamt, name)
print(json.dumps([rtamt.BACKEND, rtamt.__file__, rtamt.__all__]))
"""
    backend, file, names = json.loads(run_without_editable_install(site, code))
    assert backend == "python"
    assert Path(file).is_relative_to(site)
    assert names == list(rtamt.__all__)


def test_without_a_compiler_the_machines_run(site: Path) -> None:
    code = """
import json, rtamt
monitor = rtamt.Monitor("historically[0:1](x > 0)")
episode = rtamt.EpisodeMonitor("always(x > 0)")
trace = {"x": [3.0, 1.0, 2.0]}
print(json.dumps([
    [monitor.update(x=x) for x in trace["x"]],
    [episode.update(x=x) for x in trace["x"]],
    rtamt.evaluate("always(x > 0)", trace).tolist(),
]))
"""
    answers = json.loads(run_without_editable_install(site, code))
    assert answers == [[3.0, 1.0, 1.0], [3.0, 1.0, 1.0], [1.0, 1.0, 2.0]]


@pytest.mark.parametrize(
    "package", ["rtamt", "rtamt_gym", "rtamt_arrays", "rtamt_ros", "envs/rtamt_envs"]
)
def test_every_file_of_a_package_is_installed_but_the_native_sources(
    site: Path, package: str
) -> None:
    def files(folder: Path) -> set[Path]:
        found = {file.relative_to(folder) for file in folder.rglob("*") if file.is_file()}
        return {file for file in found if not any(map(left_out, file.parts))}

    def left_out(part: str) -> bool:
        return part in {"native", "__pycache__"} or part.startswith(".")

    installed = files(site / Path(package).name)
    assert installed == files(ROOT / package)
    assert Path("py.typed") in installed


def test_a_plain_install_needs_numpy_and_the_antlr_runtime_only(
    distribution: importlib.metadata.Distribution,
) -> None:
    needs = {need for need in distribution.requires or () if "extra ==" not in need}
    assert needs == {"antlr4-python3-runtime>=4.13", "numpy>=1.26"}


def test_upper_bounds_are_those_with_a_reason(
    distribution: importlib.metadata.Distribution,
) -> None:
    bounded = [need for need in distribution.requires or () if "<" in need or "~=" in need]
    assert bounded == ['jax<0.10; extra == "brax"']  # pyproject.toml has the reason


def test_the_extras_are_the_promised_ones(distribution: importlib.metadata.Distribution) -> None:
    extras = distribution.metadata.get_all("Provides-Extra")
    assert extras is not None
    promised = {
        "check",
        "gym",
        "cases",
        "search",
        "optuna",
        "report",
        "minari",
        "video",
        "highway",
        "plot",
        "files",
        "hdf",
        "mdf",
        "ulog",
        "watch",
        "pandas",
        "bags",
        "fmi",
    }
    assert installed_by(distribution, "all") == {"all", *promised}
    promised |= {
        "all",
        "dask",
        "ray",
        "urls",
        "jax",
        "brax",
        "gymnax",
        "torch",
        "taliro",
        "rerun",
        "site",
        "pytest",
        "test",
        "dev",
    }
    assert set(extras) == promised


def test_an_error_names_extras_that_install_the_package(
    distribution: importlib.metadata.Distribution,
) -> None:
    providers = importlib.metadata.packages_distributions()
    for package, extras in EXTRAS.items():
        if package in ALONE:
            continue
        names = {*map(str.lower, _APART.get(package) or providers[package])}
        for extra in extras:
            assert names & needed_by(distribution, extra), (package, extra)


_APART = {
    **{name: [name] for name in ("distributed", "fsspec", "ray")},
    "rerun": ["rerun-sdk"],
}
"""The distributions of packages outside `all`: the tests run without them."""


def needed_by(distribution: importlib.metadata.Distribution, extra: str) -> set[str]:
    """Return the distributions that an extra names, directly or through other extras."""
    names = {f'extra == "{each}"' for each in installed_by(distribution, extra)}
    needs = [need.replace("'", '"') for need in distribution.requires or ()]
    wanted = {need for need in needs if any(need.endswith(name) for name in names)}
    return {re.split(r"[^A-Za-z0-9_-]", need)[0].lower() for need in wanted} | (
        {"mujoco"} if any(need.startswith("gymnasium[mujoco]") for need in wanted) else set()
    )


def installed_by(distribution: importlib.metadata.Distribution, extra: str) -> set[str]:
    """Return an extra, and the extras that it names."""
    found = {extra}
    for need in distribution.requires or ():
        text = need.replace("'", '"')
        if text.startswith("rtamt-stl[") and text.endswith(f'extra == "{extra}"'):
            for other in text[len("rtamt-stl[") : text.index("]")].split(","):
                found |= installed_by(distribution, other)
    return found


RELEASED = "import rtamt.spec\nSTLDiscreteTimeSpecification = object\n"
"""The start of the released library's first file; its imports are next to it."""


@pytest.fixture
def mixed(site: Path, tmp_path: Path) -> Path:
    """Return a folder in which the released library was installed too, under this one."""
    folder = tmp_path / "mixed"
    shutil.copytree(site, folder)
    for each in ("spec", "antlr"):
        (folder / "rtamt" / each).mkdir()
        (folder / "rtamt" / each / "__init__.py").touch()
    return folder


def test_an_install_over_the_released_library_says_so_and_how_to_mend_it(mixed: Path) -> None:
    code = "try:\n    import rtamt\nexcept ImportError as e:\n    print(e)"
    said = run_without_editable_install(mixed, code)
    assert said.startswith(
        "expected only the packages of rtamt-stl, got files of the released rtamt"
    )
    assert "pip uninstall rtamt rtamt-stl" in said


@pytest.mark.parametrize("package", ["rtamt_gym", "rtamt_ros", "rtamt_gym.__main__"])
def test_an_install_under_the_released_library_says_so_and_how_to_mend_it(
    mixed: Path, package: str
) -> None:
    (mixed / "rtamt" / "__init__.py").write_text(RELEASED, encoding="utf-8")
    code = f"try:\n    import {package}\nexcept ImportError as e:\n    print(e)"
    said = run_without_editable_install(mixed, code)
    assert said.startswith("expected the packages of rtamt-stl, got the released rtamt")
    assert "pip uninstall rtamt rtamt-stl" in said


def test_the_version_is_one_number(distribution: importlib.metadata.Distribution) -> None:
    assert distribution.version == rtamt.__version__


def test_the_commands_are_main_functions(distribution: importlib.metadata.Distribution) -> None:
    scripts = distribution.entry_points.select(group="console_scripts")
    assert {script.name: script.value for script in scripts} == {
        "rtamt": "rtamt_gym.__main__:main",
        "ros_stl_monitor.py": "rtamt_ros.__main__:main",
    }
    assert all(callable(script.load()) for script in scripts)


def test_nothing_that_an_extra_installs_asks_for_the_released_library(
    distribution: importlib.metadata.Distribution,
) -> None:
    """Its package has our name, and would overwrite ours."""
    assert "psy-taliro" not in {
        each
        for extra in ("all", "test", "dev", "taliro")
        for each in needed_by(distribution, extra)
    }
    asking = {
        each.name
        for each in importlib.metadata.distributions()
        for need in each.requires or ()
        if re.split(r"[^A-Za-z0-9_-]", need)[0].lower() == "rtamt"
    }
    assert asking <= {*ALONE.values()}
