"""The README is true: every command and every snippet in it runs, in order, in one folder."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)
BRIDGES = {folder.name for folder in (ROOT / "tests/bridges").iterdir()}
SHELL = [line for language, block in BLOCKS if language == "sh" for line in block.splitlines()]


def test_the_two_commands_come_first_and_are_what_ci_runs():
    assert SHELL[0].endswith("ibdata generate --config random.yaml")
    assert SHELL[1] == "scripts/test"
    assert "README.md" in (ROOT / ".ci/run").read_text()


@pytest.mark.slow
def test_every_command_and_snippet_runs_in_order(command: str, tmp_path: Path):
    env = {"PATH": f"{Path(command).parent}:/usr/bin:/bin", "HOME": str(Path.home())}
    lines: list[list[str]] = [["sh", "-c", line] for line in re.findall(r"\| `(ibdata [^`]+)` \|", TEXT)]
    for language, block in BLOCKS:
        if language == "yaml":
            (tmp_path / f"{block.split()[1]}.yaml").write_text(block)
        if "class Cautious" in block:
            (tmp_path / "my_policy.py").write_text(block)
    for number, (language, block) in enumerate(BLOCKS[2:]):
        if any(f"import {name}\n" in block or f"{name}://" in block for name in BRIDGES):
            continue  # its bridge runs it, see tests/bridges
        if language == "python":
            script = tmp_path / f"snippet_{number}.py"
            script.write_text(block)
            lines.append([sys.executable, str(script)])
        if language == "sh":
            lines += [["sh", "-c", line] for line in block.splitlines()]
    for line in lines:
        done = subprocess.run(line, cwd=tmp_path, env=env, capture_output=True, text=True)
        assert done.returncode == 0, (line, done.stderr)
    assert len(lines) >= 15


def test_the_experiment_shown_is_valid(tmp_path: Path):
    from ibdata import load

    (shown,) = (block for language, block in BLOCKS if block.startswith("name: mine\n"))
    (tmp_path / "mine.yaml").write_text(shown)
    experiment = load(tmp_path / "mine.yaml")
    assert len(experiment.cells) == 12
    assert experiment.labels == ("random", "safe", "constant", "bad", "explored", "gaussian")


def test_the_table_of_variants_names_every_field_and_both_values():
    import dataclasses

    from ibdata.dynamics import PAPER, SIEMENS, Variant

    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", TEXT, flags=re.MULTILINE))
    for field in dataclasses.fields(Variant):
        _, paper, siemens = rows[field.name].split(" | ")
        for cell, value in ((paper, getattr(PAPER, field.name)), (siemens, getattr(SIEMENS, field.name))):
            if isinstance(value, int | float):
                assert f"{value:g}" in cell.split()[0]


def test_every_shipped_experiment_is_named():
    from ibdata.experiment import shipped, suites

    for name in (*shipped(), *suites()):
        assert f"`{name.split('/')[0]}`" in TEXT


def test_every_command_policy_and_format_is_named(command: str):
    from ibdata.cli import cli
    from ibdata.exporters import FORMATS
    from ibdata.policies import POLICIES

    for name in cli.list_commands(None):
        assert f"ibdata {name}" in TEXT
    for kind in POLICIES:
        assert f"kind: {kind}" in TEXT
    for name in FORMATS:
        assert f"| `{name}` |" in TEXT
