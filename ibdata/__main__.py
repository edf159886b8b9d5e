"""`python -m ibdata` is the command `ibdata`."""

from ibdata.cli import main

main()
