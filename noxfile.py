"""Environments for what that of the core cannot hold: bridges to other libraries, the oldest and the newest
versions that are allowed, and one that builds.

scripts/bridges, scripts/docs and scripts/build run these sessions. The environments are kept in
$IBDATA_BRIDGES, by default ~/.cache/ibdata/bridges.
"""

import os
import re
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import nox

nox.options.envdir = os.environ.get("IBDATA_BRIDGES") or str(Path.home() / ".cache" / "ibdata" / "bridges")
nox.options.reuse_venv = "yes"
NEW = "3.12"  # the newest NumPy wants at least this Python
CLEAN = {"PYTHONPATH": None, "OMP_NUM_THREADS": "1"}  # torch would use all processors in each Ray process


def bridge(session: nox.Session, path: Path, newest: bool) -> None:
    """Install the requirements of a bridge, the project among them, and run its tests.

    What stands behind --no-deps is installed after all else, without its own requirements.
    """
    wanted = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    pins = ["--constraint", "constraints.txt"]
    if newest:
        wanted, pins = [re.sub("==.*", "", line) for line in wanted], ["--upgrade"]
    # --no-compile, because compiling all of torch and Ray takes longer than the tests save
    alone = [line for line in wanted if line.startswith("--no-deps ")]
    others = [line for line in wanted if line not in alone]
    session.install("--no-compile", *pins, *others, "pytest", "pytest-xdist")
    for line in alone:
        session.install("--no-compile", *line.split())
    tests = f"tests/bridges/{path.stem.partition('-')[0]}"
    session.run("pytest", tests, *(session.posargs or ["-q", "-n0", "-m", ""]), env=CLEAN)


for file in sorted(Path("scripts/bridges.d").glob("*.txt")):
    nox.session(partial(bridge, path=file, newest=False), name=file.stem)
    nox.session(partial(bridge, path=file, newest=True), name=f"newest-{file.stem}")


def core(session: nox.Session, oldest: bool) -> None:
    """Run the tests of the core with the oldest or the newest versions that pyproject.toml allows."""
    versions = ["--upgrade", "--upgrade-strategy", "eager"]
    if oldest:
        bounds = re.findall(r'"([\w.-]+)(?:\[\w+\])?>=([\w.]+)', Path("pyproject.toml").read_text())
        pins = Path(session.create_tmp(), "oldest.txt")
        lines = {f"{name}=={version}" for name, version in bounds}
        lines.add("pyparsing<3.3")  # a later one warns of what the oldest matplotlib calls
        pins.write_text("\n".join(sorted(lines)))
        versions = ["--constraint", str(pins)]
    tools = ["pytest", "pytest-xdist", "hypothesis", "jsonschema", "mpmath"]  # of dev, what the tests import
    session.install("--no-compile", *versions, "--editable", ".[readers,plot,hdf5,reference]", *tools)
    arguments = session.posargs or ["-q", "-n", "auto", "--max-worker-restart=0", "--dist=loadfile"]
    session.run("python", "-m", "pytest", *arguments, env=CLEAN)


def pythons(lowest: str) -> list[str]:
    """One Python of each version that pyproject.toml names and this machine has, on the PATH or in pyenv."""
    versions = re.findall(r":: (3\.\d+)", Path("pyproject.toml").read_text())
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv", "versions")
    found = []
    for version in versions[versions.index(lowest) :]:
        for path in (f"python{version}", *map(str, sorted(pyenv.glob(f"{version}.*/bin/python")))):
            # pyenv has a command for each Python, and most of them say only that it is not chosen
            if shutil.which(path) and subprocess.run([path, "-c", ""], capture_output=True).returncode == 0:
                found.append(path)
                break
    return found


def newest(session: nox.Session) -> None:
    """Run the tests of the core with the newest versions, under the newest Python."""
    if session.python is None:
        session.error(f"found no Python {NEW} or newer, on the PATH or in pyenv; install one")
    core(session, oldest=False)


nox.session(partial(core, oldest=True), name="oldest")
nox.session(newest, python=next(reversed(pythons(NEW)), None))


@nox.session(venv_backend="none")
def windows(session: nox.Session) -> None:
    """Run the tests that are marked portable under Wine."""
    session.run("scripts/windows", *session.posargs, external=True)


@nox.session
def build(session: nox.Session) -> None:
    """Make the wheel and the sdist of the last commit, and run the README from each on all Pythons."""
    out = Path(*(session.posargs or ["dist"])).resolve()
    session.install("--requirement", "scripts/build.txt")
    session.run("cffconvert", "--validate")
    session.run("hadolint", "Containerfile")
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder, "source"), Path(folder, "made")
        session.run("git", "clone", "--quiet", ".", str(source), external=True)
        session.run("python", "-m", "build", "--no-isolation", str(source), "--outdir", str(made))
        files = sorted(made.iterdir())
        session.run("twine", "check", "--strict", *map(str, files))
        for number, python in enumerate(pythons("3.10")):
            for file in files:
                run_readme(session, file, python, Path(folder, f"{number}{file.suffix}"))
        out.mkdir(parents=True, exist_ok=True)
        for file in files:
            session.log(shutil.copy(file, out))


def run_readme(session: nox.Session, file: Path, python: str, folder: Path) -> None:
    """Install a file into an empty environment, and run there what the README shows."""
    lines = Path("README.md").read_text(encoding="utf-8").split("## Your own\n")[1].split("\n## ")[0]
    guide, venv = Path("scripts/guide").resolve(), folder / "venv"
    session.run(python, "-m", "venv", str(venv), external=True)
    session.run(str(venv / "bin/pip"), "install", "--quiet", str(file), external=True)
    (folder / "page.md").write_text(lines, encoding="utf-8")
    with session.chdir(folder):
        env = {**CLEAN, "IBDATA_CACHE_DIR": str(folder / "cache")}
        session.run("venv/bin/ibdata", "generate", "--config", "random.yaml", external=True, env=env)
        session.run("venv/bin/python", str(guide), "page.md", external=True, env=env)
    shutil.rmtree(folder)  # 0.6 GB each
