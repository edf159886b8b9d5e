"""ibdata completion."""

from __future__ import annotations

import click
from click.shell_completion import ShellComplete, get_completion_class

from ibdata.cli._shared import say_all

SHELLS = ("bash", "zsh", "fish")


@click.command("completion")
@click.argument("shell", metavar="SHELL", type=click.Choice(SHELLS))
@click.pass_context
def command(ctx: click.Context, shell: str) -> None:
    """Print the script that makes a shell complete commands, options, configs, policies, columns and splits.

    \b
    ibdata completion bash >> ~/.bashrc
    ibdata completion zsh >> ~/.zshrc
    ibdata completion fish > ~/.config/fish/completions/ibdata.fish
    """
    made = get_completion_class(shell)
    assert made is not None
    # Not the method of bash, which runs a shell to look at its version.
    say_all(ShellComplete.source(made(ctx.find_root().command, {}, "ibdata", "_IBDATA_COMPLETE")).strip("\n"))
