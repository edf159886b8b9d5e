"""Each column of docs/at-a-glance.md runs alone, from top to bottom, in an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT

TEXT = (ROOT / "docs/at-a-glance.md").read_text(encoding="utf-8")
TABLE = re.findall(r"^\| ([^|]+) \| (?:`(ibdata [^`]+)`)? ?\| (?:`([^`]+)`)? ?\|$", TEXT, flags=re.MULTILINE)


def test_there_are_tasks_and_most_are_shown_twice():
    assert len(TABLE) == TEXT.count("\n| ") - 1  # without the heading
    assert sum(bool(line and code) for _, line, code in TABLE) >= 25


@pytest.mark.slow
def test_the_column_of_commands_runs_alone(command: str, tmp_path: Path):
    lines = [line for _, line, _ in TABLE if line]
    env = {**os.environ, "PATH": f"{Path(command).parent}:/usr/bin:/bin"}
    done = subprocess.run(
        ["sh", "-ec", "\n".join(lines)], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_column_of_python_runs_alone(tmp_path: Path):
    script = tmp_path / "tasks.py"
    script.write_text("\n".join(["import ibdata", *(code for _, _, code in TABLE if code)]) + "\n")
    done = subprocess.run([sys.executable, script.name], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_command_policy_and_format_that_is_named_exists():
    """`ibdata -h`, `ibdata config policies` and `ibdata export -h` list all of them."""
    from ibdata.cli import cli
    from ibdata.exporters import FORMATS

    assert set(re.findall(r"`ibdata ([a-z]+)", TEXT)) <= set(cli.list_commands(None))
    (formats,) = (task for task, _, _ in TABLE if task.startswith("Export to"))
    assert set(re.findall(r"`(\w+)`", formats)) == set(FORMATS)
