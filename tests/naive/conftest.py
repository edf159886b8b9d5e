"""What the naive uses share."""

import pytest


@pytest.fixture
def run(capsys):
    """Run a command in this process: its exit code, and what it prints on stdout and stderr."""
    from ibdata.cli import main

    def call(*words):
        with pytest.raises(SystemExit) as ended:
            main(list(words))
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err

    return call
